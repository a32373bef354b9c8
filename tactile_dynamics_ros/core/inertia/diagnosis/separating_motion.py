"""The motion, or the re-grasp, after which effects that look alike can be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.held.gravity import load_regressor
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.excitation.design import (
    DesignConfig,
    DesignedMotion,
    design_motion,
    wrench_covariance,
)
from tactile_dynamics_ros.core.inertia.excitation.limits import Grip, MotionLimits
from tactile_dynamics_ros.core.inertia.excitation.plan import RECORDED_HZ
from tactile_dynamics_ros.core.inertia.excitation.trajectory import FourierOffsets, HeldPose
from tactile_dynamics_ros.core.numerics.least_squares import DECISIVE, chi_square_beside, refuted
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.diagnosis.quick_fit import WhitenedModel


_VAGUE = 1e-9
"""Information on each of the ten parameters of the body that rivals know before the new recording:
nearly none (standard deviations of 30000 kg, m, ...), since the new recording must tell on its own.
Above zero so that unexcited directions leave a matrix that can be inverted. Much larger would let
rivals know the body before the motion shows it."""
_RATE_HZ = 20.0
"""Rate at which candidate motions are evaluated, Hz: eight samples per period of the fastest sine
(2.5 Hz). The chosen one is evaluated again at `RECORDED_HZ`, since lags and delays look different
between coarse samples. Time is in proportion; at 5 Hz the fastest sine would not be seen at all."""
_FRICTION = 0.8
"""Coefficient of friction that is presumed of a grip, at least; what the recording shows to hold
raises it (`Grip.from_samples`). BioTac skin on an indenter has 0.78 in published calibrations. Less
scales motions down, more lets a grip slip."""
_REGRASP_ANGLE = 0.8
"""Turn, rad, of the contacts about the object's z axis in the re-grasp that is tried: 46 deg moves
a contact at 3 cm by 2 cm, far more than it is uncertain by. The sentence of the proposal names it.
Smaller turns separate fewer rivals, larger ones ask a hand for places that it may not reach."""
_BETWEEN_FINGERS = 1.0
"""Time, s, between the moves of two fingers in a re-grasp: one finger after the other, so that the
others hold. The criterion hardly depends on it. At zero no finger holds, at a tenth of the motion's
20 s and more the last finger moves near its end."""
_EFFORT = DesignConfig(
    duration=20.0, lowest_hz=0.15, highest_hz=2.5, sines=5, evaluations=100, grid_rate_hz=_RATE_HZ
)
"""Motions that are tried: 20 s, sines of 0.15 to 2.5 Hz, quicker than those that excite the inertia
(1.5 Hz) since lags and added masses show at high frequency. 100 evaluations bound the time of a
diagnosis; more find somewhat better motions."""
_LIMITS = MotionLimits(rotation=0.7, translation=0.08)
"""Size of the proposed motion, rad and m: ±40 deg and ±8 cm. Larger motions tell rivals apart
better, but fewer arms and cells have room for them."""
_TOGETHER = ", and ask about both recordings together"
"""End of the proposal's sentence: the motion completes what is there. A text: it changes what
people do, no number."""
_AXES = ("x", "y", "z")
"""Names of the world's axes in the proposal's sentence. Words for people, no number."""


@dataclass(frozen=True)
class Rival:
    """One explanation of the recording: load, effects and what is known of them.

    Attributes:
        phi: (10,).
        effects: with their parameters theta.
        theta: parameters of each effect.
        prior: (10 + k, 10 + k) information on [phi, theta] before the new recording: what is
            presumed, and what the present one tells of all that a new one shares with it.
    """

    phi: Array
    effects: tuple[Effect, ...]
    theta: tuple[Array, ...]
    prior: Array

    @classmethod
    def from_model(cls, model: WhitenedModel) -> Rival:
        """Read a fitted model."""
        learned = _learned(model, [effect.per_session for effect in model.effects])
        return cls._of(model, model.effects, model.theta, learned)

    @classmethod
    def readings_of(cls, model: WhitenedModel) -> tuple[Rival, ...]:
        """A fitted model, and the same with what its last effect could be in another recording.

        There it may need other fingers than here, and axes that look alike here may differ. What
        the present recording tells of the body, it tells beside the fitted reading only.
        """
        *others, last = model.effects
        *thetas, fitted = model.theta
        names = [p.name for p in last.parameters(model.samples)]
        known = dict(zip(names, fitted, strict=True))
        rivals = [cls.from_model(model)]
        for reading in last.freest():
            if reading.label == last.label:
                continue
            theta = [known.get(p.name, 0.0) for p in reading.parameters(model.samples)]
            effects, values = (*others, reading), (*thetas, np.array(theta))
            unknown = np.zeros((10 + sum(len(value) for value in values),) * 2)
            rivals.append(cls._of(model, effects, values, unknown))
        return tuple(rivals)

    @classmethod
    def _of(
        cls,
        model: WhitenedModel,
        effects: tuple[Effect, ...],
        theta: tuple[Array, ...],
        learned: Array,
    ) -> Rival:
        stds = [p.prior_std for e in effects for p in e.parameters(model.samples)]
        presumed = np.concatenate([np.full(10, _VAGUE), np.array(stds, dtype=float) ** -2.0])
        return cls(model.phi, effects, theta, np.diag(presumed) + learned)

    def wrench(self, samples: WrenchSamples) -> Array:
        """Contact wrench (N, 6) that this explanation predicts: Y phi - Delta."""
        present = PresentEffects(self.effects, self.theta)
        return np.asarray(load_regressor(samples) @ self.phi - present.wrench(samples, self.phi))

    def columns(self, samples: WrenchSamples) -> Array:
        """Derivative (N, 6, 10 + k) of that wrench."""
        present = PresentEffects(self.effects, self.theta)
        by_phi = load_regressor(samples)
        for part in present.inertia_jacobians(samples, self.phi):
            by_phi = by_phi - part
        return np.concatenate([by_phi, *(-c for c in present.jacobians(samples, self.phi))], axis=2)


@dataclass(frozen=True)
class SeparationCriterion:
    """How little rivals would fail where the best is right, in a new recording.

    Smaller is better: minus the sum of chi^2 over the rivals, each counted up to twice what is
    decisive, with chi^2 = min_b min_d |W^-1/2 (w_a - w_b - G_b d)|^2 + d^T H_b d, w the predicted
    wrenches, b the readings of a rival, G_b their derivatives and H_b their prior. A rival that
    contains the best can only be less simple, which no motion changes. The new recording completes
    the present one: both are asked together, and what they share (body and effects, not biases)
    keeps what was learned. Source: Box, Hill 1967, on discrimination among mechanistic models.

    Motions are sought at a lower rate than that of a recording; what the best one promises is
    evaluated at the latter, since between coarse samples a lag differs from a delay for no reason.

    Attributes:
        best: what is taken to be right.
        others: readings of each rival.
        force_std: N.
        rate_hz: rate of the samples.
        session_starts: of samples of the new recording; as many as effects have parameters for.
    """

    best: Rival
    others: tuple[tuple[Rival, ...], ...]
    force_std: float
    rate_hz: float = _RATE_HZ
    session_starts: tuple[float, ...] = ()

    def __call__(self, *parts: WrenchSamples) -> float:
        """Evaluate the criterion for a recording of one or more parts."""
        return -float(np.minimum(self.gaps(*parts), 2.0 * DECISIVE).sum())

    def gaps(self, *parts: WrenchSamples) -> Array:
        """Expected chi^2 that each of the others leaves, (rivals,), of a recording at 100 Hz."""
        parts = tuple(replace(p, session_starts=self.session_starts) for p in parts)
        covariances = [wrench_covariance(samples, self.force_std) for samples in parts]
        factors = [np.asarray(np.linalg.cholesky(c), dtype=np.float64) for c in covariances]
        expected = [self.best.wrench(samples) for samples in parts]

        def gap(other: Rival) -> float:
            rows = []
            for samples, factor, wrench in zip(parts, factors, expected, strict=True):
                differs = wrench - other.wrench(samples)
                both = np.concatenate([differs[..., None], other.columns(samples)], axis=2)
                rows.append(np.linalg.solve(factor, both).reshape(-1, both.shape[2]))
            white = np.sqrt(RECORDED_HZ / self.rate_hz) * np.concatenate(rows)
            return chi_square_beside(white[:, 0], white[:, 1:], other.prior)

        return np.array([min(map(gap, readings)) for readings in self.others])


def _learned(model: WhitenedModel, forgotten: Sequence[bool]) -> Array:
    """Information (10 + k, 10 + k) of a recording on [phi, theta], without that on some effects.

    J^T J per unit of what the model leaves; parameters that a new recording does not share are
    eliminated (Schur complement).

    Args:
        model: fitted.
        forgotten: of each effect.
    """
    residual, jacobian = (part[: len(model.time)] for part in model.evaluated)
    total = jacobian.T @ jacobian / max(1.0, float(np.mean(residual**2)))
    counts = [len(theta) for theta in model.theta]
    gone = np.concatenate([np.zeros(10, dtype=bool), np.repeat(list(forgotten), counts)])
    if not gone.any():
        return np.asarray(total)
    stds = [p.prior_std for e in model.effects for p in e.parameters(model.samples)]
    presumed = np.concatenate([np.zeros(10), np.array(stds, dtype=float) ** -2.0])
    own = total[np.ix_(gone, gone)] + np.diag(presumed[gone])
    across = total[np.ix_(~gone, gone)]
    kept = np.zeros_like(total)
    kept[np.ix_(~gone, ~gone)] = total[np.ix_(~gone, ~gone)] - across @ np.linalg.solve(
        own, across.T
    )
    return kept


def plan_separation(best: WhitenedModel, others: Sequence[WhitenedModel]) -> dict[str, Any] | None:
    """Find the motion after which rival explanations would differ, or the re-grasp that does it.

    Args:
        best: the model with the effect that was chosen.
        others: the same with the effects that cannot be distinguished from it.

    Returns:
        Kind, description in words, numbers, expected chi^2; None if nothing would help.
    """
    samples = best.samples
    rivals = tuple(Rival.readings_of(model) for model in others)
    sessions = (0.0,) + (np.inf,) * (samples.sessions - 1) if samples.session_starts else ()
    criterion = SeparationCriterion(
        Rival.from_model(best), rivals, _force_std(best), session_starts=sessions
    )
    try:
        grip = Grip.from_samples(samples, best.phi, _FRICTION)
        start = _start(samples)
        motion = design_motion(criterion, start, grip, best.phi, _LIMITS, None, _EFFORT)
    except TactileDynamicsError:
        return None
    times, names = _times(RECORDED_HZ), [model.effects[-1].name for model in others]
    recorded = replace(criterion, rate_hz=RECORDED_HZ)
    held = grip.load(start.follow(motion.offsets, times), best.phi)
    kind, gaps = "motion", recorded.gaps(held)
    told = refuted(names, gaps)
    if len(told) < len(names):
        parts = [
            stage.load(start.follow(motion.offsets, when), best.phi)
            for stage, when in _regrasp(grip, times)
        ]
        regrasped = recorded.gaps(*parts)
        if len(refuted(names, regrasped)) > len(told):
            kind, gaps, told = "regrasp", regrasped, refuted(names, regrasped)
    return _plan(kind, motion, told, float(gaps.max())) if told else None


def _times(rate_hz: float) -> Array:
    return np.arange(0.0, _EFFORT.duration, 1.0 / rate_hz)


def _force_std(model: WhitenedModel) -> float:
    """Typical noise of one force axis, N."""
    contacts = model.fitted.stretches[0].problem.contacts
    factors = [contact.signals["force"].noise_factor for contact in contacts]
    return float(np.median([np.sqrt(np.mean(f**2) * 3.0) for f in factors]))


def _start(samples: WrenchSamples) -> HeldPose:
    """The recorded pose nearest to the mean orientation."""
    mean = samples.rotation.mean(axis=0)
    nearest = int(np.argmin(np.sum((samples.rotation - mean) ** 2, axis=(1, 2))))
    position = samples.position.mean(axis=0)
    return HeldPose(samples.rotation[nearest], position, position)


def _regrasp(grip: Grip, times: Array) -> list[tuple[Grip, Array]]:
    """Grips and their times while one finger after the other moves, around half-time."""
    landed, count = _elsewhere(grip), len(grip.point)
    moves = 0.5 * _EFFORT.duration + _BETWEEN_FINGERS * (np.arange(count) - 0.5 * count)
    stages = []
    for stage, when in enumerate(np.split(times, np.searchsorted(times, moves))):
        moved = (np.arange(count) < stage)[:, None]
        point, normal, squeeze = (
            np.where(moved, getattr(landed, name), getattr(grip, name))
            for name in ("point", "normal", "squeeze")
        )
        stages.append((replace(grip, point=point, normal=normal, squeeze=squeeze), when))
    return stages


def _elsewhere(grip: Grip) -> Grip:
    """Hand with its contacts turned about the object's z axis and moved along it."""
    turn = exp_so3(np.array([0.0, 0.0, _REGRASP_ANGLE]))
    shift = 0.3 * float(np.linalg.norm(grip.point, axis=1).mean()) * np.array([0.0, 0.0, 1.0])
    return replace(
        grip,
        point=grip.point @ turn.T + shift,
        normal=grip.normal @ turn.T,
        squeeze=grip.squeeze @ turn.T,
    )


