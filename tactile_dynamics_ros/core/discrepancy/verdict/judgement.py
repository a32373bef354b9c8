"""Is a model adequate, and may its estimates be used? Decided here once, for every verb."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import Assessment, assess
from tactile_dynamics_ros.core.discrepancy.verdict.materiality import (
    Trace,
    find_trace,
    is_near_floor,
)
from tactile_dynamics_ros.core.errors import NotIdentifiableError

FAR = 1.3
"""Error over the stated noise from which the estimates of a model that is not adequate are no
answer: 70 % more variance than the sensors state. Clean recordings have 0.97 to 1.01 (three held,
five pushed); a leaning table that leaves 1.49 makes a friction force known to 0.3 % uncertain by 21
%. Lower refuses numbers that small effects move by less than their intervals, higher hands on such
as the latter."""

_PROMISING = 0.5
"""Share of the excess error that an effect must promise to be looked for in an error within the
uncertainty that the sensors report. A diagnosis names one there that explains 0.6 (`beside_stated`)
once it is fitted thoroughly, which may find a little more than the test promises. Lower costs
minutes of search that end where they began, higher passes over effects that would be named."""


@dataclass(frozen=True)
class Judgement:
    """What the tests of a residual say of its model.

    Attributes:
        assessment: of the model.
    """

    assessment: Assessment

    @cached_property
    def trace(self) -> Trace | None:
        """What is significant and does not matter; None where nothing is, or where it may."""
        return None if self.assessment.white else find_trace(self.assessment)

    @property
    def adequate(self) -> bool | None:
        """Whether nothing that matters is missing; None where only a search for effects tells.

        It may find something in an error next to the noise floor, and in one within the uncertainty
        that the sensors report, if any effect promises to explain most of it.
        """
        found = self.assessment
        if found.white or self.trace is not None:
            return True
        if found.within_stated:
            return None if self._is_promising else True
        return None if is_near_floor(found) else False

    def require_length(self) -> None:
        """Check that the recording is long enough for "adequate" to mean anything.

        Raises:
            NotIdentifiableError: it is not.
        """
        if text := self.assessment.model.too_short:
            raise NotIdentifiableError(text)

    @property
    def _is_promising(self) -> bool:
        """Whether the test of an effect promises that it explains most of the excess error."""
        found = self.assessment
        excess = found.rms**2 - found.structure.floor**2
        gain = max((score.gain for score in found.scores), default=0.0)
        return gain > _PROMISING * excess * len(found.model.residual)


def judge(model: ResidualModel, significance: float = 0.01) -> Judgement:
    """Test a fitted model.

    Args:
        model: fitted.
        significance: family-wise level of the adequacy test.
    """
    return Judgement(assess(model, significance))
