"""Is a recording fit for an estimate, and what would make it so, while more can be recorded?"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.discrepancies import Diagnosis
from tactile_dynamics_ros.api.estimates import GROSS_MISFIT, Estimate
from tactile_dynamics_ros.api.questions import question_held
from tactile_dynamics_ros.api.result import Result, Rows
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.excitation.addition import (
    DURATION,
    WORTH,
    Addition,
    parameter_sizes,
    propose_additions,
)
from tactile_dynamics_ros.core.inertia.excitation.continuation import Continuation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.rates import StreamRate

GOAL = 0.1
"""Standard deviation over the size of a parameter that is wanted if nothing else is said: inertia
to a tenth moves a controller's torques by as much. Less asks for more motion."""
_LOST = 0.05
"""Share of a stream's time in gaps from which that is a fault. Nothing is derived across a gap, so
that motion is lost with it; a twentieth costs as much of the recording."""
_CERTAIN = 5.0
"""Standard deviations from which clocks are said to differ. Of honest intervals one in two million
is beyond; at 3 one recording of 400 would be blamed."""
_LATE = 2e-3
"""Difference of clocks, s, from which it is a fault: a fifth of a period of 100 Hz. Smaller ones
move estimates by less than their intervals."""
_EXPLAINED = 0.9
"""Share of the error beyond noise that an offset of clocks must explain to be believed, as the one
effect of a diagnosis. Lower blames a drag, which looks a little like a delay, on the clocks."""
ADEQUATE = 1.3
"""Error over the noise from which it is said that the model lacks something, as in reports, and
from which nothing is promised: what a motion brings then depends on what is lacking."""


@dataclass(frozen=True)
class Check(Result):
    """What a recording tells, what is wrong with it, and what to record as well.

    Attributes:
        estimate: from the recording as it is.
        rates: of its streams.
        faults: sentences on what makes estimates wrong.
        remarks: sentences on what else should be known.
        additions: motions to record as well, each alone.
        goal: standard deviation over size that is wanted.
    """

    estimate: Estimate
    rates: tuple[StreamRate, ...]
    faults: tuple[str, ...]
    remarks: tuple[str, ...]
    additions: tuple[Addition, ...]
    goal: float = GOAL

    @property
    def relative(self) -> dict[str, float]:
        """Standard deviation over size by parameter."""
        found = self.estimate.found
        shares = found.parameter_std / parameter_sizes(found)
        return {name: float(share) for name, share in zip(PARAMETER_NAMES, shares, strict=True)}

    @property
    def lacking(self) -> list[str]:
        """Parameters that are not known as well as wanted."""
        unknown = self.estimate.undetermined
        return [n for n, share in self.relative.items() if share > self.goal or n in unknown]

    @property
    def ready(self) -> bool:
        """Whether nothing is wrong and everything is known as well as wanted."""
        return not self.faults and not self.lacking

    def to_json(self) -> dict[str, Any]:
        """Return the document of `check`."""
        found, unknown = self.estimate.found, self.estimate.undetermined
        return {
            "ready": self.ready,
            "goal": self.goal,
            "duration_s": self.estimate.recording.duration,
            "streams": [asdict(rate) for rate in self.rates],
            "faults": list(self.faults),
            "remarks": list(self.remarks),
            "error": found.error.to_json(),
            "parameters": {
                name: {
                    "std": float(std),
                    "relative": self.relative[name],
                    "determined": name not in unknown,
                }
                for name, std in zip(PARAMETER_NAMES, found.parameter_std, strict=True)
            },
            "additions": [
                addition.to_json() | {"expected_relative": self._promised(addition)}
                for addition in self.additions
            ],
        }

    def headline(self) -> str:
        """Return whether the recording is ready, and why not."""
        source = self.estimate.recording.source
        if self.ready:
            return f"{source}: ready, every parameter is known to {self.goal:.0%} or better"
        if self.faults:
            return f"{source}: not ready, {self.faults[0]}"
        names = ", ".join(describe_parameter(name) for name in self.lacking)
        return f"{source}: not ready, not known to {self.goal:.0%}: {names}"

    def lines(self) -> list[str]:
        """Return streams, faults, excitation and what to record as well."""
        return [
            f"{self.estimate.recording.source}: {self.estimate.recording.duration:.1f} s",
            *(f"  {rate.words}" for rate in self.rates),
            *(f"fault: {fault}" for fault in self.faults),
            *(f"note: {remark}" for remark in self.remarks),
            *self._excitation_lines(),
            "ready" if self.ready else "not ready",
        ]

    def rows(self) -> Rows:
        """Return how well each parameter is known, now and after the proposed motions."""
        body = []
        for name, share in self.relative.items():
            own = [a for a in self.additions if a.parameter == name]
            better = [f"{self._promised(a):.1%} after {a.words}" for a in own]
            now = "not excited" if name in self.estimate.undetermined else f"{share:.1%}"
            body.append((describe_parameter(name), now, "; ".join(better)))
        return [("parameter", "std over size", f"{DURATION:.0f} s more"), *body]

    def draw(self) -> Figure:
        """Draw how the estimate settles."""
        return self.estimate.draw()

    def _excitation_lines(self) -> list[str]:
        """Return a sentence on each parameter that is not known as well as wanted."""
        return [
            f"{describe_parameter(name)} {self._known(name)}{self._help(name)}"
            for name in self.lacking
        ]

    def _known(self, name: str) -> str:
        if name in self.estimate.undetermined:
            return "is not excited"
        return f"is known to +- {100 * self.relative[name]:.2g} %"

    def _help(self, name: str) -> str:
        """Return what a further motion would bring."""
        if not self.promises:
            return ""
        own = [a for a in self.additions if a.parameter == name]
        own = own or [a for a in self.additions if a.tells(name)]
        best = min(own, key=lambda a: self._promised(a, name), default=None)
        if best is None or self._promised(best, name) > WORTH * self.relative[name]:
            return f"; no simple motion of {DURATION:.0f} s helps"
        after = 100.0 * self._promised(best, name)
        more = f"{best.offsets.duration:.0f} s more {best.words}"
        comma = "," if best.squeeze != 1.0 else ""
        return f": {more}{comma} would bring it to +- {after:.2g} %"

    @property
    def promises(self) -> bool:
        """Whether the model fits, so that what a motion brings can be told."""
        return self.estimate.found.error.whitened_rms <= ADEQUATE

    def _promised(self, addition: Addition, name: str | None = None) -> float:
        """Expected standard deviation over size after a motion."""
        index = PARAMETER_NAMES.index(name or addition.parameter)
        now = self.estimate.found.parameter_std[index]
        return float(addition.std[index] / now * self.relative[PARAMETER_NAMES[index]])


