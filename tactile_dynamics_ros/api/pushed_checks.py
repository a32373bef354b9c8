"""Is a recording of pushes fit for an estimate, and which pushes would make it so?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
from tactile_dynamics_ros.api.readiness import GOAL, Readiness, lost_faults
from tactile_dynamics_ros.api.result import Rows
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.excitation.addition import WORTH
from tactile_dynamics_ros.core.planar.actions.affordances import ExploreConfig
from tactile_dynamics_ros.core.planar.actions.continuation import continued
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    SensingConfig,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.core.planar.properties.optimum import VARIATIONS
from tactile_dynamics_ros.core.planar.properties.push_model import USUAL_UNEVENNESS
from tactile_dynamics_ros.recording.rates import StreamRate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.recording.pushed import PushedRecording

_LATE, _CERTAIN = 5e-3, 5.0
"""Difference of clocks, s, and standard deviations, from which it is a fault: smaller ones are
estimated with everything else and are in the intervals."""
_FAST, _SLOW = 0.3, 0.1
"""Speeds of pushes that are proposed, m/s: as fast as arms push where the mass is unknown, which
only acceleration shows; else such that hardly any arm objects."""
_MOST = 6
"""Pushes that are proposed at most; a goal that takes more needs other sensors."""
_UNSHOWN_VARIATION = (
    "these pushes do not show whether friction differs from place to place; where it does, what is "
    "promised may come twice as wide"
)
"""Said of promises for tables that may be even: on ones that vary by 10 % six such masses came 1.1
to 2.0 times as wide as promised, eleven where the likeliest table varies 0.5 to 1.3 times."""
_SEED = 0
"""Of the noise of the simulated push: the same recording gets the same answer."""


class Found(Protocol):
    """An estimate of one or two parts."""

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of what the recording does not determine."""

    @property
    def error(self) -> float | None:
        """Whitened RMS, 1 where only noise remains; None without a fit."""

    def to_document(self) -> dict[str, Any]:
        """JSON of the estimate."""


@dataclass(frozen=True)
class Addition:
    """A push to make as well, and what it would bring.

    Attributes:
        choice: the push. count: how many of its kind.
        relative: (4,) standard deviation over size after them, as `PushedCheck.relative`.
    """

    choice: Choice
    count: int
    relative: tuple[float, ...]

    @property
    def many(self) -> str:
        """How many pushes, in words."""
        return "another push" if self.count == 1 else f"{self.count} such pushes"

    @property
    def words(self) -> str:
        """How to make it, in the frame of the object."""
        candidate = self.choice.candidate
        x, y = 1e3 * candidate.point
        heading = np.degrees(np.arctan2(*candidate.direction[::-1]))
        return (
            f"at ({x:.0f}, {y:.0f}) mm of its outline towards {heading:.0f} deg in its own frame, "
            f"over {1e3 * candidate.length:.0f} mm from rest to rest at {candidate.acceleration:g} "
            f"m/s^2 and at most {candidate.speed:g} m/s"
        )

    def to_json(self, pose: Array) -> dict[str, Any]:
        """Plain numbers, with point and direction in the world."""
        travel = self.choice.candidate.travel
        ramps = {"acceleration": travel.acceleration, "braking": travel.stopping}
        return {**self.choice.to_json(pose), **ramps, "count": self.count}


