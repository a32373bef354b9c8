"""The wrench that the world applies on what is carried, from sensors that carry it too."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.compensation.causal_motion import CausalMotion, Motion
from tactile_dynamics_ros.core.inertia.compensation.changed_load import MEMORIES, ChangedLoad
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import cross

_EXAMPLE = 40
"""Samples on which it is tried whether an effect needs others than the present one, 0.4 s. More try
no other laws."""
_LATER = 100.0
"""Time by which those samples are shifted, s: whether a law counts time from a beginning."""
_LEVER = 0.05
"""Noise of a wrist sensor's torque over that of its force, m: 0.05 for an ATI Gamma (1/800 N m
and 1/40 N) and a Robotiq FT 300 (5 mN m, 0.1 N), by their data sheets. It weighs torques beside
forces where a change of the load is looked for, and is part of `wrench_std`."""


class ContactWrenches(NamedTuple):
    """What C sensors apply on the object at N instants, world axes.

    Attributes:
        time: (N,) s.
        names: C names.
        point: (N, C, 3) m. rotation: (N, C, 3, 3) of the sensors.
        force: (N, C, 3) N. torque: (N, C, 3) N m about the points.
        touches: (N, C) whether there is a reading.
        force_std: (N, 3) N, of their sum.
    """

    time: Array
    names: tuple[str, ...]
    point: Array
    rotation: Array
    force: Array
    torque: Array
    touches: NDArray[np.bool_]
    force_std: Array


class Compensated(NamedTuple):
    """Contact wrenches at N instants, [torque, force].

    Attributes:
        time: (N,) s.
        wrench: (N, 6) of the world on what is carried, about the origin and in axes of `rotation`.
        std: (N, 6).
        rotation: (N, 3, 3) axes in the world: those of the one sensor, or of the object.
        position: (N, 3) m, the point about which the torques are, world.
    """

    time: Array
    wrench: Array
    std: Array
    rotation: Array
    position: Array


@dataclass(frozen=True)
class Load:
    """What is carried: a body and the effects that act beside it.

    Attributes:
        body: dynamic parameters and their covariance, frame of the object's pose.
        effects: with their parameters (k,), without those that `uncompensated` names.
        uncompensated: effects that need more than the present moment, such as a fluid that moves.
    """

    body: KnownBody
    effects: tuple[tuple[Effect, Array], ...]
    uncompensated: tuple[str, ...]

    @classmethod
    def of_body(cls, body: KnownBody, contacts: tuple[str, ...]) -> Load:
        """Return the load of a known body whose effects were found with these contacts.

        Raises:
            BadInputError: an effect is unknown, or a parameter of it is missing.
        """
        acting, left = [], []
        for label, values in body.effects.items():
            if _is_instantaneous(label):
                effect = create_effect(label)
                acting.append((effect, _parameters(effect, values, contacts)))
            else:
                left.append(label)
        return cls(body, tuple(acting), tuple(left))

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass, kg, by what the same sensors read of it.

        Their gains, which another load is measured with too, are left out where they are known.
        """
        lasting = 0.0 if self.body.lasting is None else self.body.lasting[0, 0]
        return float(np.sqrt(max(self.body.covariance[0, 0] - lasting, 0.0)))


@lru_cache
def _is_instantaneous(label: str) -> bool:
    """Whether a law of the present moment alone: one sample has the same wrench as among others."""
    effect = create_effect(label)
    if effect.delays or effect.event or effect.rings:
        return False
    samples = example_samples(_EXAMPLE)
    theta, inertia = effect.typical(samples), example_inertia()
    together = effect.wrench(samples, inertia, theta)
    last = _last_of(samples)
    later = replace(last, time=last.time + _LATER)
    size = np.abs(together).max() + 1e-12
    return all(
        np.abs(effect.wrench(one, inertia, theta)[0] - together[-1]).max() < 1e-6 * size
        for one in (last, later)
    )


def _parameters(effect: Effect, values: Mapping[str, Any], contacts: tuple[str, ...]) -> Array:
    """Return theta (k,) of an effect, from its parameters by name."""
    found = []
    for parameter in effect.parameters(_at_rest(contacts)):
        if parameter.name not in values:
            raise BadInputError(
                f"effect {effect.label}: no value of {parameter.name}; expected an estimate of "
                f"contacts {', '.join(contacts)}"
            )
        found.append(float(values[parameter.name]["value"]))
    return np.array(found)


def _last_of(samples: WrenchSamples) -> WrenchSamples:
    """The last of the samples alone."""
    names = (
        *("time", "position", "rotation", "velocity", "acceleration", "angular_velocity"),
        *("angular_acceleration", "contact_point", "contact_rotation", "contact_force"),
        *("contact_torque", "in_contact"),
    )
    return replace(samples, **{name: getattr(samples, name)[-1:] for name in names})


