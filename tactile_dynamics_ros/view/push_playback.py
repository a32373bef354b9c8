"""A recording of pushes at one of its times, for the page."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis
from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
from tactile_dynamics_ros.api.questions import Question
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.inertia.live.live_estimate import MISFIT
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.core.planar.streams import PushContact, PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.recording.bag_files import RawMessage, read_messages
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.names import (
    EXPLORE_PROGRESS,
    MODEL_DIAGNOSIS,
    OBJECT_MARKERS,
    PROPERTY_STATUS,
    PUSH_PROGRESS,
)
from tactile_dynamics_ros.view.state import (
    KEPT,
    Force,
    History,
    Span,
    State,
    take_diagnosis,
    take_markers,
    take_progress,
    take_properties,
    take_property_status,
)

_NEAR = 0.1
"""Distance of a sample, s, up to which it is shown for a time: twice the period of slow loggers.
Smaller makes arrows flicker on them, larger shows forces that are gone."""
_PAUSE = 0.3
"""Time without touch, s, that ends a push: tips leave and come again in about a second. A shorter
one cuts pushes in which the object jumps, a longer one joins those of fast arms."""

Event = tuple[float, Callable[[State], None]]
"""Time, s, and what is new then."""


class PushPlayback:
    """States of a recording of pushes over time.

    What nodes said while it was recorded is shown as it was said; where they were not recorded, an
    estimate from all pushes until then follows each push, as soon as it is computed.

    Args:
        recording: of one object.
    """

    def __init__(self, recording: PushedRecording) -> None:
        self.recording = recording
        self._streams = recording.streams
        self.start = float(self._streams.links[0].time[0])
        self._pushes: dict[str, PushContact] = self._streams.contacts
        self._tracks = _told(recording)
        self._shape = _shape(recording)
        self._effects: tuple[str, ...] = ()
        self._asked: EstimateOfPushes | None = None
        self._asked_with: tuple[str, ...] = ()
        self._overlay: dict[str, Any] = {}
        self._waiting: deque[tuple[float, Future[PushedEstimate]]] = deque()
        self._background: Background | None = None
        if PROPERTY_STATUS not in self._tracks:
            self._tracks[PROPERTY_STATUS] = []
            self._begin_estimates()
        self._histories = self._all_histories()

    def close(self) -> None:
        """Stop estimating."""
        if self._background is not None:
            self._background.close()

    @property
    def duration(self) -> float:
        """Length of the recording, s."""
        return self.recording.duration

    def at(self, seconds: float) -> State:
        """Return the state at a time from the start, s; charts are those of all of it."""
        self._take_estimates()
        time = self.start + seconds
        state = State()
        link = self._streams.links[0]
        x, y, yaw = link.pose[_nearest(link.time, time)]
        state.object_pose = pose_of((x, y, 0.0), (0.0, 0.0, yaw))
        state.footprint = link.footprint
        for name, contact in self._pushes.items():
            if force := _force(contact, time):
                state.forces[name] = force
        for track in self._tracks.values():
            before = bisect_right(track, time, key=itemgetter(0))
            if before:
                track[before - 1][1](state)
        if self._shape is not None:
            state.shape, state.shape_pose = self._shape
        state.histories = self._histories
        found = None if self._asked is None else self._asked.found
        if self._effects and isinstance(found, PushedEstimate):
            _of_estimate(time, found)[1](state)
        for name, value in self._overlay.items():
            setattr(state, name, value)
        return state

    def diagnose(self) -> str:
        """Find out which effect is missing; return the sentence."""
        try:
            question = self._estimate(self._effects)
            found = Diagnosis.of(question)
        except TactileDynamicsError as error:
            return str(error)
        document = found.to_json()
        self._show_error(question, document["error"]["noise_floor"])
        named = tuple(filter(None, dict.fromkeys((found.effect, *document["group"]))))
        self._overlay |= {
            "verdict": str(document["sentence"]),
            "fits": found.verdict == "adequate",
            "missing": named,
        }
        if found.findings.regimes:
            self._overlay["regimes"] = _stamped(found.findings.regimes, question)
        return str(document["sentence"])

    def add(self, name: str) -> str:
        """Add an effect to the model and estimate anew; return how the error changes."""
        try:
            before = self._estimate(self._effects).whitened_rms
            question = self._estimate((*self._effects, name))
        except TactileDynamicsError as error:
            return f"{name} is not added: {error}"
        self._effects = (*self._effects, name)
        self._show_error(question, self._overlay.get("floor", 1.0))
        self._overlay |= {"effects": self._effects, "missing": (), "verdict": "", "fits": True}
        return f"{name} is added: error {before:.2f} -> {question.whitened_rms:.2f}"

    def _estimate(self, effects: tuple[str, ...]) -> Question:
        """Estimate from the whole recording with effects, unless that was the last estimate.

        Raises:
            TactileDynamicsError: there is no estimate, or no model to hold against the recording.
        """
        if self._asked is None or self._asked_with != effects:
            self._asked = EstimateOfPushes.of(self.recording, effects)
            self._asked_with = effects
        if self._asked.question is None:
            raise NotIdentifiableError("poses are too sparse to ask what is missing")
        return self._asked.question

    def _show_error(self, question: Question, floor: float) -> None:
        """Show the error over time, with its floor and where it is large."""
        compared = Comparison.of(question)
        time, errors = compared.error_over_time()
        history = History(whole=True)
        for k in np.unique(np.linspace(0, len(time) - 1, min(len(time), KEPT)).astype(int)):
            history.add(time[k] + _start(question), errors[k])
        self._overlay |= {
            "histories": self._histories | {"error": history},
            "error": question.whitened_rms,
            "floor": floor,
            "failing": _stamped(compared.answer.intervals, question),
            "regimes": _stamped(compared.regime_spans(), question),
        }

    def _begin_estimates(self) -> None:
        """Estimate after each push, in a process beside the page; for a single part only."""
        if len(self._streams.links) > 1:
            return
        self._background = Background()
        for end in _push_ends(self._streams):
            fitting = self._background.submit(estimate, self._streams.between(-np.inf, end))
            self._waiting.append((end, fitting))

    def _take_estimates(self) -> None:
        """Take the estimates after each push that have come since the last call."""
        fresh = False
        while self._waiting and self._waiting[0][1].done():
            end, fitting = self._waiting.popleft()
            try:
                event = _of_estimate(end, fitting.result())
            except TactileDynamicsError as error:
                event = end, partial(_refuse, str(error))
            self._tracks[PROPERTY_STATUS].append(event)
            fresh = True
        if fresh:
            self._histories = self._all_histories()

    def _all_histories(self) -> dict[str, History]:
        """Histories of what was known, thinned to as many points as a chart has."""
        state = State()
        track = self._tracks[PROPERTY_STATUS]
        if not track:
            return {}
        for k in np.unique(np.linspace(0, len(track) - 1, min(len(track), KEPT)).astype(int)):
            track[k][1](state)
        return state.histories


def _start(question: Question) -> float:
    """Time zero of the residuals of a model of pushes, s."""
    return float(question.model.linear.times[0])


def _stamped(spans: Sequence[Span], question: Question) -> tuple[Span, ...]:
    start = _start(question)
    return tuple((a + start, b + start) for a, b in spans)


def _refuse(why: str, state: State) -> None:
    state.remark, state.good = why, False


def _nearest(times: Array, time: float) -> int:
    return int(nearest_samples(times, np.array([time]))[0])


def _force(contact: PushContact, time: float) -> Force | None:
    """The force of a contact at a time, where it touches then."""
    if not len(contact.time) or not len(contact.pose_time):
        return None
    k = _nearest(contact.time, time)
    if abs(contact.time[k] - time) > _NEAR or not np.any(contact.force[k]):
        return None
    point = contact.point[_nearest(contact.pose_time, time)]
    return Force(point, contact.force[k], contact.force_std)


def _told(recording: PushedRecording) -> dict[str, list[Event]]:
    """What nodes said, by topic; statuses without a stamp are placed by when they came.

    Statuses of `property_estimator` have a stamp and a time of arrival: these are the two clocks.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    tracks: dict[str, list[Event]] = {}
    clocks: list[tuple[float, float]] = []
    epoch = recording.epoch_ns * 1e-9
    for topic in (PROPERTY_STATUS, MODEL_DIAGNOSIS, EXPLORE_PROGRESS, PUSH_PROGRESS):
        for _, kind, came, raw in _messages(recording, topic):
            message: Any = store.deserialize_cdr(raw, kind)
            if hasattr(message, "header"):
                stamp = message.header.stamp
                time = (stamp.sec * 10**9 + stamp.nanosec - recording.epoch_ns) * 1e-9
                clocks += [(float(came), time)] if topic == PROPERTY_STATUS else []
            elif clocks:
                time = float(np.interp(came, *zip(*clocks, strict=True)))
            else:
                continue
            tracks.setdefault(topic, []).append((time, _taker(topic, time, message, epoch)))
    return {topic: sorted(track, key=itemgetter(0)) for topic, track in tracks.items()}


