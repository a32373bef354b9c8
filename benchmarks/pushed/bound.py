"""What recordings of pushes can tell at all: the Cramer-Rao bound of a simulated scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic.pushed.effects import Faults
from tactile_dynamics_ros.synthetic.pushed.scene import Scene
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions, read_sensors
from tactile_dynamics_ros.synthetic.pushed.simulator import simulate

_STEP = 1e-3
"""Change of a parameter for the difference quotient, over its size: stick and slip go on as they
were, and 64-bit rounding is far below."""
_FREE = np.inf
"""Prior standard deviation of what nothing is known of beforehand."""


def _of_link(scene: Scene, **changes: object) -> Scene:
    link = replace(scene.thing.links[0], **changes)  # type: ignore[arg-type]
    return replace(scene, thing=replace(scene.thing, links=(link,)))


def _heavier(scene: Scene, by: float) -> Scene:
    link, factor = scene.thing.links[0], float(np.exp(by))
    return _of_link(
        scene,
        mass=link.mass * factor,
        friction=link.friction / factor,
        inertia=link.inertia * factor,
    )


def _moved(axis: int) -> Callable[[Scene, float], Scene]:
    return lambda scene, by: _of_link(scene, com=scene.thing.links[0].com + by * np.eye(2)[axis])


def _grown(name: str) -> Callable[[Scene, float], Scene]:
    return lambda scene, by: _of_link(
        scene, **{name: getattr(scene.thing.links[0], name) * float(np.exp(by))}
    )


def _of_tip(name: str) -> Callable[[Scene, float], Scene]:
    return lambda scene, by: replace(
        scene, tip=replace(scene.tip, **{name: getattr(scene.tip, name) * float(np.exp(by))})
    )


def _higher(scene: Scene, by: float) -> Scene:
    return replace(scene, tip=replace(scene.tip, height=scene.tip.height + by))


def _taller(scene: Scene, by: float) -> Scene:
    return _of_link(scene, height=scene.thing.links[0].height + by)


PARAMETERS: dict[str, tuple[Callable[[Scene, float], Scene], float, float]] = {
    "friction_force_n": (_grown("friction"), 1.0, _FREE),
    "mass": (_heavier, 1.0, _FREE),
    "com_x": (_moved(0), 0.01, _FREE),
    "com_y": (_moved(1), 0.01, _FREE),
    "inertia": (_grown("inertia"), 1.0, 0.3),
    "push_height": (_higher, 0.01, 2e-3),
    "height": (_taller, 0.01, 6e-3),
    "scale": (_grown("feet"), 1.0, 0.03),
    "tip_friction": (_of_tip("friction"), 1.0, _FREE),
    "tip_stiffness": (_of_tip("stiffness"), 1.0, _FREE),
    "tip_shear_stiffness": (_of_tip("shear_stiffness"), 1.0, _FREE),
    "tip_damping": (_of_tip("damping"), 1.0, _FREE),
}
"""What changes a scene, its size, and its standard deviation beforehand: logarithms, m for places
and heights. The first four are wanted, the others unknown beside them. The path of the arm is taken
as known, which no estimator has: the bound is lower than what can be reached."""


def bound(scene: Scene, sensors: SensorOptions) -> dict[str, float]:
    """Least standard deviations of the first four of `PARAMETERS`, by name.

    F = sum J^T J / sigma^2 + prior, with J the derivative of noiseless poses and forces at their
    stamps; the bound is the root of the diagonal of F^-1. Even tables only: on others the friction
    of the places is unknown too.

    Args:
        scene: as it was simulated.
        sensors: their noise.
    """
    changes = [size * _STEP for _, size, _ in PARAMETERS.values()]
    scenes = [
        change(scene, sign * by)
        for (change, _, _), by in zip(PARAMETERS.values(), changes, strict=True)
        for sign in (1.0, -1.0)
    ]
    exact = replace(
        sensors, force_std=0.0, position_std=0.0, rotation_std_deg=0.0, point_std=0.0,
        systematic=0.0, pose_gaps=0, state_std=False,
    )  # fmt: skip
    streams = [
        read_sensors(motion, made, Faults(), exact, np.random.default_rng(0))
        for motion, made in zip(simulate(scenes), scenes, strict=True)
    ]
    information = np.diag([1.0 / prior**2 for _, _, prior in PARAMETERS.values()])
    angle = np.radians(sensors.rotation_std_deg)
    for read, std in (
        (_poses, np.array([sensors.position_std, sensors.position_std, angle])),
        (_forces, np.full(2, sensors.force_std)),
    ):
        stamps = sorted(set.intersection(*(set(read(s)[0].tolist()) for s in streams)))
        seen = [_at(stamps, *read(s)) / std for s in streams]
        columns = [
            ((seen[2 * k] - seen[2 * k + 1]) / (2.0 * by)).ravel() for k, by in enumerate(changes)
        ]
        jacobian = np.stack(columns, axis=1)
        information = information + jacobian.T @ jacobian
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    return {name: float(s) for name, s in list(zip(PARAMETERS, std, strict=True))[:4]}


def _poses(streams: PushedStreams) -> tuple[Array, Array]:
    link = streams.links[0]
    return link.time, link.pose


def _forces(streams: PushedStreams) -> tuple[Array, Array]:
    contact = next(iter(streams.contacts.values()))
    return contact.time, contact.force[:, :2]


def _at(stamps: list[float], time: Array, values: Array) -> Array:
    return np.asarray(values[np.searchsorted(time, stamps)])