def _at_rest(contacts: tuple[str, ...]) -> WrenchSamples:
    """One sample at rest; sensors of torques read some, one alone does."""
    zero, count = np.zeros((1, 3)), len(contacts)
    motion = Motion(zero, np.eye(3)[None], zero, zero, zero, zero)
    still = np.zeros((1, count, 3))
    torque = np.full((1, count, 3), float(count == 1))
    frames = np.tile(np.eye(3), (1, count, 1, 1))
    readings = ContactWrenches(
        np.zeros(1), contacts, still, frames, still, torque, np.ones((1, count), bool), zero
    )
    return _samples_of(motion, readings)


def _samples_of(motion: Motion, seen: ContactWrenches) -> WrenchSamples:
    """Samples of a motion with wrenches that are given in the world."""
    into = np.swapaxes(motion.rotation, 1, 2)[:, None]

    def turned(vectors: Array) -> Array:
        return np.asarray((into @ vectors[..., None])[..., 0])

    return WrenchSamples(
        time=seen.time,
        position=motion.position,
        rotation=motion.rotation,
        velocity=motion.velocity,
        acceleration=motion.acceleration,
        angular_velocity=motion.angular_velocity,
        angular_acceleration=motion.angular_acceleration,
        contact_names=seen.names,
        contact_point=turned(seen.point - motion.position[:, None]),
        contact_rotation=into @ seen.rotation,
        contact_force=turned(seen.force),
        contact_torque=turned(seen.torque),
        in_contact=seen.touches,
        gravity=GRAVITY_W,
    )


class Compensator:
    """Takes zero, gravity and inertia of a load out of what sensors measure that carry it.

    measured + Delta + contact = Y phi, so contact = Y phi - Delta - measured, with the motion at
    that moment as poses so far predict it.

    Attributes:
        motion: of the object, from its poses.
        load: what is carried; None while unknown.
    """

    def __init__(self) -> None:
        """Begin without a load."""
        self.motion = CausalMotion()
        self.load: Load | None = None
        self._changed = [ChangedLoad(memory) for memory in MEMORIES]

    @property
    def load_change(self) -> float:
        """Change of the mass, kg, that the last contact wrenches show; 0 where they show none."""
        if self.load is None:
            return 0.0
        mass, alike = float(self.load.body.phi[0]), self.motion.acceleration_delay
        found = (one.change(mass, self.load.mass_std, alike) for one in self._changed)
        return max(found, key=abs)

    def compensate(self, seen: ContactWrenches) -> Compensated:
        """Return the contact wrenches.

        Args:
            seen: readings near the newest pose; there is a load.
        """
        assert self.load is not None
        motion = self.motion.at(seen.time)
        samples = _samples_of(motion, seen)
        phi = self.load.body.phi
        rows = regressor(
            samples.specific_acceleration, samples.angular_velocity, samples.angular_acceleration
        )
        contact = rows @ phi - samples.measured_wrench
        for effect, theta in self.load.effects:
            contact -= effect.wrench(samples, phi, theta)
        of_load, of_moment = self._variances(rows, samples, seen)
        for changed in self._changed if self.motion.settled else ():
            changed.add(seen.time, rows, contact, np.sqrt(of_moment))
        std = np.sqrt(of_load + of_moment)
        if len(seen.names) > 1:
            return Compensated(seen.time, contact, std, motion.rotation, motion.position)
        return _at_sensor(contact, std, samples, seen)

    def _variances(
        self, rows: Array, samples: WrenchSamples, seen: ContactWrenches
    ) -> tuple[Array, Array]:
        """Variances (N, 6) from the load, and from accelerations and sensors."""
        assert self.load is not None
        body = self.load.body
        of_load = np.einsum("nij,jk,nik->ni", rows, body.covariance, rows)
        linear, angular = self.motion.acceleration_std
        mass, first = body.phi[0], float(np.linalg.norm(body.phi[1:4]))
        inertia = float(np.abs(body.phi[[4, 6, 9]]).max())
        torque = np.hypot(first * linear, inertia * angular)
        force = np.hypot(mass * linear, first * angular)
        reach = np.linalg.norm(samples.contact_point, axis=2).max(axis=1, initial=0.0)
        lever = np.hypot(reach, _LEVER if len(seen.names) == 1 else 0.0)
        sensed = np.concatenate([lever[:, None] * seen.force_std, seen.force_std], axis=1)
        moving = np.repeat([torque, force], 3)
        return of_load, np.asarray(sensed**2 + moving**2)


def _at_sensor(
    contact: Array, std: Array, samples: WrenchSamples, seen: ContactWrenches
) -> Compensated:
    """Return wrenches about the point of the one sensor, in its axes."""
    torque = contact[:, :3] - cross(samples.contact_point[:, 0], contact[:, 3:])
    into = np.swapaxes(samples.contact_rotation[:, 0], 1, 2)
    wrench = [(into @ part[..., None])[..., 0] for part in (torque, contact[:, 3:])]
    spread = [
        np.sqrt((into**2 @ (part**2)[..., None])[..., 0]) for part in (std[:, :3], std[:, 3:])
    ]
    return Compensated(
        seen.time,
        np.concatenate(wrench, axis=1),
        np.concatenate(spread, axis=1),
        seen.rotation[:, 0],
        seen.point[:, 0],
    )
