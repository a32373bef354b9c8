"""How well models predict one step of a push: motion and force against the simulator's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.planar.scores import mean_interval
from tactile_dynamics_ros.core.planar.network.mechanics import expected_steps
from tactile_dynamics_ros.core.planar.network.process import step_on
from tactile_dynamics_ros.core.planar.network.transitions import Transitions
from tactile_dynamics_ros.core.planar.network.weights import GraphWeights

Array = NDArray[np.float64]
Model = Callable[[Transitions], tuple[Array, Array]]


def still(steps: Transitions) -> tuple[Array, Array]:
    """States that go on as they are, without a force: what must be beaten."""
    after = steps.states.copy()
    links = after.reshape(len(after), -1, 6)
    links[:, :, :3] += steps.push.step * links[:, :, 3:]
    return after, np.zeros((len(after), 2))


def network(weights: GraphWeights) -> Model:
    """The predictions of a network, beside the mechanics where it needs them."""

    def predict(steps: Transitions) -> tuple[Array, Array]:
        base = expected_steps(steps) if weights.residual else None
        states, parameters = steps.states, steps.parameters
        return step_on(weights, steps.thing, states, parameters, steps.push, base)[:2]

    return predict


def errors_of(model: Model, objects: Sequence[Sequence[Transitions]]) -> dict[str, Any]:
    """Root mean squares over the touched steps of each object, and their mean over objects."""
    rows = []
    for parts in objects:
        place, yaw, force, size = [], [], [], []
        for steps in parts:
            after, felt = model(steps)
            rows_ = steps.push.touching > 0.5
            off = (after - steps.after)[rows_].reshape(-1, steps.thing.links, 6)
            place.append(np.linalg.norm(off[:, :, :2], axis=2).ravel())
            yaw.append(off[:, :, 2].ravel())
            force.append((felt - steps.force)[rows_].ravel())
            size.append(steps.force[rows_].ravel())
        rms = [float(np.sqrt(np.mean(np.concatenate(v) ** 2))) for v in (place, yaw, force, size)]
        rows.append([1e3 * rms[0], np.degrees(rms[1]), rms[2] / rms[3]])
    names = ("place_mm", "yaw_deg", "force_relative")
    columns = np.array(rows).T
    return {n: mean_interval(c) for n, c in zip(names, columns, strict=True)} | {"n": len(rows)}
