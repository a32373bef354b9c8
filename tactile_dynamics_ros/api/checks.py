"""Is a recording fit for an estimate, and what would make it so, while more can be recorded?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.discrepancies import Diagnosis
from tactile_dynamics_ros.api.estimates import GROSS_MISFIT, Estimate
from tactile_dynamics_ros.api.readiness import GOAL, Readiness, lost_faults
from tactile_dynamics_ros.api.result import Rows
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    describe_parameter,
)
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

_CERTAIN = 5.0
"""Standard deviations from which clocks are said to differ. Of honest intervals one in two million
is beyond; at 3 one recording of 400 would be blamed."""
_LATE = 2e-3
"""Difference of clocks, s, from which it is a fault: a fifth of a period of 100 Hz. Smaller ones
move estimates by less than their intervals."""
_EXPLAINED = 0.9
"""Share of the error beyond noise that an offset of clocks must explain to be believed, as the one
effect of a diagnosis. Lower blames a drag, which looks a little like a delay, on the clocks."""


@dataclass(frozen=True, repr=False)
class Check(Readiness):
    """What a recording of a held object determines, its faults, and what to record as well.

    Attributes:
        estimate: from the recording as it is.
        additions: motions to record as well, each alone.
    """

    estimate: Estimate
    additions: tuple[Addition, ...]

    @property
    def source(self) -> str:
        """Where the recording came from."""
        return self.estimate.recording.source

    @property
    def duration(self) -> float:
        """Length of the recording, s."""
        return self.estimate.recording.duration

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

    def to_json(self) -> dict[str, Any]:
        """Return the document of `check`."""
        found, unknown = self.estimate.found, self.estimate.undetermined
        return super().to_json() | {
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

    def describe(self, name: str) -> str:
        """Return a parameter in words."""
        return describe_parameter(name)

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

    def advice(self) -> list[str]:
        """Return a sentence on each parameter that is not known as well as wanted."""
        return [
            f"{describe_parameter(name)} {self._known(name)}{self._help(name)}"
            for name in self.lacking
        ]

    def _known(self, name: str) -> str:
        if name in self.estimate.undetermined:
            return "is not excited"
        return f"is known to {100 * self.relative[name]:.2g} %"

    def _help(self, name: str) -> str:
        """Return what a further motion would bring."""
        if not self.promises:
            return ""
        own = [a for a in self.additions if a.parameter == name]
        own = own or [a for a in self.additions if a.tells(name)]
        best = min(own, key=lambda a: self._promised(a, name), default=None)
        if best is None or self._promised(best, name) > WORTH * self.relative[name]:
            return f"; no simple motion of {DURATION:.0f} s that was tried in simulation narrows it"
        after = 100.0 * self._promised(best, name)
        more = f"{best.offsets.duration:.0f} s more {best.words}"
        comma = "," if best.squeeze != 1.0 else ""
        return f": {more}{comma} would bring it to {after:.2g} %"

    @property
    def promises(self) -> bool:
        """Whether the model fits, so that what a motion brings can be reported."""
        return self.estimate.fits

    def _promised(self, addition: Addition, name: str | None = None) -> float:
        """Expected standard deviation over size after a motion."""
        index = PARAMETER_NAMES.index(name or addition.parameter)
        now = self.estimate.found.parameter_std[index]
        return float(addition.std[index] / now * self.relative[PARAMETER_NAMES[index]])


def check_recording(recording: Recording, goal: float = GOAL) -> Check:
    """Check a recording of a held object; see `Check`."""
    from tactile_dynamics_ros.core.inertia.estimate import estimate
    from tactile_dynamics_ros.recording.rates import rests_between_gaps, stream_rates

    found = Estimate(recording, estimate(recording))
    rates = tuple(stream_rates(recording.streams))
    pose = recording.streams.pose
    lost = [] if pose is not None and rests_between_gaps(pose) else lost_faults(rates)
    faults = lost + _clock_faults(found)
    remarks = found.recording.problem_lines()
    if found.question.misfit:
        (faults if found.question.is_far else remarks).append(_misfit(found))
    return Check(rates, tuple(faults), tuple(remarks), goal, found, _additions(found, goal))


def _clock_faults(found: Estimate) -> list[str]:
    """Return a sentence if forces and motion seem to be stamped on clocks that differ."""
    from tactile_dynamics_ros.core.effects import create_effect
    from tactile_dynamics_ros.core.inertia.estimate import estimate

    try:
        with_offset = estimate(found.recording, [create_effect("time_offset")]).to_estimate()
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return []
    effect = with_offset.effects["time_offset"]
    ((name, offset),) = effect.value.items()
    std = effect.std[name]
    before, after = found.found.error.whitened_rms, with_offset.error.whitened_rms
    explained = before**2 - after**2 > _EXPLAINED * max(before**2 - 1.0, 0.0)
    if not explained or abs(offset) < max(_LATE, _CERTAIN * std):
        return []
    return [
        f"the stamps of forces and motion seem to differ by {1e3 * offset:.1f} ± {1e3 * std:.1f} "
        "ms (effect time_offset); `diagnose` finds out whether it is the clocks"
    ]


def _misfit(found: Estimate) -> str:
    """Return what is said of a model that does not fit: another unit or convention, if any."""
    plain = found.question.misfit
    if found.question.whitened_rms <= GROSS_MISFIT:
        return plain
    try:
        sentence = Diagnosis.of(found.question).document["sentence"]
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return plain
    return f"{plain}. It says: {sentence}"


def _additions(found: Estimate, goal: float) -> tuple[Addition, ...]:
    """Return motions to record as well; none where nothing can be promised."""
    if not found.fits:
        return ()
    try:
        held = Continuation.of(found.recording.streams, found.model)
        return tuple(propose_additions(held, found.found, goal))
    except (TactileDynamicsError, np.linalg.LinAlgError):
        return ()
