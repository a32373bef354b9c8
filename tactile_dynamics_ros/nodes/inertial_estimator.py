"""Node: poses and contact forces to mass, centre of mass and inertia with their uncertainty."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.friction.cone import cone_share, distance_beyond
from tactile_dynamics_ros.core.inertia.live import (
    IncrementalConfig,
    IncrementalInertialEstimator,
    LiveEstimate,
)
from tactile_dynamics_ros.core.inertia.live.live_estimate import judge_estimate
from tactile_dynamics_ros.core.inertia.live.refit import RefitConfig
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.ros.carried_tool import CarriedTool
from tactile_dynamics_ros.ros.conversions import header, inertia_to_message
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.estimate_markers import EstimateMarkers
from tactile_dynamics_ros.ros.friction_messages import friction_range
from tactile_dynamics_ros.ros.held_streams import HeldStreams
from tactile_dynamics_ros.ros.inertia_status import status_of, waiting_status
from tactile_dynamics_ros.ros.names import (
    CONTACTS,
    DIAGNOSE,
    ESTIMATOR_RESET,
    ESTIMATOR_STATUS,
    INERTIA,
    PROBE_ESTIMATE,
)
from tactile_dynamics_ros.ros.object_memory import ObjectMemory
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.refitter import Refitter
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InertialEstimatorConfig:
    """What is listened to, how often an estimate is published, and the model."""

    contacts: tuple[str, ...] = parameter(CONTACTS, "names of the contacts on contact/<name>")
    update_rate_hz: float = parameter(10.0, "rate of estimates", "Hz", 0.1, 200.0)
    effects: tuple[str, ...] = parameter((), "effects of the catalogue in the model; live")

    def __post_init__(self) -> None:
        check_ranges(self)


class InertialEstimatorNode(Shell):
    """Feeds the live estimator and publishes what it knows.

    Without effects that is the incremental estimate, at every update. A model with effects is
    fitted to the last minute again and again, in a process of its own.

    Once the friction probe has measured the surface, the share of the friction cone that each
    finger uses is published, and a force that friction could not hold counts as uncertain by at
    least its distance to the cone.
    """

    gather = 0.1
    by_arrival = True

    def __init__(self) -> None:
        super().__init__("inertial_estimator")
        self.estimator = IncrementalInertialEstimator(declare_config(self, IncrementalConfig))
        self.refitter = Refitter(self.faults, declare_config(self, RefitConfig))
        self._told = -np.inf
        config = declare_config(
            self, InertialEstimatorConfig, live=["effects"], on_change=self._change_model
        )
        self._change_model(config)
        self._tool, self._memory = CarriedTool(self), ObjectMemory(self)
        self._last_time = -np.inf
        self._friction: tuple[float, float] | None = None
        self._grip: dict[str, object] = {}
        self.listen(DiagnosticStatus, PROBE_ESTIMATE, self._on_friction, LATCHED)
        self._streams = HeldStreams(
            self, config.contacts, self._on_pose, self._on_contact, self._forget
        )
        self._inertia = self.latched(InertiaStamped, INERTIA)
        self._status = self.latched(DiagnosticArray, ESTIMATOR_STATUS)
        self._markers = EstimateMarkers(self)
        self.serve(ESTIMATOR_RESET, self.reset)
        self.every(1.0 / config.update_rate_hz, self._update)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._memory.end_grasp()
        self.refitter.close()
        super().destroy_node()

    def reset(self) -> str:
        """Forget all measurements; the model stays."""
        self._forget()
        return "all measurements forgotten; the model is kept"

    def process(self) -> None:
        """Take what need not wait for late messages any longer."""
        self._streams.release()

    def _forget(self) -> None:
        self._memory.end_grasp()
        self.estimator.reset()
        self.refitter.model.clear()
        self._last_time = -np.inf

    def _change_model(self, config: InertialEstimatorConfig) -> None:
        self.refitter.set_effects(config.effects)
        self._told = self._last_time = -np.inf

    def _on_pose(self, time: float, pose: Array, covariance: Array | None) -> None:
        self._markers.add_pose(pose)
        self.estimator.add_pose(time, pose, covariance)
        self.refitter.model.window.add_pose(time, pose, covariance)

    def _on_friction(self, message: DiagnosticStatus) -> None:
        self._friction = friction_range(message) or self._friction

    def _on_contact(self, contact: ContactSample) -> None:
        self._markers.add_contact(contact)
        believed = replace(contact, std=self._believed_std(contact))
        self.estimator.add_contact(believed)
        self.refitter.model.window.add_contact(believed)

    def _believed_std(self, contact: ContactSample) -> Array | None:
        """Return the force's standard deviation (3,), N, with what friction says of it."""
        if self._friction is None:
            return contact.std
        least, largest = self._friction
        normal = contact.rotation[:, 2]
        self._grip[contact.name] = cone_share(contact.force, normal, least)
        beyond = distance_beyond(contact.force, normal, largest)
        if beyond == 0.0 or contact.std is None:
            return contact.std
        self.faults.add(f"beyond_friction_{contact.name}")
        return np.asarray(np.hypot(contact.std, beyond))

    def _update(self) -> None:
        estimate = self.estimator.update()
        for kind, count in self.estimator.problems.items():
            self.faults.count(kind, count)
        if self.refitter.model.effects:
            estimate = self.refitter.advance()
            if estimate is None:
                self._tell_progress()
        if estimate is None or estimate.time == self._last_time and not self._obstacles:
            return
        self._last_time = estimate.time
        self._publish(estimate)

    @property
    def _obstacles(self) -> list[str]:
        """What keeps anybody from believing an estimate now."""
        conflict = self._streams.conflict
        return [*([conflict] if conflict else []), *self.estimator.obstacles]

    def _tell_progress(self) -> None:
        """Say once a second that the first fit of a changed model is on its way."""
        now = time.monotonic()
        if now - self._told < 1.0:
            return
        self._told = now
        newest = self.refitter.model.window.newest
        message = DiagnosticArray(header=header(max(newest, 0.0), "object"))
        message.status = [*waiting_status(self.refitter.model.effects, self.refitter.progress)]
        self._status.publish(message)

    def _publish(self, carried: LiveEstimate) -> None:
        alone = self._tool.take_out(carried)
        if alone is None:
            return
        estimate = self._memory.combine(alone, alone.time)
        verdict = judge_estimate(estimate, self._obstacles, self.resolve_service_name(DIAGNOSE))
        verdict = self._memory.judged(verdict, estimate)
        self._memory.keep(estimate, verdict, estimate.time)
        if not verdict.withheld:
            self._inertia.publish(inertia_to_message(estimate.inertia, estimate.time, "object"))
        com = None if verdict.withheld else estimate.inertia.com
        self._markers.publish(estimate.time, com, estimate.parameter_std[1:4])
        message = DiagnosticArray(header=header(estimate.time, "object"))
        message.status = [
            *status_of(estimate, self.refitter.model.effects, verdict),
            *self._memory.statuses(estimate.time),
            status_message("grip", self._grip),
        ]
        self._status.publish(message)


def main() -> int:
    """Run the node."""
    return run_node(InertialEstimatorNode)
