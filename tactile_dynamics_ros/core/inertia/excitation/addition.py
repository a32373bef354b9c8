"""Which further seconds of motion would bring a parameter within its goal, in plain words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.batch import fit_body
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.inertia.excitation.continuation import Continuation
from tactile_dynamics_ros.core.inertia.excitation.design import wrench_information
from tactile_dynamics_ros.core.inertia.excitation.trajectory import CHANNELS, FourierOffsets
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    com_inertia_jacobian,
    inertia_vector,
)
from tactile_dynamics_ros.core.streams.joining import join_streams

DURATION = 10.0
"""Length of a proposed motion, s: ten periods of 1 Hz. Longer promises more, with its root, and
asks more of people; shorter spends most of it on starting and stopping."""
_RAMP = 1.0
"""Time over which a proposed motion starts and ends, s: a period of 1 Hz. Shorter jerks the grip,
longer leaves less of the motion."""
_TURNS_DEG = (30.0, 15.0)
"""Angles of proposed turns, deg: wrists of arms and people turn that far to both sides; half of it
where the grip would slip. Wider tells more and leaves more arms behind."""
_SHIFT = 0.05
"""Way of proposed shifts to both sides, m, as in `MotionLimits`. Farther tells more of the mass and
leaves small workspaces."""
_FREQUENCIES_HZ = (1.0, 0.5, 0.2)
"""Frequencies of proposed motions, Hz. Angular accelerations grow with the square: 1 Hz by 30 deg
is 20 rad/s^2, which hands and small arms do; the slow ones are for weights that a fast turn would
tear off, and tell the centre of mass as well."""
_SQUEEZES = (1.0, 1.5, 2.0, 3.0)
"""Grips, over the present one, that may be asked for so that no finger slips more than it was seen
to bear. More than three times crushes things; with 1 alone a grip that just held what was recorded
bears nothing more."""
_GRID_HZ = 20.0
"""Rate at which candidates are ranked, Hz: twenty samples per period of the fastest. The chosen one
is judged at the recording's own rates."""
WORTH = 0.8
"""Promised over present standard deviation up to which a motion is proposed. At 1 motions are
proposed that change nothing but by chance of the simulated noise, lower keeps silent about help."""


@dataclass(frozen=True)
class SimpleMotion:
    """A sine about one axis of the object, as people can follow it.

    Attributes:
        axis: 0 to 2, of the object.
        is_turn: a turn, or a shift.
        amplitude: rad or m, to both sides.
        frequency_hz: of the sine.
    """

    axis: int
    is_turn: bool
    amplitude: float
    frequency_hz: float

    def offsets(self, rotation: Array) -> FourierOffsets:
        """Offsets in world axes for an object with rotation R_WO (3, 3)."""
        sine = np.zeros((CHANNELS, 1))
        first = 0 if self.is_turn else 3
        sine[first : first + 3, 0] = self.amplitude * rotation[:, self.axis]
        frequency = np.array([self.frequency_hz])
        return FourierOffsets(DURATION, frequency, sine, np.zeros_like(sine), _RAMP)

    @property
    def words(self) -> str:
        """The motion in words."""
        axis, rate = "xyz"[self.axis], f"at {self.frequency_hz:g} Hz"
        if self.is_turn:
            return f"turning about {axis} by {np.degrees(self.amplitude):.0f} deg {rate}"
        return f"shifting along {axis} by {100.0 * self.amplitude:.0f} cm {rate}"


@dataclass(frozen=True)
class Addition:
    """A motion to record as well, and what it is expected to bring.

    Attributes:
        parameter: of PARAMETER_NAMES, for which it was chosen.
        motion: of the object.
        squeeze: how hard to grip, over the present grip.
        offsets: the motion as offsets in world axes.
        std: (10,) expected standard deviations afterwards, in the order of PARAMETER_NAMES.
        undetermined: parameters that are expected to stay undetermined.
    """

    parameter: str
    motion: SimpleMotion
    squeeze: float
    offsets: FourierOffsets
    std: Array
    undetermined: tuple[str, ...] = ()

    def tells(self, parameter: str) -> bool:
        """Whether a parameter is expected to be determined afterwards."""
        return parameter not in self.undetermined

    @property
    def promised(self) -> float:
        """Expected standard deviation of the parameter afterwards."""
        return float(self.std[PARAMETER_NAMES.index(self.parameter)])

    @property
    def words(self) -> str:
        """The motion in words, and how hard to grip meanwhile."""
        harder = "" if self.squeeze == 1.0 else f", gripping {self.squeeze:g} times as hard"
        return self.motion.words + harder

    def to_json(self) -> dict[str, Any]:
        """The motion as people and as controllers take it, with all expected deviations."""
        return {
            "parameter": self.parameter,
            "description": self.words,
            "squeeze": self.squeeze,
            "duration_s": self.offsets.duration,
            "ramp_s": self.offsets.ramp,
            "frequency_hz": self.offsets.frequency_hz.tolist(),
            "sine": self.offsets.sine.tolist(),
            "cosine": self.offsets.cosine.tolist(),
            "expected_std": dict(zip(PARAMETER_NAMES, self.std.tolist(), strict=True)),
            "undetermined": list(self.undetermined),
        }


