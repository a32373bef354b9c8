"""What sensors make of a simulated push: samples, noise, systematic errors, gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.synthetic.pushed.bodies import rotation
from tactile_dynamics_ros.synthetic.pushed.effects import Faults
from tactile_dynamics_ros.synthetic.pushed.pusher import CONTACTS
from tactile_dynamics_ros.synthetic.pushed.scene import STEP, Scene
from tactile_dynamics_ros.synthetic.pushed.simulator import Motion

_AVERAGED = 0.01
"""s over which a force is averaged, centred on its stamp."""
COM_HEIGHT_STD = 0.003
"""m that is stated for the height of the centre of mass: half the height of what a camera sees."""


@dataclass(frozen=True)
class SensorOptions:
    """Rates, noise and defects.

    Attributes:
        rate_hz, force_rate_hz: of poses and forces.
        force_std: N. position_std: m. rotation_std_deg: each per axis.
        point_std: m, white, of the contact point.
        systematic: multiple of lasting errors: 2 mm in the height of the push, 0.5 mm in the
            contact point (axes of the pusher), COM_HEIGHT_STD in the height of the centre of mass.
        pose_gaps: gaps of 50 to 300 ms in the poses.
        state_std: whether noise is stated.
    """

    rate_hz: float = 100.0
    force_rate_hz: float = 100.0
    force_std: float = 0.03
    position_std: float = 0.0005
    rotation_std_deg: float = 0.2
    point_std: float = 0.0003
    systematic: float = 0.0
    pose_gaps: int = 0
    state_std: bool = True


def read_sensors(
    motion: Motion,
    scene: Scene,
    faults: Faults,
    options: SensorOptions,
    rng: np.random.Generator,
    lasting: np.random.Generator | None = None,
) -> PushedStreams:
    """Return what is recorded.

    Args:
        motion: what happened.
        scene: what was simulated.
        faults: of the force sensor.
        options: rates, noise and defects.
        rng: of the noise.
        lasting: of lasting errors, which recordings share if it is alike; None: `rng`.
    """
    lasting = rng if lasting is None else lasting
    height_error = 0.002 * options.systematic * lasting.normal()
    point_error = 0.0005 * options.systematic * lasting.normal(size=2)
    com_error = COM_HEIGHT_STD * options.systematic * lasting.normal(size=len(scene.thing.links))
    errors = np.array([*point_error, height_error])
    links = tuple(_link(motion, scene, k, options, rng) for k in range(len(scene.thing.links)))
    contacts = {}
    for k, name in enumerate(CONTACTS):
        if motion.contact[:, k].any():
            contacts[name] = _contact(motion, scene, k, faults, options, errors, rng)
    heights = [0.5 * link.height + e for link, e in zip(scene.thing.links, com_error, strict=True)]
    ticks = _ticks(len(motion.time), options.force_rate_hz)
    return PushedStreams(
        links=links,
        contacts=contacts,
        pusher_time=motion.time[ticks],
        pusher_yaw=motion.pusher[ticks, 2],
        com_height=tuple(float(h) for h in heights),
        com_height_std=(COM_HEIGHT_STD,) * len(heights),
    )


def _ticks(count: int, rate_hz: float) -> np.ndarray:
    ticks = np.round(np.arange(3.0, count - 4.0, 1.0 / (rate_hz * STEP))).astype(int)
    return np.unique(ticks)


def _link(
    motion: Motion, scene: Scene, k: int, options: SensorOptions, rng: np.random.Generator
) -> LinkStream:
    thing = scene.thing
    body, shift = (0, k * thing.offset) if thing.kind == "rigid_pair" else (k, np.zeros(2))
    ticks = _ticks(len(motion.time), options.rate_hz)
    keep = np.ones(len(ticks), dtype=bool)
    for start in rng.uniform(0.0, motion.time[-1], options.pose_gaps):
        inside = (motion.time[ticks] > start) & (
            motion.time[ticks] < start + rng.uniform(0.05, 0.3)
        )
        keep &= ~inside
    ticks = ticks[keep]
    yaw = motion.angle[ticks, body]
    place = motion.origin[ticks, body] + np.einsum("nij,j->ni", rotation(yaw), shift)
    std = np.array([options.position_std] * 2 + [np.radians(options.rotation_std_deg)])
    pose = np.concatenate([place, yaw[:, None]], axis=1) + std * rng.normal(size=(len(ticks), 3))
    stated = std if options.state_std else None
    return LinkStream(motion.time[ticks], pose, stated, thing.links[k].corners)


def _contact(
    motion: Motion,
    scene: Scene,
    k: int,
    faults: Faults,
    options: SensorOptions,
    errors: np.ndarray,
    rng: np.random.Generator,
) -> PushContact:
    ticks = _ticks(len(motion.time), options.force_rate_hz)
    half = round(0.5 * _AVERAGED / STEP - 0.5)
    window = np.arange(-half, half + 2)
    weight = np.ones(len(window))
    weight[0] = weight[-1] = 0.5
    touching = motion.contact[ticks[:, None] + window, k].any(axis=1) & motion.contact[ticks, k]
    ticks = ticks[touching]
    flat = np.einsum("nwi,w->ni", motion.force[ticks[:, None] + window, k], weight / weight.sum())
    yaw = motion.pusher[ticks, 2]
    force = faults.applied(np.pad(flat, ((0, 0), (0, 1))), yaw)
    force += options.force_std * rng.normal(size=force.shape)
    point = np.pad(motion.point[ticks, k], ((0, 0), (0, 1)), constant_values=scene.tip.height)
    point[:, :2] += np.einsum("nij,j->ni", rotation(yaw), errors[:2])
    point[:, 2] += errors[2]
    point[:, :2] += options.point_std * rng.normal(size=(len(ticks), 2))
    return PushContact(
        name=CONTACTS[k],
        time=motion.time[ticks] + faults.delay,
        force=force,
        force_std=np.full(3, options.force_std) if options.state_std else None,
        pose_time=motion.time[ticks],
        point=point,
        normal=np.pad(motion.normal[ticks, k], ((0, 0), (0, 1))),
        point_std=options.point_std if options.state_std else None,
    )
