"""Which convention was mistaken: readings are ranked, the best are fitted, and one is believed."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention, ResidualModel
from tactile_dynamics_ros.core.discrepancy.search import DiagnosisConfig
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import noise_floor
from tactile_dynamics_ros.core.discrepancy.verdict.validation import HeldOut, fits_equally, held_out
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.inertia.conventions.poses import falling, write_direction
from tactile_dynamics_ros.core.inertia.conventions.ranking import (
    ALIKE,
    Ranked,
    Ranking,
    Readings,
)
from tactile_dynamics_ros.core.inertia.conventions.reading import CONVENTIONS, Reading
from tactile_dynamics_ros.core.options import FINITE, Numbers
from tactile_dynamics_ros.core.streams.streams import Streams

Fit = Callable[[Streams], ResidualModel]
_FitReading = Callable[[Reading], tuple[ResidualModel, HeldOut] | None]

_CERTAIN = 60.0
"""-2 log likelihood by which the best reading must be better than the recording as it is: chance
among 250 readings makes 11 (2 log 250), errors that last for ten samples ten times as much of what
is left per sample. At 20 a motion that tells nothing may be read otherwise, at 200 short recordings
of slow loggers are not."""
_LARGE = 0.9
"""Fall of what is left, in logarithms summed over force and torque and over both rankings (the load
alone, and beside other forces), from which a reading is believed although something else remains.
A strong spring of 200 recordings with one effect makes a reading gain 0.6 of the load alone and
nothing beside other forces, a push beside a true mistake leaves it 0.8 and 0.4."""
_OUTDONE = 0.25
"""Fall, in logarithms, by which another reading may be better beside other forces at most: rankings
differ by 0.02 where nothing is mistaken. Of two mistakes, gravity and a sign, either of them makes
lengths in mm look better than the recording as it is, since accelerations then count for nothing;
other forces stand for gravity and leave the sign. Above 1 such lengths are believed."""
_WORSE = 0.1
"""Rise of what is left in one channel, in logarithms, up to which such a reading is believed: what
is meant improves them all, what imitates an effect takes from the forces what it gives to the
torques. At 0.8 turned axes imitate a strong drag."""
_HOPELESS = 1.0
"""Loss of the best reading, in logarithms (a factor of e of what is left), beyond which effects are
not admitted to look again: what fits so much worse than the recording as it is owes it to no
effect. At 0 mistakes that an effect hides stay unnoticed; larger spends the time of a second
ranking on recordings that say what they mean."""
_LEVELS = DiagnosisConfig()
"""Levels as for effects: a reading is believed that leaves at most `near_floor` over the noise
floor and explains `mostly` of the excess error. At mostly = 0.99 a delay of clocks beside a
mistaken sign hides it; lower, readings are believed that only imitate an effect."""
_OTHER_FORM = 0.5
"""Difference of scores up to which other forms of the best reading are fitted: a factor of 1.6, by
which noise of accelerations may flatter one. At 0.1 positions in cm are read in mm."""
_FORMS = 2
"""Other forms of the best reading (as other units of one quantity) that are fitted at least, where
there are any: those next to it, which noise may have put behind it. With none the first form stands
unchecked; each more takes a fit from the five (`_FITTED`) that readings of other names need too."""
_FITTED = 5
"""Readings that are fitted thoroughly, at most: the best and the commonest of those that leave
about as little. More cost a fit each; with the best alone a rare unit hides a common one that a
slow motion does not tell from it."""
_AS_WELL = 1.02
"""Held-out errors whose ratio is below this are equal, if the blocks agree: as an effect that makes
no more of a difference is immaterial. At 1.1 factors of two of a torque's unit are not told."""


@dataclass(frozen=True)
class _Fitted:
    ranked: Ranked
    model: ResidualModel
    held_out: HeldOut

    @property
    def error(self) -> float:
        return self.held_out.rms

    @property
    def reading(self) -> Reading:
        return self.ranked.reading


def find_convention(streams: Streams, recorded: float, fit: Fit) -> Convention | None:
    """Find out whether a recording uses another convention than it says.

    Args:
        streams: as recorded.
        recorded: held-out error of the model of the recording as it is.
        fit: makes the model of streams.

    Returns:
        The convention, with the model of the recording read right; None where no reading is
        clearly better.
    """

    @cache
    def fit_reading(reading: Reading) -> tuple[ResidualModel, HeldOut] | None:
        try:
            model = fit(reading.apply(streams))
        except (TactileDynamicsError, np.linalg.LinAlgError):
            return None
        return model, held_out(model)

    readings = Readings.of(streams)
    if readings.alone.gain < -_HOPELESS:
        return None
    found = _believe(readings.alone, readings, recorded, fit_reading)
    return found or _believe(readings.disturbed, readings, recorded, fit_reading)


def _believe(
    ranking: Ranking, readings: Readings, recorded: float, fit: _FitReading
) -> Convention | None:
    """The best of the readings, if it is to be believed."""
    if not _is_certain(ranking):
        return None
    fitted = _fit_best(ranking, readings, fit)
    if not fitted:
        return None
    least = min(fitted, key=lambda one: one.error)
    noise = _leaves_noise(least)
    equal = [
        one
        for one in fitted
        if _is_equal(least, one)
        or (not noise and _ranks_equal(least.reading, one.reading, readings))
    ]
    best = equal[0]
    if not _explains(best, recorded) and not _is_large(best.reading, ranking, readings):
        return None
    others = dict.fromkeys(one.reading.name for one in equal[1:])
    names = tuple(name for name in others if name != best.reading.name)
    return Convention(best.reading.name, _change(best, equal), best.model, best.error, names)


