"""How well models predict one step of a push: motion and force against the simulator's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.planar.scores import mean_interval
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.simulation import GRAVITY
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.process import step_on
from tactile_dynamics_ros.core.planar.network.transitions import Transitions
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights

Model = Callable[[Transitions], tuple[Array, Array]]
NAMES = ("place_mm", "yaw_deg", "force", "far")
"""What is told of each object."""


def still(steps: Transitions) -> tuple[Array, Array]:
    """States that go on as they are, without a force: what must be beaten."""
    after = steps.states.copy()
    links = after.reshape(len(after), -1, 6)
    links[:, :, :3] += steps.push.step * links[:, :, 3:]
    return after, np.zeros_like(steps.force)


def network(weights: GraphWeights) -> Model:
    """The predictions of a network, beside the mechanics where it needs them."""

    def predict(steps: Transitions) -> tuple[Array, Array]:
        base = expected_steps(steps) if weights.residual else None
        states, parameters = steps.states, steps.parameters
        return step_on(weights, steps.thing, states, parameters, steps.push, base)[:2]

    return predict


def errors_of(model: Model, objects: Sequence[Sequence[Transitions]]) -> dict[str, Any]:
    """Median errors over the touched steps of each object, and their mean over objects.

    Forces are over the friction force of the object. Medians, since in some steps a tip slips round
    a corner or stands still under load; `far` is the share of steps off by half that force.
    """
    return summary([medians_of(model, parts) for parts in objects])


def medians_of(model: Model, parts: Sequence[Transitions]) -> list[float]:
    """Median error of place (mm), yaw (deg) and force, and `far`, of the steps of one object."""
    columns = [
        np.concatenate(each) for each in zip(*(_steps(model, p) for p in parts), strict=True)
    ]
    return [*(float(np.median(column)) for column in columns), float(np.mean(columns[2] > 0.5))]


def summary(rows: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Means over objects, whose `medians_of` are given, with intervals."""
    columns = np.array(rows).T
    return {n: mean_interval(c) for n, c in zip(NAMES, columns, strict=True)} | {"n": len(rows)}


def _steps(model: Model, steps: Transitions) -> tuple[Array, Array, Array]:
    """Errors of place (mm), yaw (deg) and force (over friction) of each touched step."""
    after, measured = model(steps)
    touched = steps.push.touching > 0.5
    off = (after - steps.after)[touched].reshape(-1, steps.thing.links, 6)
    product = sum(np.exp(steps.parameters[touched, 4 * k]) for k in range(steps.thing.links))
    return (
        1e3 * np.linalg.norm(off[:, :, :2], axis=2).max(axis=1),
        np.degrees(np.abs(off[:, :, 2]).max(axis=1)),
        np.linalg.norm((measured - steps.force)[touched, :2], axis=1) / (GRAVITY * product),
    )