def parameter_sizes(estimate: InertialEstimate) -> Array:
    """Sizes (10,) of the parameters: m, the radius of gyration, of I_ij sqrt(I_ii I_jj)."""
    body = estimate.inertia
    moments = np.diag(body.inertia_com)
    radius = float(np.sqrt(0.5 * moments.sum() / body.mass))
    radii = np.sqrt(moments)
    products = inertia_vector(np.outer(radii, radii))
    return np.concatenate([[body.mass], np.full(3, radius), products])


def propose_additions(
    held: Continuation, estimate: InertialEstimate, goal: float, most: int = 3
) -> list[Addition]:
    """Find motions for the parameters that are farthest from their goal, one after the other.

    Each is chosen by its Fisher information among simple motions that the grip bears; what it
    brings is then estimated from the recording together with a simulated one of the motion.

    Args:
        held: the recording and how the object is held.
        estimate: from the recording.
        goal: standard deviation over `parameter_sizes` that is wanted.
        most: how many motions at most.

    Returns:
        Motions, each to be added alone; none where all is within the goal or nothing helps.
    """
    sizes = parameter_sizes(estimate)
    found: list[Addition] = []
    lacking = {
        name: float(ratio)
        for name, ratio in zip(PARAMETER_NAMES, estimate.parameter_std / sizes, strict=True)
        if ratio > goal or name in estimate.not_excited
    }
    while lacking and len(found) < most:
        worst = max(lacking, key=lambda name: lacking[name])
        addition = _best_for(worst, held)
        now = estimate.parameter_std[PARAMETER_NAMES.index(worst)]
        del lacking[worst]
        if addition is None or not addition.tells(worst) or addition.promised > WORTH * now:
            continue
        found.append(addition)
        met = dict(zip(PARAMETER_NAMES, addition.std <= goal * sizes, strict=True))
        lacking = {n: r for n, r in lacking.items() if not (met[n] and addition.tells(n))}
    return found


def _best_for(parameter: str, held: Continuation) -> Addition | None:
    """The simple motion that tells most of a parameter; None if no grip bears any."""
    index = PARAMETER_NAMES.index(parameter)
    known = np.linalg.inv(held.model.covariance[:10, :10])
    row = com_inertia_jacobian(held.model.phi)[index]
    time = np.arange(0.0, DURATION, 1.0 / _GRID_HZ)
    best, least = None, np.inf
    for motion in _candidates():
        offsets = motion.offsets(held.start.rotation)
        squeeze = next((f for f in _SQUEEZES if held.squeezed(f).holds(offsets, time)), None)
        if squeeze is None:
            continue
        gained = wrench_information(held.move(offsets, time), held.force_std)
        variance = float(row @ np.linalg.solve(known + gained, row))
        if variance < least:
            best, least = (motion, squeeze, offsets), variance
    if best is None:
        return None
    after = expected_estimate(held.squeezed(best[1]), best[2])
    return Addition(parameter, *best, after.parameter_std, after.not_excited)


def expected_estimate(
    held: Continuation, offsets: FourierOffsets, seed: int = 0
) -> InertialEstimate:
    """The estimate from the recording and a simulated recording of a motion together."""
    both = join_streams([held.streams, held.record(offsets, seed)])
    return fit_body(both).to_estimate()


def _candidates() -> Iterator[SimpleMotion]:
    for axis in range(3):
        for frequency in _FREQUENCIES_HZ:
            for angle in _TURNS_DEG:
                yield SimpleMotion(axis, True, float(np.radians(angle)), frequency)
            yield SimpleMotion(axis, False, _SHIFT, frequency)