@dataclass(frozen=True, repr=False)
class PushedCheck(Readiness):
    """What a recording of pushes determines, what is wrong with it, and which pushes to add.

    Attributes:
        recording: of one or two parts.
        found: estimate from the recording as it is.
        addition: push to make as well; None where nothing can be promised.
    """

    recording: PushedRecording
    found: Found
    addition: Addition | None

    @property
    def source(self) -> str:
        """Where the recording came from."""
        return self.recording.source

    @property
    def duration(self) -> float:
        """Length of the recording, s."""
        return self.recording.duration

    @property
    def relative(self) -> dict[str, float]:
        """Standard deviation over size; of centres of mass over the footprint's gyration."""
        shares = {}
        links = self.found.to_document()["links"]
        for k, link in enumerate(links):
            of = f" of link_{k + 1}" if len(links) > 1 else ""
            for name, words in (("friction_force_n", "friction force"), ("mass", "mass")):
                shares[words + of] = float(link[name]["std"] / abs(link[name]["value"]))
            reach = _reach(self.recording, k)
            for axis, std in zip("xy", link["com"]["std"], strict=True):
                shares[f"centre of mass along {axis}{of}"] = float(std / reach)
        return shares

    @property
    def lacking(self) -> list[str]:
        """Parameters that are not known as well as wanted."""
        return [name for name, share in self.relative.items() if not share <= self.goal]

    @property
    def promised(self) -> dict[str, float]:
        """`relative` after what is proposed; empty without it."""
        if self.addition is None:
            return {}
        return dict(zip(self.relative, self.addition.relative, strict=True))

    def to_json(self) -> dict[str, Any]:
        """Return the document of `check`."""
        unknown = self.found.undetermined
        pose = self.recording.streams.links[0].pose[-1]
        return super().to_json() | {
            "error": self.found.error,
            "undetermined": list(unknown),
            "parameters": {name: {"relative": share} for name, share in self.relative.items()},
            "addition": self.addition and self.addition.to_json(pose),
            "expected_relative": self.promised,
        }

    def describe(self, name: str) -> str:
        """Return a parameter in words, as it is named."""
        return name

    def advice(self) -> list[str]:
        """Return what is not known, and what to push as well."""
        helps = any(self._helps(name) for name in self.lacking)
        push = [f"push {self.addition.words}"] if self.addition and helps else []
        return [*(self._known(name) for name in self.lacking), *push]

    def rows(self) -> Rows:
        """Return how well each parameter is known, now and after the proposed pushes."""
        count = self.addition.count if self.addition else 0
        head = ("parameter", "std over size", f"after {count} more pushes")
        after = self.promised
        return [
            head,
            *(
                (name, f"{share:.1%}", f"{after[name]:.1%}" if after else "")
                for name, share in self.relative.items()
            ),
        ]

    def draw(self) -> Figure:
        """Draw what is known now, after the proposed pushes, and what is wanted."""
        from matplotlib.figure import Figure as NewFigure

        figure = NewFigure(layout="constrained")
        axes = figure.add_subplot()
        shares = self.relative
        axes.barh(list(shares), [100.0 * s for s in shares.values()], label="now")
        if self.promised:
            after = [100.0 * s for s in self.promised.values()]
            axes.barh(list(shares), after, label="after what is proposed")
        axes.axvline(100.0 * self.goal, label="wanted", color="black", linestyle="--")
        axes.set_xlabel("standard deviation over size, %")
        axes.legend()
        return figure

    def _known(self, name: str) -> str:
        now = f"{name} is known to {100.0 * self.relative[name]:.2g} %"
        if self.addition is None:
            return now
        if not self._helps(name):
            return f"{now}; no push that was tried in simulation narrows it"
        after = 100.0 * self.promised[name]
        return f"{now}; {self.addition.many} would bring it to {after:.2g} %"

    def _helps(self, name: str) -> bool:
        """Whether what is proposed determines a parameter clearly better."""
        return self.promised.get(name, np.inf) <= WORTH * self.relative[name]


def check_pushes(recording: PushedRecording, goal: float = GOAL) -> PushedCheck:
    """Check a recording of a pushed object; see `PushedCheck`.

    Raises:
        BadInputError: nothing is touched while poses are known.
        NotIdentifiableError: it slides too little, or the fit does not come to an end.
    """
    asked = EstimateOfPushes.of(recording)
    found, rates = asked.found, _rates(recording)
    faults = lost_faults(rates)
    remarks = recording.problem_lines()
    addition = None
    if isinstance(found, PushedEstimate):
        (remarks if found.is_uneven else faults).extend(_clock_faults(found))
    if asked.misfit:
        (faults if asked.is_far else remarks).append(asked.misfit)
    if asked.fits and isinstance(found, PushedEstimate):
        addition = _addition(recording, found, goal)
        if addition is not None and _evenness_is_unknown(found):
            remarks.append(_UNSHOWN_VARIATION)
    elif asked.fits:
        remarks.append(
            "of two parts no push is promised; `diagnose` proposes those that separate models"
        )
    return PushedCheck(rates, tuple(faults), tuple(remarks), goal, recording, found, addition)


def _rates(recording: PushedRecording) -> tuple[StreamRate, ...]:
    """Rates of poses with their gaps, and of forces, which pause between pushes."""
    streams = recording.streams
    many = len(streams.links) > 1
    rates = [
        StreamRate.of(f"pose of link_{k}" if many else "object's pose", link.time)
        for k, link in enumerate(streams.links, 1)
    ]
    for name, contact in streams.contacts.items():
        rate = StreamRate.of(f"force of {name} while it touches", contact.time)
        rates.append(replace(rate, gaps=0, longest_gap_s=0.0, lost_share=0.0))
    return tuple(rates)


def _clock_faults(found: PushedEstimate) -> list[str]:
    """Return a sentence if forces and poses seem to be stamped on clocks that differ."""
    late, std = found.delay or (0.0, np.inf)
    if abs(late) < max(_LATE, _CERTAIN * std):
        return []
    other = ", or something else is missing" if found.is_uneven else ""
    return [
        f"the stamps of forces and poses seem to differ by {1e3 * late:.1f} ± {1e3 * std:.1f} ms "
        f"(effect time_offset){other}; `diagnose` finds out whether it is the clocks"
    ]


