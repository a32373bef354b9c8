"""Motion, contacts and forces of one object on a common time grid."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import cross

GRAVITY_W = np.array([0.0, 0.0, -9.81])
"""Acceleration of gravity, m/s^2, world axes (z up). One value for all places: the true one differs
by up to 0.3 % from it, and estimated masses by as much. One that is larger makes masses smaller in
proportion."""

Value = TypeVar("Value")
Given = ParamSpec("Given")


@dataclass(frozen=True, eq=False)
class WrenchSamples:
    """Motion and contacts that the Newton-Euler equations need, at N instants and C contacts.

    Everything except position, rotation, velocity and acceleration is in the body frame O.
    Absent contacts have zero force and ``in_contact`` False.

    Attributes:
        time: (N,) s.
        position: (N, 3) p_WO, m.
        rotation: (N, 3, 3) R_WO.
        velocity: (N, 3) velocity of the body origin, world axes, m/s.
        acceleration: (N, 3) acceleration of the body origin, world axes, m/s^2.
        angular_velocity: (N, 3) rad/s, body axes.
        angular_acceleration: (N, 3) rad/s^2, body axes.
        contact_names: C names.
        contact_point: (N, C, 3) m, body frame.
        contact_rotation: (N, C, 3, 3) R_OC; column z is the normal into the object.
        contact_force: (N, C, 3) N on the object, body frame.
        contact_torque: (N, C, 3) N m about the contact point, body frame.
        in_contact: (N, C).
        gravity: (3,) m/s^2, world axes.
        session_starts: s, when each of several joined recordings begins; empty for one.
        external: (N, 6) known wrench on the object beside those of the contacts, body frame;
            None for none.
        torque_measured: False where torques are what a body needs that one force sensor carries.
        motion: samples with the same motion and contacts from which `with_forces` or
            `with_external` made these; `dataclasses.replace` forgets it.
    """

    time: Array
    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    angular_velocity: Array
    angular_acceleration: Array
    contact_names: tuple[str, ...]
    contact_point: Array
    contact_rotation: Array
    contact_force: Array
    contact_torque: Array
    in_contact: NDArray[np.bool_]
    gravity: Array
    external: Array | None = None
    session_starts: tuple[float, ...] = ()
    torque_measured: bool = True
    motion: WrenchSamples | None = field(default=None, init=False)

    @property
    def sessions(self) -> int:
        """Number of recordings that are joined."""
        return max(len(self.session_starts), 1)

    @cached_property
    def session(self) -> NDArray[np.int64]:
        """(N,) which of the recordings each sample is of, from 0."""
        later = np.array(self.session_starts[1:])
        return np.searchsorted(later, self.time, side="right").astype(np.int64)

    @cached_property
    def session_time(self) -> Array:
        """(N,) s since the recording of each sample began."""
        starts = np.array(self.session_starts or (0.0,))
        return np.asarray(self.time - starts[self.session])

    def with_forces(self, force: Array, torque: Array | None = None) -> WrenchSamples:
        """Samples of this motion with other forces, (N, C, 3), and torques if given."""
        torques = self.contact_torque if torque is None else torque
        return self._on_same_motion(replace(self, contact_force=force, contact_torque=torques))

    def with_external(self, wrench: Array) -> WrenchSamples:
        """Samples with a known external wrench, (N, 6)."""
        return self._on_same_motion(replace(self, external=wrench))

    def _on_same_motion(self, changed: WrenchSamples) -> WrenchSamples:
        object.__setattr__(changed, "motion", self.motion or self)
        return changed

    @cached_property
    def specific_acceleration(self) -> Array:
        """R_OW (a_O - g), (N, 3) m/s^2 in the body frame."""
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, self.acceleration - self.gravity))

    @cached_property
    def measured_wrench(self) -> Array:
        """Sum of the contact wrenches about the body origin, (N, 6) [torque, force]."""
        torque = cross(self.contact_point, self.contact_force) + self.contact_torque
        return np.concatenate([torque.sum(axis=1), self.contact_force.sum(axis=1)], axis=1)


def once_per_samples(
    function: Callable[Concatenate[WrenchSamples, Given], Value],
) -> Callable[Concatenate[WrenchSamples, Given], Value]:
    """Remember what a function makes of samples, and of hashable arguments, while they exist."""
    known: WeakKeyDictionary[WrenchSamples, dict[Hashable, Value]] = WeakKeyDictionary()

    @wraps(function)
    def remembered(
        samples: WrenchSamples, /, *arguments: Given.args, **options: Given.kwargs
    ) -> Value:
        found = known.setdefault(samples, {})
        key = (arguments, tuple(options.items()))
        if key not in found:
            found[key] = function(samples, *arguments, **options)
        return found[key]

    return remembered


def latest_per_samples(
    function: Callable[Concatenate[WrenchSamples, Given], Value],
) -> Callable[Concatenate[WrenchSamples, Given], Value]:
    """Remember what a function makes of samples and of the latest arguments it got with them."""
    known: WeakKeyDictionary[WrenchSamples, tuple[Hashable, Value]] = WeakKeyDictionary()

    @wraps(function)
    def remembered(
        samples: WrenchSamples, /, *arguments: Given.args, **options: Given.kwargs
    ) -> Value:
        key = (arguments, tuple(options.items()))
        found = known.get(samples)
        if found is None or found[0] != key:
            found = known[samples] = key, function(samples, *arguments, **options)
        return found[1]

    return remembered


def once_per_motion(
    function: Callable[Concatenate[WrenchSamples, Given], Value],
) -> Callable[Concatenate[WrenchSamples, Given], Value]:
    """`once_per_samples` for functions that forces and torques do not concern."""
    return _of_motion(once_per_samples(function))


def latest_per_motion(
    function: Callable[Concatenate[WrenchSamples, Given], Value],
) -> Callable[Concatenate[WrenchSamples, Given], Value]:
    """`latest_per_samples` for functions that forces and torques do not concern."""
    return _of_motion(latest_per_samples(function))


def _of_motion(
    remembered: Callable[Concatenate[WrenchSamples, Given], Value],
) -> Callable[Concatenate[WrenchSamples, Given], Value]:
    """Let all samples of one motion share what a function has remembered."""

    @wraps(remembered)
    def shared(samples: WrenchSamples, /, *arguments: Given.args, **options: Given.kwargs) -> Value:
        return remembered(samples.motion or samples, *arguments, **options)

    return shared
