"""Steps of pushes with known outcome, and what a network is to say of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.graph import (
    HELP,
    Push,
    Thing,
    build_graph,
    centre_motion,
    to_contact,
    touched_first,
)

Mechanics = Callable[["Transitions"], tuple[Array, Array]]
"""States (N, 6 L) and forces (N, 2 or 3), axes of the support, that mechanics expect of steps."""


@dataclass(frozen=True, eq=False)
class Noise:
    """How well the outcome of N steps is known.

    Attributes:
        motion: (N, L, MOTION) std, m/s and rad/s. force: (N, 2 or 3) std, N and N m.
    """

    motion: Array
    force: Array


@dataclass(frozen=True, eq=False)
class Transitions:
    """Steps of one object under one touched link.

    Attributes:
        thing: geometry. parameters: (N, p) as `GraphProcess.names`.
        states, after: (N, 6 L) when a step begins and ends, as `filter.process.LINK_STATE`.
        push: (N) of the robot.
        force: (N, 2) N on the object, mean over the step, axes of the support; of grippers (N, 3),
            with the torque (N m) about where they began.
        noise: of motion and force where they were measured; None where they are known exactly.
    """

    thing: Thing
    parameters: Array
    states: Array
    after: Array
    push: Push
    force: Array
    noise: Noise | None = None

    def __len__(self) -> int:
        return len(self.states)

    def disturbed(self, velocity_std: float, point_std: float, seed: int) -> Transitions:
        """The same outcomes from states and contact points that are known less well.

        Args:
            velocity_std: m/s; turning rates are off by as much at 5 cm.
            point_std: m.
            seed: of the errors.
        """
        rng = np.random.default_rng(seed)
        states = self.states.copy()
        moving = states.reshape(len(states), -1, 6)[:, :, 3:]
        moving += rng.normal(size=moving.shape) * velocity_std * np.array([1.0, 1.0, 20.0])
        point = self.push.point + point_std * rng.normal(size=self.push.point.shape)
        return replace(self, states=states, push=replace(self.push, point=point))


TRANSITION_KINDS = (Transitions, Thing, SupportPatch, Push, Noise)
"""Dataclasses of which transitions are made; files of them may hold no other."""


@dataclass(frozen=True, eq=False)
class Examples:
    """What a network learns from: graphs and outcomes of N steps of objects with L links.

    Attributes:
        nodes: (N, 2 + L, F). edges: (N, 2 L, EDGE).
        motion: (N, L, MOTION) and force: (N, 2 or 3) beside the mechanics where those help, m/s,
            rad/s, N, N m, axes of the contact.
        noise: of both.
    """

    nodes: Array
    edges: Array
    motion: Array
    force: Array
    noise: Noise

    def __len__(self) -> int:
        return len(self.nodes)


def outcome(steps: Transitions, after: Array) -> Array:
    """Mean and final velocities (N, L, MOTION) of the centres of mass, axes of the contact."""
    rows = []
    step, normal = steps.push.step, steps.push.normal
    for link in touched_first(steps.thing.links, steps.push.link):
        begin, _ = centre_motion(steps.states, steps.parameters, link)
        end, velocity = centre_motion(after, steps.parameters, link)
        turned_by = after[:, 6 * link + 2] - steps.states[:, 6 * link + 2]
        mean = np.column_stack([to_contact(end - begin, normal), turned_by]) / step
        final = np.column_stack([to_contact(velocity[:, :2], normal), velocity[:, 2]])
        rows.append(np.concatenate([mean, final], axis=1))
    return np.stack(rows, axis=1)


def helping(motion: Array, force: Array, units: tuple[Array, Array]) -> Array:
    """Features (N, 1 + L, HELP) of what mechanics expect of robot and links.

    Args:
        motion: (N, L, MOTION), axes of the contact.
        force: (N, 2 or 3), axes of the contact.
        units: (MOTION,) and (2,) or (3,).
    """
    robot = np.zeros((len(motion), 1, HELP))
    robot[:, 0, : force.shape[1]] = force / units[1]
    return np.concatenate([robot, motion / units[0]], axis=1)


def make_examples(
    steps: Transitions, speed: float, units: tuple[Array, Array], mechanics: Mechanics | None
) -> Examples:
    """Graphs and outcomes of steps of one object."""
    motion = outcome(steps, steps.after)
    force = to_contact(steps.force, steps.push.normal)
    help_ = None
    if mechanics is not None:
        states, pushing = mechanics(steps)
        expected = outcome(steps, states)
        pressing = to_contact(pushing, steps.push.normal)
        help_ = helping(expected, pressing, units)
        motion, force = motion - expected, force - pressing
    graph = build_graph(steps.thing, steps.states, steps.parameters, steps.push, speed, help_)
    noise = steps.noise or Noise(np.zeros_like(motion), np.zeros_like(force))
    return Examples(graph.nodes, graph.edges, motion, force, noise)


def joined(parts: Sequence[Examples]) -> Examples:
    """Examples of several objects with as many links."""
    nodes, edges, motion, force = (
        np.concatenate([getattr(p, name) for p in parts])
        for name in ("nodes", "edges", "motion", "force")
    )
    motion_std, force_std = (
        np.concatenate([getattr(p.noise, name) for p in parts]) for name in ("motion", "force")
    )
    return Examples(nodes, edges, motion, force, Noise(motion_std, force_std))
