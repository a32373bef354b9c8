"""The door to estimates of arms by their joint torques: `estimate(recording, effects)`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contract import central_differences
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.conventions import refuse_degrees
from tactile_dynamics_ros.core.joints.live import KnownArm
from tactile_dynamics_ros.core.joints.model import JointsModel
from tactile_dynamics_ros.core.joints.samples import JointSamples
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    com_inertia_jacobian,
    dynamic_parameters_from_log_cholesky,
    inertia_matrix,
    log_cholesky,
)
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams

NAMES = (
    *("mass", "com_x", "com_y", "com_z"),
    *("inertia_xx", "inertia_xy", "inertia_yy", "inertia_xz", "inertia_yz", "inertia_zz"),
)
"""Names of the ten numbers, in the order of `com_inertia_jacobian`."""
_MASS_SHARE, _MASS_LEAST = 0.3, 0.05
"""Std of the mass from which it is undetermined: 30 % of it, and 5 % of what the arm can carry. A
payload known to 30 % is no answer; an empty flange known to 5 % is."""
_CENTRE = 0.03
"""Std of the centre from which it is undetermined, m: a third of the size of usual payloads."""
_INERTIA_SHARE = 0.5
"""Std of I_ij over sqrt(I_ii I_jj) from which it is undetermined: half of it is no answer."""
_RADIUS = 0.05
"""Radius of gyration from which the search for a body that can exist begins, m: a small box."""
_SMALLEST = 0.01
"""Mass from which that search begins where the fit has less, kg; it must be positive."""
_STEP = 1e-6
"""Step of central differences of log-Cholesky coordinates, whose size is one."""
_SHEAR, _LOG_RADIUS = 2.0, 1.5
"""Prior std of the log-Cholesky coordinates about the small box: a factor of 4.5 in each radius and
no preferred axes, as for held objects. They count where the arm tells nothing."""
_MOVED = 0.05
"""Range of a joint's positions below which it has not moved, rad or m: friction and bodies are then
one constant."""
_ROUNDS, _NEAR, _LEAST_GAIN = 5, 0.05, 0.2
"""Rounds in which unknown gains of drives are taken out of efforts at most; gains from 1 at which
that ends, since torques then follow them in proportion; and the least gain that a round takes."""
_DOUBTS = ("rotor_inertia", "load_dependent_friction", "joint_elasticity")
"""Effects that a pair of recordings does not cancel, as they grow with the payload, and rotors,
which windup would pass for. They may be there whether the error shows them or not, so that the
payload's interval has them."""
_FREE_SHARE = 0.4
"""How far a URDF's bodies may be off beside a recording without the payload, which tells them
better: as far as any URDF is, so that whatever the model misses in both goes to the links and not
to the payload."""


