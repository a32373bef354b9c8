"""Node: how far the model is from the measurements, where, and which effect it lacks."""

from __future__ import annotations

import json
import time
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, WrenchStamped
from rclpy.task import Future as RosFuture
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.robot_description import FINGERS
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.live_check import (
    LiveCheckConfig,
    LiveComparison,
    LiveModelCheck,
)
from tactile_dynamics_ros.nodes.background import Background
from tactile_dynamics_ros.nodes.contact_assembly import AssembledContact, ContactAssembly
from tactile_dynamics_ros.nodes.conversions import (
    StampGate,
    header,
    to_seconds,
    uncertain_pose_to_core,
    wrench_to_message,
)
from tactile_dynamics_ros.nodes.diagnostics import status_message, status_values
from tactile_dynamics_ros.nodes.hand_error import HandError
from tactile_dynamics_ros.nodes.names import (
    DIAGNOSE,
    ESTIMATOR_STATUS,
    MODEL_DIAGNOSIS,
    MODEL_ERROR,
    MODEL_RESIDUAL,
    OBJECT_POSE,
)
from tactile_dynamics_ros.nodes.parameters import declare_config
from tactile_dynamics_ros.nodes.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.nodes.wire import Stamped

REST = 3.0
"""Pause after a comparison, in multiples of the time that it took."""


@dataclass(frozen=True)
class ModelCheckConfig:
    """What is listened to, and how often the model is compared."""

    contacts: tuple[str, ...] = parameter(FINGERS, "names of the contacts on contact/<name>")
    period: float = parameter(5.0, "time between comparisons, real time", "s", 0.5, 600.0)

    def __post_init__(self) -> None:
        check_ranges(self)


class ModelCheckNode(Shell):
    """Keeps the last seconds, compares in the background, diagnoses on request.

    The model is that of inertial_estimator: effects that are added there are taken over here.
    """

    gather = 0.1

    def __init__(self) -> None:
        super().__init__("model_check")
        config = declare_config(self, ModelCheckConfig)
        self.check = LiveModelCheck(declare_config(self, LiveCheckConfig))
        self._background = Background()
        self._gate = StampGate(OBJECT_POSE)
        self._hand = HandError(self)
        self._model: tuple[str, ...] = ()
        self._comparison: Future[LiveComparison] | None = None
        self._newest = self._compared = 0.0
        self._started = self._rest_until = 0.0
        self.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_pose)
        self.listen(DiagnosticArray, ESTIMATOR_STATUS, self._on_model, LATCHED)
        self._contacts = [
            ContactAssembly(self, name, self._on_contact, self._hand) for name in config.contacts
        ]
        self._residual = self.stream(WrenchStamped, MODEL_RESIDUAL)
        self._error = self.latched(Float64, MODEL_ERROR)
        self._diagnosis = self.latched(DiagnosticArray, MODEL_DIAGNOSIS)
        self.create_service(Trigger, DIAGNOSE, self._diagnose)
        self.every(config.period, self._compare)
        self.every(0.1, self._report)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._background.close()
        super().destroy_node()

    def _on_pose(self, message: Stamped) -> None:
        pose, covariance = uncertain_pose_to_core(message, OBJECT_POSE, "world")
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self.check.reset()
        self._newest = to_seconds(message.stamp)
        self._hand.add_fused(self._newest, pose)
        self.check.add_pose(self._newest, pose, covariance)

    def _on_contact(self, contact: AssembledContact) -> None:
        self.check.add_contact(
            contact.time,
            contact.name,
            contact.point,
            contact.rotation,
            contact.force,
            contact.std,
            contact.torque,
        )

    def _on_model(self, message: DiagnosticArray) -> None:
        found = {status.name: status_values(status) for status in message.status}
        names = tuple(n for n in found.get("solver", {}).get("effects", "").split(",") if n)
        if names != self._model:
            self.check.set_effects([create_effect(name) for name in names])
            self._model = names

    def _compare(self) -> None:
        """Start a comparison if something new has come, nothing runs, and there is time for it."""
        now = time.monotonic()
        if self._background.busy or self._newest == self._compared or now < self._rest_until:
            return
        self._compared, self._started = self._newest, now
        self._comparison = self._background.submit(self.check.snapshot().compare)

    def _report(self) -> None:
        """Publish a comparison that is finished."""
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
            return
        self._error.publish(Float64(data=float(result.whitened_rms)))
        message = wrench_to_message(result.residual[-1], float(result.time[-1]), "object")
        self._residual.publish(message)

    async def _diagnose(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Diagnose what is kept; the answer comes when it is finished."""
        snapshot, done = self.check.snapshot(), RosFuture()
        self._background.submit(lambda: _document(snapshot)).add_done_callback(done.set_result)
        finished = await done
        try:
            document = finished.result()
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
            return response
        self._publish(document)
        response.success, response.message = True, json.dumps(document)
        return response

    def _publish(self, document: dict[str, Any]) -> None:
        verdict = document["verdict"]
        level = DiagnosticStatus.OK if verdict == "adequate" else DiagnosticStatus.WARN
        text = document.get("sentence") or verdict
        values = {**document["error"], "effect": document["effect"], "group": document["group"]}
        message = DiagnosticArray(header=header(self._newest, "object"))
        message.status = [status_message("diagnosis", {"verdict": verdict, **values}, level, text)]
        for candidate in document["candidates"]:
            numbers = {k: v for k, v in candidate.items() if isinstance(v, float | int)}
            message.status.append(status_message(candidate["name"], numbers))
        self._diagnosis.publish(message)


def _document(check: LiveModelCheck) -> dict[str, Any]:
    """Diagnose and return the document of `tactile-dynamics diagnose --json`."""
    return diagnosis_document(check.diagnose())


def main() -> int:
    """Run the node."""
    return run_node(ModelCheckNode)
