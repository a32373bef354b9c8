"""Node: how far the model is from the measurements, where, and which effect it lacks."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.task import Future as RosFuture
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.discrepancy.live_check import LiveCheckConfig, LiveComparison
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)
from tactile_dynamics_ros.ros.actions import Action
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.checked_model import (
    MODELS,
    checked_model,
    diagnose_measured,
)
from tactile_dynamics_ros.ros.conversions import header, wrench_to_message
from tactile_dynamics_ros.ros.diagnostics import Statuses, status_message
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import (
    DIAGNOSE,
    LEARN,
    MODEL_DIAGNOSIS,
    MODEL_ERROR,
    MODEL_RESIDUAL,
    MODEL_VERDICT,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.typed_messages import (
    effect_messages,
    typed_publisher,
    verdict_message,
)
from tactile_dynamics_ros.ros.watch import Event, Watch, WatchConfig, keep_and_diagnose

REST = 3.0
"""Pause after a comparison, in multiples of the time that it took."""


@dataclass(frozen=True)
class ModelCheckConfig:
    """What is listened to, and how often the model is compared."""

    model: str = parameter("held", f"of the object: {' or '.join(MODELS)}")
    contacts: tuple[str, ...] = parameter(
        (), "names of the contacts on contact/<name>; empty: those of the hand, or of the pusher"
    )
    period: float = parameter(5.0, "time between comparisons, real time", "s", 0.5, 600.0)
    iterations: int = parameter(2, "iterations of the fit of a comparison", "", 1, 10)
    laws: str = parameter("~/.ros/laws", "folder in which model_check/learn writes a law")

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Diagnosing:
    """A diagnosis that was asked for.

    Attributes:
        effects: of the model. done: gets `work` when it is finished. work: in the background.
        begin: gave the work.
    """

    effects: tuple[str, ...]
    done: RosFuture
    work: Future[Document]
    begin: Callable[[], Callable[[], Document]] | None = None


class ModelCheckNode(Shell):
    """Keeps the last seconds, compares in the background, diagnoses on request.

    The model is that of inertial_estimator, or of property_estimator for a pushed object: effects
    that are added there are taken over here.
    """

    gather = 0.1
    by_arrival = True

    def __init__(self) -> None:
        super().__init__("model_check")
        config = declare_config(self, ModelCheckConfig)
        spans = declare_config(self, LiveCheckConfig)
        self._watch = Watch(declare_config(self, WatchConfig, "watch."))
        kept = max(spans.diagnosis_window, self._watch.config.span)
        self._kind = config.model
        self._model = checked_model(
            self, config.model, config.contacts, config.iterations, spans, kept
        )
        self._window, self.check = self._model.window, self._model.check
        self._streams = self._model.streams
        self._background = Background()
        self._comparison: Future[LiveComparison] | None = None
        self._diagnosing: Diagnosing | None = None
        self._compared = -np.inf
        self._started = self._rest_until = 0.0
        self.listen(DiagnosticArray, self._model.status, self._on_model, LATCHED)
        self._residual = self.stream(WrenchStamped, MODEL_RESIDUAL)
        self._error = self.latched(Float64, MODEL_ERROR)
        self._verdict = typed_publisher(self, "Verdict", MODEL_VERDICT)
        self._diagnosis = self.latched(DiagnosticArray, MODEL_DIAGNOSIS)
        self._laws = Path(config.laws).expanduser()
        for name, begin in ((DIAGNOSE, self.check.diagnosis), (LEARN, self._begin_learning)):
            answer = partial(self._answer, begin)
            self.create_service(Trigger, name, answer, qos_profile=REQUESTS)
        self.every(config.period, self._compare)
        self.action = Action(self, "Diagnose", DIAGNOSE, self._begin_goal, self._give_up_diagnosis)
        self.every(0.1, self._report)
        self.every(1.0, self._tell)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._background.close()
        self.action.close()
        super().destroy_node()

    def process(self) -> None:
        """Take what need not wait for late messages any longer."""
        self._streams.release()

    def _on_model(self, message: DiagnosticArray) -> None:
        read = Statuses(message.status)
        self.check.effects = read.words("solver", "effects")
        if self._model.change is not None:
            since = read.number("change", "since")
            self._model.change.since = since if np.isfinite(since) else -np.inf

    def _compare(self) -> None:
        """Start a comparison if something new has come, nothing runs, and there is time for it."""
        now, newest = time.monotonic(), self._window.newest
        if self._background.busy or now < self._rest_until:
            return
        if newest == self._compared:
            self._pause_watch()
            return
        self._compared, self._started = newest, now
        try:
            comparison = self.check.comparison()
        except TactileDynamicsError as error:
            self.faults.add("not_compared", str(error))
            self._pause_watch()
            return
        self._comparison = self._background.submit(comparison)

    def _report(self) -> None:
        """Publish a comparison that is finished, and what is heard of the object."""
        self.faults.show("object", self._streams.state.text)
        if self._comparison is None or not self._comparison.done():
            return
        future, self._comparison = self._comparison, None
        now = time.monotonic()
        self._rest_until = now + REST * (now - self._started)
        self.faults.show("comparison_s", round(now - self._started, 3))
        try:
            result = future.result()
        except TactileDynamicsError as error:
            self.faults.add("not_compared", str(error))
            self._pause_watch()
            return
        self._error.publish(Float64(data=float(result.whitened_rms)))
        message = wrench_to_message(result.residual[-1], float(result.time[-1]), "object")
        self._residual.publish(message)
        for event in self._watch.update(float(result.time[-1]), float(result.whitened_rms)):
            self._act(event, float(result.whitened_rms))

    def _pause_watch(self) -> None:
        """Keep what a report was about, now that nothing is measured."""
        for event in self._watch.pause():
            self._act(event)

    def _act(self, event: Event, error: float = np.nan) -> None:
        """Report an error that stays too large, or keep what was measured."""
        watch = self._watch.config
        if event is Event.REPORT:
            text = f"the model does not fit: error {error:.1f} times the noise"
            self.faults.alarm("error", text, {"error": error, "threshold": watch.threshold})
            return
        streams = self._window.streams(watch.span)
        ask = partial(self._model.diagnose, streams, self.check.effects)
        write = partial(self._model.write, streams)
        self._diagnose_by(partial(keep_and_diagnose, write, ask, watch.folder, watch.most))

    def _begin_learning(self) -> Callable[[], Document]:
        """The work of a diagnosis that learns a law too."""
        return self.check.learning(self._laws)

    async def _answer(
        self,
        begin: Callable[[], Callable[[], Document]],
        _: Trigger.Request,
        response: Trigger.Response,
    ) -> Trigger.Response:
        """Diagnose what is kept; the answer comes when it is finished."""
        try:
            self.action.require_free()
            finished = await self._begin_diagnosis(begin).done
            document = finished.result()
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, json.dumps(document)
        return response

    def _begin_goal(self, _: Any) -> None:
        """Start a diagnosis for the action, unless a service awaits one."""
        if self._diagnosing is not None and not self._diagnosing.done.done():
            raise NotIdentifiableError("a diagnosis that a service asked for is running")
        self._begin_diagnosis(self.check.diagnosis).done.add_done_callback(self._end_goal)

    def _end_goal(self, done: RosFuture) -> None:
        finished: Future[Document] | None = done.result()
        if finished is None:  # given up
            return
        if finished.exception() is not None:
            self.action.end(False, str(finished.exception()))
            return
        document, stamp = finished.result(), header(self._window.newest, "object")
        self.action.end(
            True,
            document.get("sentence") or document["verdict"],
            document,
            verdict=verdict_message(document, self._kind, stamp),
            effects=effect_messages(document),
        )

    def _give_up_diagnosis(self) -> None:
        """End the diagnosis that runs or waits."""
        given_up, self._diagnosing = self._diagnosing, None
        if given_up is not None and not given_up.done.done():
            given_up.done.cancel()
            if not given_up.work.cancel():
                self._background.drop()

    def _tell(self) -> None:
        """Give feedback; how much is left depends on what will be found."""
        self.action.tell("diagnosing", np.nan, f"for {self.action.elapsed:.0f} s")

    def _begin_diagnosis(self, begin: Callable[[], Callable[[], Document]]) -> Diagnosing:
        """Start a diagnosis, or join one of the same model that is not finished yet.

        Args:
            begin: gives its work.

        Raises:
            NotIdentifiableError: there are no measurements to diagnose.
        """
        if self._diagnosing is not None:
            running = self._diagnosing
            same = running.effects == self.check.effects and running.begin == begin
            if same and not running.done.done():
                return running
        state = self._streams.state
        try:
            work = begin()
        except BadInputError as error:
            raise NotIdentifiableError(f"{error}; now: {state.text}") from error
        asked = self._diagnose_by(partial(diagnose_measured, work, state))
        self._diagnosing = replace(asked, begin=begin)
        return self._diagnosing

    def _diagnose_by(self, work: Callable[[], Document]) -> Diagnosing:
        """Diagnose in the background and publish the document."""
        done = RosFuture()
        done.add_done_callback(self._publish)

        def hand_over(finished: Future[Document]) -> None:
            if not self._background.closed and not done.cancelled():  # else nobody is interested
                done.set_result(finished)

        running = self._background.submit(work)
        running.add_done_callback(hand_over)
        return Diagnosing(self.check.effects, done, running)

    def _publish(self, done: RosFuture) -> None:
        finished: Future[Document] | None = done.result()
        if finished is None:  # given up
            return
        if finished.exception() is not None:
            self.faults.add("not_diagnosed", str(finished.exception()))
            return
        document: Document = finished.result()
        if "kept" in document:
            self.faults.show("kept", document["kept"])
        if document["verdict"] is None:
            return
        verdict = document["verdict"]
        level = DiagnosticStatus.OK if verdict == "adequate" else DiagnosticStatus.WARN
        text = document.get("sentence") or verdict
        found = {"effect": document["effect"] or "", "group": ",".join(document["group"])}
        found |= {name: json.dumps(spans) for name, spans in document.get("spans", {}).items()}
        values = {**document["error"], **found}
        message = DiagnosticArray(header=header(self._window.newest, "object"))
        message.status = [status_message("diagnosis", {"verdict": verdict, **values}, level, text)]
        for candidate in document["candidates"]:
            numbers = {k: v for k, v in candidate.items() if isinstance(v, float | int)}
            message.status.append(status_message(candidate["name"], numbers))
        self._diagnosis.publish(message)
        if self._verdict is not None:
            self._verdict.publish(verdict_message(document, self._kind, message.header))


def main() -> int:
    """Run the node."""
    return run_node(ModelCheckNode)