def check_recording(recording: Recording, goal: float = GOAL) -> Check:
    """Check a recording of a held object; see `Check`."""
    from tactile_dynamics_ros.core.inertia.estimate import estimate
    from tactile_dynamics_ros.recording.rates import stream_rates

    found = Estimate(recording, estimate(recording))
    rates = tuple(stream_rates(recording.streams))
    faults = lost_faults(rates) + _clock_faults(found) + _unit_faults(found)
    return Check(found, rates, tuple(faults), tuple(_remarks(found)), _additions(found, goal), goal)


def describe_parameter(name: str) -> str:
    """Return a parameter of PARAMETER_NAMES in words."""
    kind, _, axes = name.partition("_")
    if kind == "mass":
        return "mass"
    if kind == "com":
        return f"centre of mass along {axes}"
    return f"inertia about {axes[0]}" if axes[0] == axes[1] else f"product of inertia {axes}"


def lost_faults(rates: tuple[StreamRate, ...]) -> list[str]:
    """Return a sentence on each stream that lost too much of its time in gaps."""
    return [
        f"{rate.name}: {rate.lost_share:.0%} of the time is lost in {rate.gaps} gaps"
        for rate in rates
        if rate.lost_share > _LOST
    ]


def _clock_faults(found: Estimate) -> list[str]:
    """Return a sentence if forces and motion seem to be stamped on clocks that differ."""
    from tactile_dynamics_ros.core.effects import create_effect
    from tactile_dynamics_ros.core.inertia.estimate import estimate

    try:
        with_offset = estimate(found.recording, [create_effect("time_offset")]).to_estimate()
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return []
    (effect,) = with_offset.effects.values()
    ((name, offset),) = effect.value.items()
    std = effect.std[name]
    before, after = found.found.error.whitened_rms, with_offset.error.whitened_rms
    explained = before**2 - after**2 > _EXPLAINED * max(before**2 - 1.0, 0.0)
    if not explained or abs(offset) < max(_LATE, _CERTAIN * std):
        return []
    return [
        f"the stamps of forces and motion seem to differ by {1e3 * offset:.1f} +- {1e3 * std:.1f} "
        "ms (effect time_offset); `diagnose` tells whether it is the clocks"
    ]


def _unit_faults(found: Estimate) -> list[str]:
    """Return a sentence if the model does not fit at all: another unit or convention, if any."""
    error = found.found.error.whitened_rms
    if error <= GROSS_MISFIT:
        return []
    plain = f"the model does not fit, the error is {error:.0f} times the noise"
    try:
        diagnosis = Diagnosis.of(question_held(found.recording))
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return [plain]
    return [f"{plain}: {diagnosis.document['sentence']}"]


def _remarks(found: Estimate) -> list[str]:
    error = found.found.error.whitened_rms
    lines = found.recording.problem_lines()
    if ADEQUATE < error <= GROSS_MISFIT:
        lines.append(
            f"the error is {error:.1f} times the noise: something acts that a rigid body "
            "has not, or the stated noise is too small; `diagnose` tells"
        )
    return lines


def _additions(found: Estimate, goal: float) -> tuple[Addition, ...]:
    """Return motions to record as well; none where nothing can be promised."""
    if found.found.error.whitened_rms > ADEQUATE:
        return ()
    try:
        held = Continuation.of(found.recording.streams, found.model)
        return tuple(propose_additions(held, found.found, goal))
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return ()