@dataclass(frozen=True, eq=False)
class Payload:
    """What the flange carries, in the flange's frame.

    Attributes:
        phi: (10,) dynamic parameters of a body that can exist.
        covariance: (10, 10) of them.
        flange: name of the frame.
        largest: prior std of the mass, kg: what the arm can carry.
    """

    phi: Array
    covariance: Array
    flange: str
    largest: float

    @classmethod
    def of(cls, model: JointsModel) -> Payload:
        """The payload of a fitted model.

        The normal posterior of the ten parameters, restricted to bodies that can exist; all
        ten share the doubt of the common scale of drives that report currents.
        """
        given, covariance = model.bodies[-10:], model.bodies_covariance()[-10:, -10:]
        largest = float(model.basis.root[-10, -10])
        phi, covariance = _possible(given, covariance)
        covariance = covariance + model.scale_std**2 * np.outer(phi, phi)
        return cls(phi, covariance, model.samples.arm.flange, largest)

    @cached_property
    def body(self) -> InertialParameters:
        """Mass, centre and inertia about it."""
        return InertialParameters.from_dynamic_parameters(self.phi)

    @cached_property
    def std(self) -> Array:
        """(10,) of mass, centre and inertia about it."""
        jacobian = com_inertia_jacobian(self.phi)
        return np.sqrt(np.maximum(np.diag(jacobian @ self.covariance @ jacobian.T), 0.0))

    @cached_property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the numbers that the recording does not tell."""
        mass, std = self.body.mass, self.std
        if std[0] > max(_MASS_SHARE * mass, _MASS_LEAST * self.largest):
            return NAMES
        if mass < 3.0 * std[0]:
            return NAMES[1:]
        size = np.sqrt(np.diag(self.body.inertia_com))
        of_size = inertia_matrix(std[4:]) / np.maximum(np.outer(size, size), 1e-12)
        rows, columns = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
        unknown = np.concatenate(
            [[False], std[1:4] > _CENTRE, of_size[rows, columns] > _INERTIA_SHARE]
        )
        return tuple(name for name, one in zip(NAMES, unknown, strict=True) if one)

    def to_document(self) -> dict[str, Any]:
        """Each number with its standard deviation."""
        return {
            "frame": self.flange,
            "mass": {"value": self.body.mass, "std": float(self.std[0])},
            "com": {"value": self.body.com.tolist(), "std": self.std[1:4].tolist()},
            "inertia_com": {
                "value": self.body.inertia_com.tolist(),
                "std": inertia_matrix(self.std[4:]).tolist(),
            },
            "undetermined": list(self.undetermined),
        }


@dataclass(frozen=True, eq=False)
class JointsEstimate:
    """Friction of each joint, the payload, effects, and what is undetermined.

    Attributes:
        model: fitted.
        streams: the recording, with the payload if there are two.
        compared: whether a recording without the payload stood beside it.
    """

    model: JointsModel
    streams: JointStreams
    compared: bool = False

    @cached_property
    def payload(self) -> Payload:
        """What the flange carries beyond what the URDF says."""
        return Payload.of(self.model.tempered(_DOUBTS) if self.compared else self._tempered)

    @cached_property
    def _tempered(self) -> JointsModel:
        return self.model.tempered()

    @cached_property
    def error(self) -> float:
        """Error over the noise, 1 where only noise remains."""
        return float(np.sqrt(np.mean(self.model.residual**2)))

    @cached_property
    def gains(self) -> dict[str, dict[str, Any]]:
        """N m per unit of each drive where efforts were in its own units; else empty."""
        model, taken = self._tempered, self.model.samples.gain_taken
        stated = self.streams.gains
        if stated is None or "torque_gain" not in self.table:
            return {}
        values = stated / np.exp(taken) / model.drive_gains
        entries = [e["std"] for e in self.table["torque_gain"].values()]
        stds = values * np.hypot(entries, model.scale_std)
        return {
            name: {"value": float(value), "std": float(std), "unit": "N m per unit"}
            for name, value, std in zip(self.model.joints, values, stds, strict=True)
        }

    @property
    def still(self) -> tuple[str, ...]:
        """Joints that hardly moved."""
        samples = self.model.samples
        reach = np.ptp(samples.q.reshape(-1, samples.q.shape[2]), axis=0)
        pairs = zip(samples.arm.names, reach, strict=True)
        return tuple(name for name, one in pairs if one < _MOVED)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of what the recording does not tell."""
        own = [f"{name}.{kind}" for name in self.still for kind in ("coulomb", "viscous", "offset")]
        return (*(f"payload.{name}" for name in self.payload.undetermined), *own)

    @cached_property
    def table(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Parameters of joints and effects by name."""
        return self._tempered.parameters()

    def to_document(self) -> dict[str, Any]:
        """The document of `estimate`."""
        arm, table = self.model.samples.arm, self.table
        errors = self.model.residuals().physical
        return {
            "model": "joints",
            "samples": len(self.streams.time),
            "duration_s": self.streams.duration,
            "payload": self.payload.to_document(),
            "compared_without_load": self.compared,
            "joints": [
                {
                    "name": name,
                    **table[name],
                    "noise": float(noise),
                    "error": float(np.sqrt(np.mean(errors[:, k] ** 2))),
                }
                for k, (name, noise) in enumerate(
                    zip(arm.names, self.model.effort_std, strict=True)
                )
            ],
            "drive_gains": self.gains,
            "urdf_off_by": self.model.basis.share,
            "undetermined": list(self.undetermined),
            "effects": {effect.name: table[effect.name] for effect in self.model.effects},
            "error": self.error,
        }


def fit(
    streams: JointStreams,
    effects: Sequence[str] = (),
    without: JointStreams | None = None,
    flange: str = "",
    known_load: float | None = None,
) -> JointsModel:
    """Fit the model of an arm to a recording.

    Args:
        streams: with the payload, if any.
        effects: names, with readings.
        without: the same arm without the payload; the same motion cancels what the model misses.
        flange: link whose frame the payload is told in; found by its name if empty.
        known_load: mass of the payload, kg, if it was weighed: tells the drives' gains.

    Raises:
        BadInputError: there is no URDF, it is of another arm, an effect is unknown, or positions
            are no radians.
        NotIdentifiableError: a recording is too short.
    """
    if not streams.urdf:
        raise BadInputError("joints: no URDF of the arm; give it by --urdf FILE")
    active = np.ptp(streams.effort, axis=0) > 0.0
    if not active.any():
        raise BadInputError("joints: all efforts are constant; the driver reports no torques")
    names = [name for name, one in zip(streams.names, active, strict=True) if one]
    arm = Arm.from_urdf(streams.urdf, names, "the arm's URDF", flange)
    refuse_degrees(streams, arm)
    samples = JointSamples.from_streams(streams, arm)
    share = None
    if without is not None:
        empty = JointSamples.from_streams(without, arm)
        empty = replace(empty, loaded=np.zeros(len(empty.time), dtype=bool))
        share = _FREE_SHARE if samples.gain_std is None or known_load else None
        samples = JointSamples.join([empty, samples])
    model = JointsModel.fit(samples, effects, share, known_load)
    for _ in range(_ROUNDS if samples.gain_std is not None else 0):
        gains = model.tempered().drive_gains
        if np.abs(gains - 1.0).max() < _NEAR:
            break
        samples = samples.without_gains(np.maximum(gains, _LEAST_GAIN))
        model = JointsModel.fit(samples, effects, share, known_load)
    return model


def estimate(
    streams: JointStreams,
    effects: Sequence[str] = (),
    without: JointStreams | None = None,
    flange: str = "",
    known_load: float | None = None,
) -> JointsEstimate:
    """Estimate friction, payload and effects of an arm; arguments as of `fit`."""
    model = fit(streams, effects, without, flange, known_load)
    return JointsEstimate(model, streams, without is not None)


def refit(streams: JointStreams, effects: Sequence[str], known: KnownArm) -> KnownArm:
    """Fit an arm with effects to what was measured last; nothing may have touched it.

    Args:
        streams: measured.
        effects: names, with readings.
        known: the model that has been used.

    Raises:
        BadInputError: an effect is unknown.
        NotIdentifiableError: it moved too little, or the effects lower no error.
    """
    model = fit(streams, effects)
    still = JointsEstimate(model, streams).still
    if model.too_short or still:
        why = model.too_short or f"{', '.join(still)} hardly moved"
        raise NotIdentifiableError(f"{', '.join(effects)}: {why}")
    found = model.known
    before, after = (one.error(model.samples, model.effort_std) for one in (known, found))
    if after >= before:
        raise NotIdentifiableError(
            f"with {', '.join(found.labels)} the error is {after:.2f} times the noise, "
            f"{before:.2f} by the model so far, which is kept"
        )
    return found


def _possible(given: Array, covariance: Array) -> tuple[Array, Array]:
    """The likeliest body that can exist, and the covariance about it.

    minimise (phi(xi) - given)^T C^-1 (phi(xi) - given) + |xi - xi_0|^2_prior over log-Cholesky xi.
    """
    mass = max(float(given[0]), _SMALLEST)
    centre = np.clip(given[1:4] / mass, -4.0 * _RADIUS, 4.0 * _RADIUS)
    box = InertialParameters(mass, centre, 0.8 * mass * _RADIUS**2 * np.eye(3))
    start = log_cholesky(box.pseudo_inertia)
    scale = np.sqrt(np.diag(covariance))
    whitening = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(scale, scale))) / scale
    wide = np.array([np.inf, *[_LOG_RADIUS] * 3, *[_SHEAR] * 3, *[np.inf] * 3])

    def rows(xi: Array) -> tuple[Array, Array]:
        by_xi = central_differences(dynamic_parameters_from_log_cholesky, xi, np.full(10, _STEP))
        misfit = whitening @ (dynamic_parameters_from_log_cholesky(xi) - given)
        prior = (xi - start) / wide
        return np.append(misfit, prior), np.concatenate([whitening @ by_xi, np.diag(1.0 / wide)])

    xi, _ = levenberg_marquardt(rows, start, 200, 1e-10)
    by_xi = central_differences(dynamic_parameters_from_log_cholesky, xi, np.full(10, _STEP))
    system = rows(xi)[1]
    inside = by_xi @ np.linalg.pinv(system.T @ system) @ by_xi.T
    return dynamic_parameters_from_log_cholesky(xi), inside
