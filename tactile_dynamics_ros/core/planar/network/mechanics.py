"""What the mechanics of one link expect of many steps at once, for a residual network to learn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.mechanics.hold import Grip, Tip
from tactile_dynamics_ros.core.planar.mechanics.linkage import Link, Linkage, cross, turned
from tactile_dynamics_ros.core.planar.mechanics.simulation import PlanarSimulation, StepConfig
from tactile_dynamics_ros.core.planar.network.graph import centre_motion
from tactile_dynamics_ros.core.planar.network.transitions import Transitions


def expected_steps(steps: Transitions) -> tuple[Array, Array]:
    """States (N, 6) and mean forces (N, 2 or 3): what `PatchProcess` predicts of each step alone.

    It takes one motion of the pusher for all hypotheses; here every step has its own.
    """
    known = steps.thing.com_height
    base = PatchProcess(steps.thing.patches[0].outline, None if known is None else float(known[0]))
    states, forces = steps.states.copy(), np.zeros_like(steps.force)
    for touching in (True, False):
        rows = np.flatnonzero((steps.push.touching > 0.5) == touching)
        if len(rows):
            states[rows], forces[rows] = _part(base, steps, rows, touching)
    return states, forces


def _part(
    base: PatchProcess, steps: Transitions, rows: NDArray[np.intp], touching: bool
) -> tuple[Array, Array]:
    push, parameters = steps.push, steps.parameters[rows]
    height = push.height[rows] if base.com_height is None else np.full(len(rows), base.com_height)
    linkage = Linkage((_link(base, height, parameters),))
    pusher = _pusher(base, steps, rows, touching)
    _, twist = centre_motion(steps.states[rows], parameters, 0)
    count = max(1, int(np.ceil(push.step / base.step - 1e-9)))
    pose = steps.states[rows, None, :3]
    config = StepConfig(push.step / count, base.rounds)
    simulation = PlanarSimulation(linkage, pusher, pose, config, twist[:, None])
    point = np.pad(push.point[rows], ((0, 0), (0, 1)))
    turning = np.zeros(len(rows)) if push.turning is None else push.turning[rows]
    moving = np.column_stack([push.velocity[rows], turning]) * config.step
    wrench = np.zeros((len(rows), 3))
    for k in range(count):
        simulation.step(point + k * moving, point + (k + 1) * moving)
        part = simulation.wrench.copy()
        part[:, 2] += cross(k * moving[:, :2], part[:, :2])
        wrench += part / count
    frame = linkage.frames(simulation.coordinates)[:, 0]
    arm, final = turned(parameters[:, 2:4], frame[:, 2]), simulation.twist[:, 0]
    across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    velocity = final[:, :2] - final[:, 2:] * across
    forces = wrench[:, : steps.force.shape[1]]
    return np.concatenate([frame, velocity, final[:, 2:]], axis=1), forces


def _pusher(
    base: PatchProcess, steps: Transitions, rows: NDArray[np.intp], touching: bool
) -> Tip | Grip:
    push = steps.push
    if push.turning is not None and touching:
        return Grip(push.height[rows])
    friction = np.exp(steps.parameters[rows, 4])
    return Tip(base.outline, push.height[rows], friction, touching, push.normal[rows])


def _link(base: PatchProcess, com_height: Array, parameters: Array) -> Link:
    product, mass = np.exp(parameters[:, :2].T)
    same = np.ones(len(mass))
    return Link(
        patch=base.patch,
        mass=mass,
        friction=product / mass,
        com=parameters[:, 2:4],
        com_height=com_height,
        inertia=mass * base.patch.gyration,
        scale=same,
    )