def _addition(recording: PushedRecording, found: PushedEstimate, goal: float) -> Addition | None:
    """The push that determines most of what is missing; None if nothing is or no push does."""
    streams, reach = recording.streams, _reach(recording, 0)
    masses = found.covariance[1, 1] > goal**2
    config = ExploreConfig(
        speeds=(_FAST if masses else _SLOW,),
        least=1,
        product=goal,
        mass=goal,
        com=float(np.clip(goal * reach, 1e-4, 0.1)),
    )
    thing = _thing(recording)
    explorer = Explorer(thing, config, _sensing(recording))
    force, mass = (found.values[name][0] for name in ("friction_force_n", "mass"))
    com = [found.values[name][0] for name in ("com_x", "com_y")]
    mean = np.array([np.log(force / -streams.gravity[2]), np.log(mass), *com])
    belief = Belief(mean, found.covariance)
    choice = explorer.choose(belief, streams.links[0].pose[-1])
    if isinstance(choice, str):
        return None
    longer = continued(streams, thing, belief, choice.candidate, np.random.default_rng(_SEED))
    try:
        after = estimate(longer)
    except TactileDynamicsError:
        return None
    assert isinstance(after, PushedEstimate)
    return _promise(choice, found, after, np.array([1.0, 1.0, reach, reach]), goal)


def _promise(
    choice: Choice, found: PushedEstimate, after: PushedEstimate, size: Array, goal: float
) -> Addition:
    """Return how many pushes to make and what they bring, from an estimate with one of them.

    What the pushes tell of the places that they meet adds up, 1 / s^2 = 1 / s_now^2 + n gained. By
    how much friction differs elsewhere they do not tell: the larger of both estimates stays.

    Args:
        choice: the push.
        found: estimate from the recording.
        after: estimate with one push more, simulated on an even table.
        size: (4,) of the parameters.
        goal: standard deviation over size that is wanted.
    """
    (now, far), (then, farther) = (_variances(each, size) for each in (found, after))
    elsewhere = np.maximum(far, farther)
    gained = np.maximum(1.0 / then - 1.0 / now, 0.0)
    within = goal**2 - elsewhere
    reachable = (now > within) & (within > 0.0)
    with np.errstate(divide="ignore"):
        wanted = np.ceil((1.0 / within - 1.0 / now)[reachable] / gained[reachable])
    count = int(min(np.max(wanted, initial=1.0), _MOST))
    std = np.sqrt(1.0 / (1.0 / now + count * gained) + elsewhere)
    return Addition(choice, count, tuple(float(s) for s in std))


def _variances(found: PushedEstimate, size: Array) -> tuple[Array, Array]:
    """Variances (4,) over size^2 at the places that were pushed, and of others about those."""
    here = found.covariance if found.here is None else found.here
    own, whole = (np.diag(matrix) / size**2 for matrix in (here, found.covariance))
    return own, whole - own


def _evenness_is_unknown(found: PushedEstimate) -> bool:
    """Whether an even table is likeliest, and one that varies about as likely."""
    elsewhere = _variances(found, np.ones(len(found.covariance)))[1]
    is_wide = bool(elsewhere[0] > (0.99 * USUAL_UNEVENNESS) ** 2)
    return found.unevenness <= VARIATIONS[0] and is_wide


def _thing(recording: PushedRecording) -> PredictedObject:
    streams = recording.streams
    outline = convex_hull(np.asarray(streams.links[0].footprint, dtype=float))
    height = float(np.median(np.concatenate([c.point[:, 2] for c in streams.contacts.values()])))
    com_height = streams.com_height[0] if streams.com_height is not None else height
    return PredictedObject(outline, push_height=height, com_height=com_height)


def _sensing(recording: PushedRecording) -> SensingConfig:
    """Rates as they are in the recording; noise of poses as it is stated, or usual."""
    streams = recording.streams
    link = streams.links[0]
    rate = max(StreamRate.of("", c.time).rate_hz for c in streams.contacts.values())
    std = link.presumed_pose_std
    return SensingConfig(
        force_rate_hz=rate,
        pose_rate_hz=StreamRate.of("", link.time).rate_hz,
        pose_std=float(std[0]),
        turn_std=float(std[2]),
    )


def _reach(recording: PushedRecording, link: int) -> float:
    """Radius of gyration of a part's footprint, m."""
    outline = np.asarray(recording.streams.links[link].footprint, dtype=float)
    return float(np.sqrt(SupportPatch(outline).gyration))