def _plan(kind: str, motion: DesignedMotion, told: list[str], gap: float) -> dict[str, Any]:
    text = _describe_motion(motion) if kind == "motion" else _describe_regrasp()
    return {
        "kind": kind,
        "description": text,
        "separates_from": told,
        "expected_chi_square": gap,
        "grip_usage": motion.grip_usage,
        **_table(motion.offsets),
    }


def _describe_motion(motion: DesignedMotion) -> str:
    peaks = np.abs(motion.offsets.evaluate(_times(_RATE_HZ))).max(axis=0)
    turns = [f"{_AXES[k]} by ±{np.degrees(peaks[k]):.0f} deg" for k in range(3)]
    shifts = [f"{_AXES[k]} by ±{100 * peaks[3 + k]:.0f} cm" for k in range(3)]
    rates = motion.offsets.frequency_hz
    return (
        f"turn the object about world {', '.join(turns)} and shift it along "
        f"{', '.join(shifts)}, sums of sines of {rates[0]:.2g} to {rates[-1]:.2g} Hz for "
        f"{motion.offsets.duration:.0f} s{_TOGETHER}"
    )


def _describe_regrasp() -> str:
    return (
        "while the object moves, let one finger after the other grasp it at another point (all of "
        f"them, for instance turned by {np.degrees(_REGRASP_ANGLE):.0f} deg about it and moved "
        "along it), all in one recording; no motion with one grasp separates them" + _TOGETHER
    )


def _table(offsets: FourierOffsets) -> dict[str, Any]:
    return {
        "duration_s": offsets.duration,
        "ramp_s": offsets.ramp,
        "channels": ["turn_x", "turn_y", "turn_z", "shift_x", "shift_y", "shift_z"],
        "frequency_hz": offsets.frequency_hz.tolist(),
        "sine": offsets.sine.tolist(),
        "cosine": offsets.cosine.tolist(),
    }