def _messages(recording: PushedRecording, topic: str) -> Iterator[RawMessage]:
    """Messages of a topic of the file that was read; none of what was made or joined."""
    if recording.file is not None:
        yield from read_messages(recording.file, f"{recording.namespace}/{topic}")


def _shape(recording: PushedRecording) -> tuple[Array, Array] | None:
    """Surface (K, 3) in the world, if it was recorded, and the pose of the object then."""
    link, state, store = recording.streams.links[0], State(), get_typestore(Stores.ROS2_JAZZY)
    for _, kind, _, raw in _messages(recording, OBJECT_MARKERS):
        message: Any = store.deserialize_cdr(raw, kind)
        if take_markers(state, message.markers) and state.shape is not None:
            stamp = message.markers[-1].header.stamp
            time = (stamp.sec * 10**9 + stamp.nanosec - recording.epoch_ns) * 1e-9
            x, y, yaw = link.pose[_nearest(link.time, time)]
            return state.shape, pose_of((x, y, 0.0), (0.0, 0.0, yaw))
    return None


def _taker(topic: str, time: float, message: Any, epoch: float) -> Callable[[State], None]:
    """What a message does to the state of the page; with the stamp of time zero, s."""
    if topic == PROPERTY_STATUS:
        return lambda state: take_property_status(state, time, message.status)
    if topic == MODEL_DIAGNOSIS:
        return lambda state: take_diagnosis(state, message.status, epoch)
    return lambda state: take_progress(state, message)


def _of_estimate(time: float, found: PushedEstimate) -> Event:
    """What the page shows of an estimate."""

    def take(state: State) -> None:
        take_properties(state, time, found.values, tuple(found.undetermined))
        state.error, state.good = found.error, found.error < MISFIT
        said = "fits" if state.good else "does not fit, something is missing"
        state.remark = f"The model {said}: error {found.error:.2f} times the noise."
        state.note("error", time, found.error)

    return time, take


def _push_ends(streams: PushedStreams) -> list[float]:
    """Times, s, after which nothing is touched for a while."""
    touched = [c.time[np.any(c.force != 0.0, axis=1)] for c in streams.contacts.values()]
    times = np.sort(np.concatenate([*touched, np.zeros(0)]))
    if not len(times):
        return []
    last = np.append(np.diff(times) > _PAUSE, True)
    return [float(end) + 0.5 * _PAUSE for end in times[last]]
