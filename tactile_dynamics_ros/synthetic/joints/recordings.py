"""Recordings of an arm with known truth: links that differ from the URDF, friction, a payload."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.synthetic.joints.dynamics import (
    Dynamics,
    SimulatedLink,
    inverse_dynamics,
    read_links,
)
from tactile_dynamics_ros.synthetic.joints.effects import CATALOGUE, LAST, OUTSIDE, Drives
from tactile_dynamics_ros.synthetic.randomness import stream

_GRAVITY = np.array([0.0, 0.0, -9.81])
_FRICTION = 0.02
"""Coulomb friction as a share of a joint's largest torque, 1 to 3 % in published identifications
of arms with harmonic drives; each joint draws its own about it."""
_MASS, _CENTRE, _INERTIA = 0.06, 0.006, 0.12
"""How far links are from their URDF: relative std of a mass, std of a centre in m, relative std of
an inertia. Published identifications differ from the makers' files by about as much."""
_LOADS = np.array([100.0, 100.0, 60.0, 60.0, 25.0, 20.0, 10.0])
"""Torques that a joint of an arm of this size is used at, N m, from the base on."""


@dataclass(frozen=True, eq=False)
class Payload:
    """A body at the flange.

    Attributes:
        mass: kg. com: (3,) m in the flange's axes. inertia: (3, 3) kg m^2 about it.
    """

    mass: float
    com: Array
    inertia: Array

    @classmethod
    def draw(cls, mass: float, seed: int) -> Payload:
        """A box of a mass, some centimetres off the flange's axis."""
        random = stream(seed, "payload")
        sides = random.uniform(0.08, 0.2, 3)
        about = mass / 12.0 * np.diag(np.sum(sides**2) - sides**2)
        com = np.array([*random.uniform(-0.03, 0.03, 2), random.uniform(0.04, 0.12)])
        return cls(mass, com, about)


@dataclass(frozen=True, eq=False)
class JointOptions:
    """How an arm is recorded.

    Attributes:
        duration: s. rate_hz: of the recording.
        payload: at the flange; None for nothing.
        effort_noise: std of a torque's white noise as a share of a joint's friction.
        position_noise: of the encoders, rad.
        repeat: number of the repetition of the same motion; noise differs.
        motion: number of the motion of the same arm.
        joints: that move, from the base on.
        path: (3, N, n) position, speed and acceleration at each sample, in place of a motion that
            is drawn; None to draw one.
    """

    duration: float = 30.0
    rate_hz: float = 500.0
    payload: Payload | None = None
    effort_noise: float = 0.1
    position_noise: float = 1e-5
    repeat: int = 0
    motion: int = 0
    joints: int = 7
    path: Array | None = None


@dataclass(frozen=True, eq=False)
class HiddenArm:
    """What was recorded, and the truth that the estimation never sees."""

    streams: JointStreams
    seed: int
    options: JointOptions
    hidden: Mapping[str, Any]
    friction: Mapping[str, list[float]]
    links: Sequence[SimulatedLink] = field(default_factory=tuple)

    def truth(self) -> dict[str, Any]:
        """Payload, friction and effects as plain numbers, ready for JSON."""
        load = self.options.payload
        payload = None
        if load is not None:
            payload = {
                "mass": load.mass,
                "com": load.com.tolist(),
                "inertia_com": load.inertia.tolist(),
            }
        return {
            "seed": self.seed,
            "payload": payload,
            "friction": dict(self.friction),
            "effects": dict(self.hidden),
        }


