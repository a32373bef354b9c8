"""One pushed object, live: the filter step by step, and what fits after its pushes tell."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.filter.change import Change, ChangeConfig, ChangeMonitor
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import Process
from tactile_dynamics_ros.core.planar.filter.record import PushRecord
from tactile_dynamics_ros.core.planar.filter.summary import Properties, doubted, of_filter, of_fit
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce, PushTracker, TrackerConfig
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.memory.combination import known_of
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate
from tactile_dynamics_ros.core.planar.streams import USUAL_POSE_STD, PushedStreams

MODELS = ("patch", "graph", "graph_residual")
"""Models that can be filtered: the physical one, a network, and a network beside the physics."""
WEIGHTS = ".npz"
"""Ending of files of weights, which stand for the network that they hold."""
_SAME = 1e-4
"""Change of an outline's corners, m, up to which it is still the same object: rounding of messages.
A new outline is a new object, of which nothing is known."""
_FIT_FLOOR = 0.02
"""Least std of ln friction force and, over the radius of gyration, of the centre of mass with which
the filter goes on after a fit: a tighter belief could not follow a table that differs."""

_FITS = 1.5
"""Error of a fit, over the noise, up to which it is what later pushes are held against: clean
simulated pushes have 0.7 to 1.2. A reference that does not fit would raise alarms at itself."""
_MORE = 1.5
"""Times as many pushes as the reference is of from which a fit replaces it. At one each fit would:
one that already contains a change, too small for its first push to show, became what is known, and
pieces of earlier pushes were forgotten. Larger, the first, vague reference stays."""
_OPENED, _OPENED_COM = 0.3, 0.25
"""Std by which ln friction force and ln mass, and the centre of mass over the radius of gyration,
are opened when something has changed: half of what is not known of a new object. At none the
filter would not follow, at more it would forget which object it is."""


@dataclass(frozen=True, eq=False)
class PushingModel:
    """A model of pushing by its name.

    Attributes:
        name: one of MODELS.
        create: makes the process of an outline (V, 2), m.
        step: s, of the filter's steps, where the model was learnt for one.
        fastest: m/s, up to which objects moved from which it was learnt; None: no bound.
    """

    name: str
    create: Callable[[Array], Process]
    step: float | None = None
    fastest: float | None = None


PATCH = PushingModel("patch", PatchProcess)
"""The physical model; the fits after pushes are of the same mechanics. Learnt ones, which have no
fits, come from `network.models`."""


@dataclass(frozen=True)
class PropertyConfig:
    """What the properties of a pushed object are estimated with."""

    model: str = parameter(
        "patch",
        "of pushing: patch (mechanics), graph, graph_residual, or a file of `train pushing`",
    )
    longest: float = parameter(30.0, "touch that fits look at, the latest", "s", 1.0, 300.0)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    change: ChangeConfig = field(default_factory=ChangeConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.model not in MODELS and not self.model.endswith(WEIGHTS):
            raise BadInputError(
                f"model '{self.model}': expected {', '.join(MODELS)}, or a file of "
                f"`train pushing` ({WEIGHTS})"
            )


class LiveProperties:
    """Takes measurements in S in the order of time, and says what is known.

    After every push a fit to all pushes since the reset is due; once there is one, it is what is
    said, because it looks at all measurements at once and lets the motion itself be unknown. The
    filter is what is said before, follows the pose, goes on from the fit's numbers and tells where
    the object slides unlike them. With a learnt model there are no fits, since they would be of the
    mechanics: the filter alone speaks.

    Args:
        config: of everything.
        model: that the filter predicts with.

    Attributes:
        effects: in the model of the fits.
        fits: so far. refused: why the last fit failed; empty if it did not.
        faster: steps of the filter in which the object was faster than the model ever saw.
        changed: the latest change of table or object; None while there was none since the reset.
        changes: how many there were.
        named: whether what has changed was answered, by effects that are set.
    """

    def __init__(self, config: PropertyConfig | None = None, model: PushingModel = PATCH) -> None:
        self.config, self.model = config or PropertyConfig(), model
        self.outline: Array | None = None
        self.effects: tuple[str, ...] = ()
        self.gravity = np.array([0.0, 0.0, -9.81])
        self.reset()

    def reset(self) -> None:
        """Forget all measurements; the outline stays."""
        self.record = PushRecord(self.config.longest)
        self.fit: PushedEstimate | None = None
        self.fits, self.faster, self.refused = 0, 0, ""
        self.changed: Change | None = None
        self.changes, self.named = 0, True
        self._before: PushedEstimate | None = None
        self.newest = -np.inf
        self.durations: deque[float] = deque(maxlen=500)
        self._yaw, self._referred = 0.0, 0
        self.tracker: PushTracker | None = None
        if self.outline is not None:
            self._begin(self.outline)

    def set_outline(self, outline: Array) -> bool:
        """Take the footprint (V, 2), m; return whether it is that of another object."""
        known, before = self.outline is not None, self.outline
        if before is not None and _alike(before, outline):
            return False
        self.outline = outline
        if known:
            self.reset()
        else:
            self._begin(outline)
        return known

    def set_effects(self, names: Sequence[str]) -> None:
        """Change the model of the fits; one to what was measured so far is due at once.

        After a change, this is the answer to it.

        Raises:
            BadInputError: an effect is unknown or named twice, or the model is a learnt one.
        """
        names = PUSHED.expand(names)
        PUSHED.create_all(names)
        if names and self.model is not PATCH:
            raise BadInputError(
                f"effects {', '.join(names)}: they are in the fits, which model "
                f"'{self.model.name}' has not; choose model 'patch'"
            )
        self.effects, self.fit, self.refused = tuple(names), None, ""
        self.named = True
        self.record.ask_again()
        self._watch()

    def _begin(self, outline: Array) -> None:
        self.patch = SupportPatch(outline)
        config = self.config.tracker
        if self.model.step is not None:
            config = replace(config, step=self.model.step)
        self.tracker = PushTracker(self.model.create(outline), config)
        self.monitor = ChangeMonitor(PatchProcess(outline), self.config.change)
        self._watch()

    def _watch(self) -> None:
        """Watch for changes while the mechanics alone are the model; effects are not in them."""
        watched = self.model is PATCH and not self.effects
        if self.tracker is not None:
            self.tracker.watch = self.monitor if watched else None

    def add_pose(self, time: float, pose: Array, std: Array | None) -> None:
        """Take where the link is: x, y, yaw, with their std where stated."""
        turn = (pose[2] - self._yaw + np.pi) % (2.0 * np.pi) - np.pi
        self._yaw += turn
        placed = np.array([pose[0], pose[1], self._yaw])
        spread = USUAL_POSE_STD if std is None or not np.all(std > 0.0) else std
        self.newest = max(self.newest, time)
        self.record.add_pose(time, placed, spread)
        if self.tracker is not None:
            self.tracker.add_pose(time, placed, spread)

    def add_pusher(self, time: float, pose: Array) -> None:
        """Take where the pusher is: x, y, z, yaw (unwrapped)."""
        self.record.add_pusher(time, float(pose[3]))
        if self.tracker is not None:
            self.tracker.add_pusher(time, pose)

    def add_contact(self, measured: ContactForce) -> None:
        """Take a force on the object."""
        self.newest = max(self.newest, measured.time)
        self.record.add_contact(measured)
        if self.tracker is not None:
            self.tracker.add_contact(measured)

    def advance(self, until: float) -> int:
        """Take the filter's steps up to a time by which all measurements have come."""
        if self.tracker is None:
            return 0
        start, touched = clock.thread_time(), self.tracker.touched
        taken = self.tracker.advance(until)
        if self.tracker.touched > touched:
            self.durations.append((clock.thread_time() - start) / taken)
            self.faster += self._is_faster()
        if self.monitor.alarm is not None:
            self._begin_anew(self.monitor.alarm)
        return taken

    def _begin_anew(self, change: Change) -> None:
        """Know less from a change on: fits look at what came since, the belief is opened."""
        assert self.tracker is not None and self.tracker.filter is not None
        self.changed, self.changes, self.fit = change, self.changes + 1, None
        self.named = False
        self.record.forget_before(change.since)
        self.monitor.dismiss()
        self._referred = 0
        mean, covariance = self.tracker.filter.parameters
        reach = _OPENED_COM * np.sqrt(self.patch.gyration)
        opened = np.diag(np.square([_OPENED, _OPENED, reach, reach]))
        self.tracker.filter.inform(mean[:4], covariance[:4, :4] + opened)

    def _is_faster(self) -> bool:
        """Whether the object moves faster than the model ever saw."""
        if self.model.fastest is None or self.tracker is None or self.tracker.filter is None:
            return False
        return bool(np.linalg.norm(self.tracker.filter.state[0][3:5]) > self.model.fastest)

    def due(self, now: float) -> PushedStreams | None:
        """Return what a fit should look at, where a push has ended since the last."""
        if self.model is not PATCH or self.outline is None or not self.record.has_ended(now):
            return None
        return self.record.streams(self.outline, gravity=self.gravity)

    @property
    def known(self) -> KnownPushed | None:
        """What was known before a change, of which fits with effects make the best; else None."""
        if self._before is None or self.changed is None or not self.effects:
            return None
        return known_of(self._before, "before the change")

    def take_fit(self, fit: PushedEstimate | None, refused: str = "") -> None:
        """Take a fit, or why there is none; the filter goes on from its numbers."""
        self.refused = refused
        if fit is None:
            return
        self.fit, self.fits = fit, self.fits + 1
        if self.tracker is None or self.tracker.filter is None:
            return
        values = fit.values
        mean = np.array(
            [
                np.log(values["friction_force_n"][0] / -self.gravity[2]),
                np.log(values["mass"][0]),
                values["com_x"][0],
                values["com_y"][0],
            ]
        )
        reach = _FIT_FLOOR * np.sqrt(self.patch.gyration)
        floor = np.diag(np.square([_FIT_FLOOR, _FIT_FLOOR, reach, reach]))
        here = floor + (fit.covariance if fit.here is None else fit.here)
        self.tracker.filter.inform(mean, here)
        more = self.record.pushes >= _MORE * self._referred
        if self.named and self.monitor.calm and fit.error < _FITS and more:
            self._referred, self._before = self.record.pushes, fit
            self.monitor.refer(mean, here + self._of_places())

    def _of_places(self) -> Array:
        """Covariance (4, 4) of what pushes tell that is true of their places alone."""
        share = self.config.change.variation / np.sqrt(max(self.record.pushes, 1))
        reach = share * np.sqrt(self.patch.gyration)
        return np.asarray(np.diag(np.square([share, 0.0, reach, reach])))

    def properties(self) -> Properties | None:
        """What is known now; None before the object was seen."""
        if self.tracker is None or self.tracker.filter is None:
            return None
        live = of_filter(*self.tracker.filter.parameters, self.patch, self.tracker.touched)
        if self.faster:
            live = doubted(
                live, f"faster than what '{self.model.name}' was trained on; choose model 'patch'"
            )
        return live if self.fit is None else of_fit(self.fit, live, self.refused)


def _alike(one: Array, other: Array) -> bool:
    return one.shape == other.shape and bool(np.abs(one - other).max() < _SAME)
