"""Node: poses and contact forces to mass, centre of mass and inertia with their uncertainty."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.friction.probe_config import cone_share, distance_beyond
from tactile_dynamics_ros.core.inertia.live import (
    IncrementalConfig,
    IncrementalInertialEstimator,
    LiveEstimate,
)
from tactile_dynamics_ros.core.inertia.live.live_estimate import Verdict, judge_estimate
from tactile_dynamics_ros.core.inertia.live.refit import RefitConfig
from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
from tactile_dynamics_ros.core.streams.streams import ContactSample
from tactile_dynamics_ros.recording.shape_files import read_solid
from tactile_dynamics_ros.ros.conversions import header, inertia_to_message
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.friction_messages import friction_range
from tactile_dynamics_ros.ros.held_streams import HeldStreams
from tactile_dynamics_ros.ros.names import (
    CONTACTS,
    DIAGNOSE,
    ESTIMATE,
    ESTIMATOR_RESET,
    ESTIMATOR_STATUS,
    INERTIA,
    OBJECT_SHAPE,
    PROBE_ESTIMATE,
)
from tactile_dynamics_ros.ros.object_memory import ObjectMemory
from tactile_dynamics_ros.ros.object_state import REPEAT, SILENT, ObjectState
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.payload_services import CarriedTool
from tactile_dynamics_ros.ros.refitter import Refitter
from tactile_dynamics_ros.ros.shape_messages import EstimateMarkers, solid_from_message
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.statuses import status_of, waiting_status
from tactile_dynamics_ros.ros.typed_messages import estimate_message, typed_publisher
from tactile_dynamics_ros.share import object_file

TOPIC = "topic"
"""Value of the parameter `shape` for the shape that is published. A file of this name would need a
path before it."""


@dataclass(frozen=True)
class InertialEstimatorConfig:
    """What is listened to, how often an estimate is published, and the model."""

    contacts: tuple[str, ...] = parameter(CONTACTS, "names of the contacts on contact/<name>")
    update_rate_hz: float = parameter(10.0, "rate of estimates", "Hz", 0.1, 200.0)
    effects: tuple[str, ...] = parameter((), "effects of the catalogue in the model; live")
    shape: str = parameter(
        "",
        "what the object fills, in the axes of its pose: object in config/objects, mesh (m), cloud "
        "or JSON of `shape`; topic: what object/shape says",
    )

    def __post_init__(self) -> None:
        check_ranges(self)


class InertialEstimatorNode(Shell):
    """Feeds the live estimator and publishes what it knows.

    Without effects that is the incremental estimate, at every update. A model with effects is
    fitted to the last minute again and again, in a process of its own.

    With a shape, the body fills it, of a density that the data decide; models with effects do not
    know it.

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
        config = declare_config(
            self, InertialEstimatorConfig, live=["effects"], on_change=self._change_model
        )
        self.refitter.set_effects(config.effects)
        self._tool, self._memory = CarriedTool(self), ObjectMemory(self)
        self._forget_estimate()
        self._friction: tuple[float, float] | None = None
        self._grip: dict[str, object] = {}
        self.listen(DiagnosticStatus, PROBE_ESTIMATE, self._on_friction, LATCHED)
        self._shape: object = None
        if config.shape == TOPIC:
            self.listen(DiagnosticArray, OBJECT_SHAPE, self._on_shape, LATCHED)
        elif config.shape:
            named = not Path(config.shape).suffix
            solid = read_solid(object_file(config.shape) if named else config.shape)
            self.estimator.set_shape(ShapePrior(solid))
        self._streams = HeldStreams(
            self, config.contacts, self._on_pose, self._on_contact, self._forget, self._break
        )
        self._inertia = self.latched(InertiaStamped, INERTIA)
        self._typed = typed_publisher(self, "Estimate", ESTIMATE)
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
        self._forget_estimate()

    def _break(self, step: float) -> None:
        """Join nothing across a step of the clock, s; what is known stays."""
        self.estimator.begin_stretch()
        self.refitter.model.window.step_back(step)

    def _forget_estimate(self) -> None:
        """Say anew what is known; there is no estimate of the model yet."""
        self._newest: LiveEstimate | None = None
        self._last_time = self._renewed = self._told = -np.inf
        self._said = ""

    def _change_model(self, config: InertialEstimatorConfig) -> str:
        """Take other effects; return what they are fitted to."""
        self.refitter.set_effects(config.effects)
        self._forget_estimate()
        return f"{self.refitter.outlook}; now: {self._streams.state.text}"

    def _on_pose(self, time: float, pose: Array, covariance: Array | None) -> None:
        self._markers.add_pose(pose)
        self.estimator.add_pose(time, pose, covariance)
        self.refitter.model.window.add_pose(time, pose, covariance)

    def _on_friction(self, message: DiagnosticStatus) -> None:
        self._friction = friction_range(message) or self._friction

    def _on_shape(self, message: DiagnosticArray) -> None:
        if message.status != self._shape:
            self._shape = message.status
            self.estimator.set_shape(ShapePrior(solid_from_message(message)))

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
        fresh = estimate is not None and estimate.time != self._last_time
        if estimate is not None and (fresh or self._obstacles):
            self._publish(estimate)
        now, state = time.monotonic(), self._streams.state
        self._renewed = now if fresh else self._renewed
        if fresh or self._obstacles or state.name != self._said or now - self._told >= REPEAT:
            self._told, self._said = now, state.name
            self._tell(state, now - self._renewed)

    @property
    def _obstacles(self) -> list[str]:
        """What keeps anybody from believing an estimate now."""
        conflict = self._streams.conflict
        return [*([conflict] if conflict else []), *self.estimator.obstacles]

    def _publish(self, carried: LiveEstimate) -> None:
        """Keep and publish an estimate."""
        self._last_time = carried.time
        alone = self._tool.take_out(carried)
        if alone is None:
            return
        estimate = self._memory.combine(alone, alone.time)
        verdict = self._judge(estimate)
        self._memory.keep(estimate, verdict, estimate.time)
        if not verdict.withheld:
            self._inertia.publish(inertia_to_message(estimate.inertia, estimate.time, "object"))
            if self._typed is not None:
                stamp = header(estimate.time, "object")
                self._typed.publish(estimate_message(estimate, estimate.adequate, stamp))
        com = None if verdict.withheld else estimate.inertia.com
        self._markers.publish(estimate.time, com, estimate.parameter_std[1:4])
        self._newest = estimate

    def _judge(self, estimate: LiveEstimate) -> Verdict:
        """Say what an estimate is worth now."""
        check = self.resolve_service_name(DIAGNOSE)
        return self._memory.judged(judge_estimate(estimate, self._obstacles, check), estimate)

    def _tell(self, state: ObjectState, age: float) -> None:
        """Publish the status: of the newest estimate, or of what is awaited."""
        idle = min(age, state.lasts)
        if state.current and idle > SILENT and not self.refitter.model.effects:
            idling = f"no sample could be used for {idle:.0f} s"
            state = replace(state, troubles=(*state.troubles, idling))
        effects, stamp = self.refitter.model.effects, max(self.refitter.model.window.newest, 0.0)
        if self._newest is None:
            said = "; ".join([state.text, *state.troubles])
            text = f"{said}; {self.refitter.progress}" if effects else said
            statuses = [*waiting_status(effects, text)]
        else:
            stamp = self._newest.time
            statuses = [*status_of(self._newest, effects, self._judge(self._newest), state)]
            statuses += [*self._memory.statuses(stamp), status_message("grip", self._grip)]
        message = DiagnosticArray(header=header(stamp, "object"))
        message.status = [state.status(age), *statuses]
        self._status.publish(message)


def main() -> int:
    """Run the node."""
    return run_node(InertialEstimatorNode)