def generate(
    urdf: str,
    seed: int,
    effects: Mapping[str, float] | None = None,
    options: JointOptions | None = None,
) -> HiddenArm:
    """Record an arm that differs from its URDF, with hidden effects.

    Args:
        urdf: text.
        seed: of arm, motion, effects and noise.
        effects: magnitudes by name, 1 being typical.
        options: of the recording.
    """
    options = options or JointOptions()
    links, end = read_links(urdf, options.joints)
    links = [_differing(link, stream(seed, "link", link.name)) for link in links]
    if options.payload is not None:
        links[-1] = _loaded(links[-1], end, options.payload)
    time = np.arange(round(options.duration * options.rate_hz)) / options.rate_hz
    drawn = _motion(links, time, stream(seed, "motion", str(options.motion)))
    q, dq, ddq = drawn if options.path is None else options.path
    drives = _drives(links, (time, q, dq, ddq), seed)
    hidden: dict[str, Any] = {}
    chosen = dict(effects or {})
    for name in sorted(chosen, key=lambda name: name in LAST):
        drives.magnitude, drives.random = chosen[name], stream(seed, "effect", name)
        {**CATALOGUE, **OUTSIDE}[name](drives)
        hidden[name] = {"magnitude": chosen[name], **drives.truth}
    random = stream(seed, "noise", str(options.motion), str(options.repeat))
    noise = options.effort_noise * drives.size * random.normal(size=q.shape)
    position = drives.seen + options.position_noise * random.normal(size=q.shape)
    names = tuple(link.name for link in links)
    streams = JointStreams(names, time, position, drives.torque + noise, urdf)
    friction = {"coulomb": drives.coulomb.tolist(), "viscous": drives.viscous.tolist()}
    return HiddenArm(streams, seed, options, hidden, friction, links)


def _differing(link: SimulatedLink, random: np.random.Generator) -> SimulatedLink:
    """A link as it was built: a little heavier or lighter than its file says."""
    return replace(
        link,
        mass=link.mass * float(np.exp(random.normal(0.0, _MASS))),
        com=link.com + random.normal(0.0, _CENTRE, 3),
        inertia=link.inertia * float(np.exp(random.normal(0.0, _INERTIA))),
    )


def _loaded(link: SimulatedLink, end: tuple[Array, Array], load: Payload) -> SimulatedLink:
    place, turn = end
    return link.with_body(load.mass, place + turn @ load.com, turn @ load.inertia @ turn.T)


def _motion(
    links: Sequence[SimulatedLink], time: Array, random: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Sums of five sines for each joint, within 70 % of its limits."""
    q, dq, ddq = (np.zeros((len(time), len(links))) for _ in range(3))
    for k, link in enumerate(links):
        omega = 2.0 * np.pi * random.uniform(0.06, 0.5, 5)
        phase, size = random.uniform(0.0, 2.0 * np.pi, 5), random.uniform(0.4, 1.0, 5)
        lower, upper = max(link.lower, -2.5), min(link.upper, 2.5)
        wave = size * np.sin(np.outer(time, omega) + phase)
        rate = size * omega * np.cos(np.outer(time, omega) + phase)
        reach = 0.35 * (upper - lower) / np.abs(wave.sum(axis=1)).max()
        pace = 0.6 * min(link.velocity, 2.0) / np.abs(rate.sum(axis=1)).max()
        scale = min(reach, pace)
        q[:, k] = 0.5 * (lower + upper) + scale * wave.sum(axis=1)
        dq[:, k] = scale * rate.sum(axis=1)
        ddq[:, k] = -scale * (wave * omega**2).sum(axis=1)
    return q, dq, ddq


def _drives(
    links: list[SimulatedLink], motion: tuple[Array, Array, Array, Array], seed: int
) -> Drives:
    """Torques of rigid bodies and plain friction."""
    time, q, dq, ddq = motion
    random = stream(seed, "friction")
    n = len(links)
    usual = np.array([min(link.effort, load) for link, load in zip(links, _LOADS, strict=False)])
    size = _FRICTION * usual
    coulomb = size * random.uniform(0.6, 1.6, n)
    viscous = size * random.uniform(0.4, 1.2, n)

    def bodies(gravity: Array) -> Dynamics:
        return inverse_dynamics(links, q, dq, ddq, gravity)

    rigid = bodies(_GRAVITY)
    offset = 0.2 * size * random.normal(size=n)
    torque = rigid.torque + coulomb * np.sign(dq) + viscous * dq + offset
    return Drives(
        time=time,
        q=q,
        dq=dq,
        ddq=ddq,
        dynamics=rigid,
        tilted=lambda gravity: bodies(gravity).torque,
        coulomb=coulomb,
        viscous=viscous,
        torque=torque,
        seen=q.copy(),
        size=size,
        magnitude=1.0,
        random=random,
    )
