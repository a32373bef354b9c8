"""Is the model adequate? Effects of the catalogue and structure of any kind, with one p-value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from tactile_dynamics_ros.core.discrepancy.model.residual_model import (
    Misfit,
    ResidualModel,
    instants,
)
from tactile_dynamics_ros.core.discrepancy.screening import Score, adjusted_p_value, screen
from tactile_dynamics_ros.core.discrepancy.structure import (
    Structure,
    examine,
    noise_floors,
    periodogram,
    window_starts,
)
from tactile_dynamics_ros.core.discrepancy.structure import noise_floor as spectral_floor

_NOISE_TOLERANCE = 0.25
"""Share by which white noise may exceed what the sensors report and still count as reported well.
Beyond it the verdict is `unexplained`, with the advice to correct the noise. The floor itself is
known to 1 % from 15 s at 100 Hz; half and twice the share changed no verdict of 57 (21 synthetic
probes, 36 slides of a block)."""
_WHITE_PART = 0.9
"""White RMS of the noise from which nothing is left for errors that last: reported noise has
variance 1, and a fifth of it may last below. White noise alone stays above 0.96 (four standard
deviations of its floor, six channels, 15 s at 100 Hz), so that it is given no excuse."""
_LASTING_QUANTILE = 0.95
"""Quantile of the mean square of errors that last up to which they count as reported: of honest
sensors one recording in twenty exceeds it. 0.9 and 0.975 changed no verdict of the 57."""
_MOST_OF_A_SECOND = 2.0
"""Mean square of the worst second over the limit of the whole up to which errors last: those that
do are about as large at all times, bursts are not. At 1, two of eight slides with such errors
became `unexplained`; at 4 nothing changed, but a burst may then be four times what is reported."""
_WINDOW = 1.0
"""Length of these seconds, s: shorter than errors that last, and 600 white numbers at 100 Hz, whose
mean square scatters by 6 %. Half and twice as long changed no verdict of the 57."""
_SLOW_HZ = 5.0
"""Frequency above which the spectrum is looked at for more than noise, Hz. Errors that
follow the motion of a synthetic recording end at 2 Hz; half and twice the frequency changed no
verdict of 16 examples (7 probes, 9 slides)."""
_FAST_SHARE = 0.25
"""Share of the errors that last that may lie above it: skins that creep and give way err at up to
a dozen hertz where the motion is quick, a hum of the size of the reported noise must not pass
(both in `test_lasting_errors`). Half and twice the share changed no verdict of 16."""
_FLOOR_TOLERANCE = 0.04
"""Difference of the floor from 1 up to which the noise is as reported, so that no other noise need
be tried: nearly four standard deviations of the floor of 15 s at 100 Hz and six channels. Lower
tries other noise where none is needed, which costs fits; higher keeps intervals that are off by as
much."""
_CHANNEL_TOLERANCE = 0.15
"""Difference of one channel's floor from 1 up to which its noise is as reported: nearly six
standard deviations, since a channel has a sixth of the numbers. Lower costs fits where chance moved
one channel, higher overlooks an axis whose noise is reported wrongly."""


@dataclass(frozen=True)
class Assessment:
    """Difference between a model's residual and the noise that was stated.

    Attributes:
        model: that was tested.
        structure: of the residual itself.
        significance: p-values below it count.
        names: effects to be scored; all that the model lacks by default.
    """

    model: ResidualModel
    structure: Structure
    significance: float
    names: tuple[str, ...] | None = None

    @cached_property
    def rms(self) -> float:
        """White RMS of the residual."""
        return Misfit.of(self.model).rms

    @cached_property
    def scores(self) -> tuple[Score, ...]:
        """Score tests of all effects that could be added."""
        families = self.model.families(self.names)
        return tuple(screen(self.model, families, self.structure.floor))

    @property
    def lasting_is_stated(self) -> bool:
        """Whether the uncertainty that the sensors report is more than their white noise."""
        return self.structure.floor < _WHITE_PART

    @cached_property
    def within_stated(self) -> bool:
        """Whether sensors account for the residual by what they state.

        That can be more than white noise, such as gains of sensors that are off for good.
        """
        return is_within_stated(self.model, self.structure.floor)

    @cached_property
    def p_value(self) -> float:
        """Probability that an adequate model leaves such a residual, corrected for all tests."""
        return min(1.0, 2.0 * adjusted_p_value(self.scores), 2.0 * self.structure.p_value)

    @property
    def noise_stated_well(self) -> bool:
        """Whether the noise is within 25 % of what was stated (or below it)."""
        return self.structure.floor <= 1.0 + _NOISE_TOLERANCE

    @property
    def white(self) -> bool:
        """Whether the residual is the white noise that was stated."""
        if 2.0 * self.structure.p_value < self.significance or not self.noise_stated_well:
            return False
        return self.p_value >= self.significance

    @property
    def adequate(self) -> bool:
        """Whether nothing is seen to be missing, given what the sensors report."""
        return self.white or self.within_stated


def assess(
    model: ResidualModel,
    significance: float = 0.01,
    names: Sequence[str] | None = None,
) -> Assessment:
    """Test a fitted model.

    Args:
        model: to be tested.
        significance: family-wise level.
        names: effects to be scored; all that the model lacks by default.
    """
    structure = examine(*instants(model))
    return Assessment(model, structure, significance, None if names is None else tuple(names))


def is_within_stated(model: ResidualModel, floor: float) -> bool:
    """Whether sensors state more than white noise of RMS `floor`, and may leave such a residual.

    Beyond the white noise they are few, so that their mean square scatters like chi^2 with as many
    degrees of freedom; no second exceeds twice that; and they are slow: above 5 Hz there is no more
    than a quarter of them.
    """
    limit = stated_limit(model, floor)
    if limit is None:
        return False
    time, white = instants(model)
    square = (white**2).mean(axis=1)
    starts = window_starts(time, _WINDOW)
    seconds = np.add.reduceat(square, starts) / np.diff(np.append(starts, len(time)))
    if square.mean() > limit or seconds.max() > _MOST_OF_A_SECOND * limit:
        return False
    spectrum = periodogram(time, white)
    fast = spectrum.power[spectrum.hz > _SLOW_HZ]
    return bool(fast.size == 0 or fast.mean() <= floor**2 + _FAST_SHARE * (1.0 - floor**2))


def stated_limit(model: ResidualModel, floor: float) -> float | None:
    """Mean square up to which a residual is what sensors state; None if that is white noise alone.

    Args:
        model: fitted.
        floor: white RMS of the noise alone.
    """
    if floor >= _WHITE_PART:
        return None
    freedom = model.lasting_freedom
    scatter = float(chdtri(freedom, 1.0 - _LASTING_QUANTILE)) / freedom
    return floor**2 + (1.0 - floor**2) * scatter


def noise_floor(model: ResidualModel) -> float:
    """White RMS of the noise alone, by the spectrum of the residual."""
    return spectral_floor(periodogram(*instants(model)))


def noise_is_as_stated(model: ResidualModel) -> bool:
    """Whether the noise alone has a white RMS of 1, of all channels and about so of each."""
    spectrum = periodogram(*instants(model))
    each = np.abs(noise_floors(spectrum) - 1.0)
    all_of_them = abs(spectral_floor(spectrum) - 1.0)
    return bool(all_of_them < _FLOOR_TOLERANCE and each.max() < _CHANNEL_TOLERANCE)