def assumed(streams: Streams, name: str) -> tuple[Streams, Reading]:
    """The recording read as a named convention says, in the form that fits it best.

    Args:
        streams: as recorded.
        name: one of `CONVENTIONS`; ``gravity_direction=X,Y,Z`` sets the direction.

    Raises:
        BadInputError: there is no such convention, or this recording cannot be read so.
    """
    if name.startswith("gravity_direction="):
        reading = _stated_gravity(name)
        return reading.apply(streams), reading
    if name not in CONVENTIONS:
        raise BadInputError(f"--assume {name}: expected one of {', '.join(CONVENTIONS)}")
    ranked = Readings.of(streams, (name,)).alone.ranked
    if not ranked:
        raise BadInputError(
            f"--assume {name}: nothing in this recording can be read so; see docs/diagnosis.md"
        )
    reading = _commonest(ranked)[0].reading
    return reading.apply(streams), reading


def _stated_gravity(words: str) -> Reading:
    """Gravity along the direction that the user states.

    Raises:
        BadInputError: it is none.
    """
    try:
        direction = np.array(Numbers(FINITE, 3)(words.partition("=")[2]))
    except ArgumentTypeError:
        direction = np.zeros(3)
    if not direction.any():
        raise BadInputError(
            f"--assume {words}: expected three numbers, as gravity_direction=0,-1,0"
        )
    direction = direction / np.linalg.norm(direction)
    return falling(f"along {write_direction(direction)}", direction)


def _is_certain(ranking: Ranking) -> bool:
    """Whether the best reading is better than the recording as it is by more than chance."""
    if not ranking.ranked:
        return False
    return ranking.gain * 2.0 * ranking.ranked[0].balance.rows > _CERTAIN


def _commonest(ranked: Sequence[Ranked]) -> list[Ranked]:
    """Readings that leave as little as the best, in the order in which they are common."""
    near = [one for one in ranked if one.score <= ranked[0].score + ALIKE]
    return sorted(near, key=lambda one: one.rarity)


def _fit_best(ranking: Ranking, readings: Readings, fit: _FitReading) -> list[_Fitted]:
    """The best readings, fitted thoroughly, the commonest first.

    None where the best leaves more than noise and is not better by enough for that.
    """
    found: list[_Fitted] = []
    for one in _worth_fitting(ranking.ranked):
        model = fit(one.reading)
        if model is None:
            continue
        found.append(_Fitted(one, *model))
        if len(found) < 2 or any(map(_leaves_noise, found)):
            continue
        if not _is_large(ranking.ranked[0].reading, ranking, readings):
            return []
    return sorted(found, key=lambda fitted: fitted.ranked.rarity)


def _worth_fitting(ranked: Sequence[Ranked]) -> list[Ranked]:
    """The best reading, the best of other forms of it, and the commonest that leave as little.

    Noise of accelerations that a reading makes smaller flatters it where the motion is slow: mm
    look better than the cm that are meant, until they are fitted thoroughly.
    """
    first = ranked[0]
    forms: dict[float, Ranked] = {}
    for one in ranked[1:]:
        if one.reading.name == first.reading.name and one.score <= first.score + _OTHER_FORM:
            forms.setdefault(round(one.score, 6), one)
    common = [one for one in _commonest(ranked) if one is not first]
    found = [first, *list(forms.values())[:_FORMS], *common]
    return list({id(one): one for one in found}.values())[:_FITTED]


def _is_equal(best: _Fitted, other: _Fitted) -> bool:
    """Whether a reading predicts held-out blocks as well as the best does."""
    close = other.error <= _AS_WELL * best.error
    return close and fits_equally(best.held_out, other.held_out)


def _ranks_equal(best: Reading, other: Reading, readings: Readings) -> bool:
    """Whether another convention leaves as little; forms of one are identified by their fits."""
    return other.name != best.name and readings.ranks_equal(best, other)


def _explains(best: _Fitted, recorded: float) -> bool:
    """Whether a reading leaves noise and explains the error."""
    floor = noise_floor(best.model)
    left, excess = best.error**2 - floor**2, recorded**2 - floor**2
    return _leaves_noise(best) and left <= (1.0 - _LEVELS.mostly) * excess


def _is_large(reading: Reading, ranking: Ranking, readings: Readings) -> bool:
    """Whether a convention leaves a fraction of what was, and no other does beside other forces."""
    if ranking.loss > _WORSE:
        return False
    alone = readings.alone.gain_of(reading.name)
    disturbed = readings.disturbed.gain_of(reading.name)
    if disturbed < readings.disturbed.gain - _OUTDONE:
        return False
    return max(alone, 0.0) + max(disturbed, 0.0) >= _LARGE


def _leaves_noise(fitted: _Fitted) -> bool:
    return fitted.error <= _LEVELS.near_floor * noise_floor(fitted.model)


def _change(best: _Fitted, equal: Sequence[_Fitted]) -> str:
    """What is done to read the recording right, and what would do as well under the same name."""
    same = [one for one in equal if one.reading.name == best.reading.name and one is not best]
    texts = dict.fromkeys(one.reading.change for one in same)
    if not texts:
        return best.reading.change
    return f"{best.reading.change} (as well: {'; '.join(texts)})"
