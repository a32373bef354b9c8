"""Node: poses and contact forces to mass, centre of mass and inertia with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import InertiaStamped, PoseWithCovarianceStamped
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.robot_description import FINGERS
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.friction.cone import cone_share, distance_beyond
from tactile_dynamics_ros.core.inertia.estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.incremental import (
    IncrementalConfig,
    IncrementalInertialEstimator,
    LiveEstimate,
)
from tactile_dynamics_ros.nodes.contact_assembly import AssembledContact, ContactAssembly
from tactile_dynamics_ros.nodes.conversions import (
    StampGate,
    header,
    inertia_to_message,
    to_seconds,
    uncertain_pose_to_core,
)
from tactile_dynamics_ros.nodes.diagnostics import status_message
from tactile_dynamics_ros.nodes.friction_messages import friction_range
from tactile_dynamics_ros.nodes.hand_error import HandError
from tactile_dynamics_ros.nodes.names import (
    ESTIMATOR_RESET,
    ESTIMATOR_STATUS,
    INERTIA,
    OBJECT_POSE,
    PROBE_ESTIMATE,
)
from tactile_dynamics_ros.nodes.parameters import declare_config
from tactile_dynamics_ros.nodes.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.nodes.wire import Stamped

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InertialEstimatorConfig:
    """What is listened to, how often an estimate is published, and the model."""

    contacts: tuple[str, ...] = parameter(FINGERS, "names of the contacts on contact/<name>")
    update_rate_hz: float = parameter(10.0, "rate of estimates", "Hz", 0.1, 200.0)
    effects: tuple[str, ...] = parameter((), "effects of the catalogue in the model; live")

    def __post_init__(self) -> None:
        check_ranges(self)


class InertialEstimatorNode(Shell):
    """Feeds the incremental estimator and publishes what it knows.

    Once the friction probe has measured the surface, the share of the friction cone that each
    finger uses is published, and a force that friction could not hold counts as uncertain by at
    least its distance to the cone.
    """

    gather = 0.1

    def __init__(self) -> None:
        super().__init__("inertial_estimator")
        self.estimator = IncrementalInertialEstimator(declare_config(self, IncrementalConfig))
        config = declare_config(
            self, InertialEstimatorConfig, live=["effects"], on_change=self._change_model
        )
        self._change_model(config)
        self._gate = StampGate(OBJECT_POSE)
        self._hand = HandError(self)
        self._last_time = 0.0
        self._friction: tuple[float, float] | None = None
        self._grip: dict[str, object] = {}
        self.listen(DiagnosticStatus, PROBE_ESTIMATE, self._on_friction, LATCHED)
        self.listen(PoseWithCovarianceStamped, OBJECT_POSE, self._on_pose)
        self._contacts = [
            ContactAssembly(self, name, self._on_contact, self._hand) for name in config.contacts
        ]
        self._inertia = self.latched(InertiaStamped, INERTIA)
        self._status = self.latched(DiagnosticArray, ESTIMATOR_STATUS)
        self.serve(ESTIMATOR_RESET, self.reset)
        self.every(1.0 / config.update_rate_hz, self._update)

    def reset(self) -> str:
        """Forget all measurements; the model stays."""
        self.estimator.reset()
        return "all measurements forgotten; the model is kept"

    def _change_model(self, config: InertialEstimatorConfig) -> None:
        self.estimator.set_effects([create_effect(name) for name in config.effects])
        self._model = config.effects

    def _on_pose(self, message: Stamped) -> None:
        pose, covariance = uncertain_pose_to_core(message, OBJECT_POSE, "world")
        if self._gate.check(message.stamp):
            self.faults.add("clock_restarted")
            self.reset()
        time = to_seconds(message.stamp)
        self._hand.add_fused(time, pose)
        self.estimator.add_pose(time, pose, covariance)

    def _on_friction(self, message: DiagnosticStatus) -> None:
        self._friction = friction_range(message) or self._friction

    def _on_contact(self, contact: AssembledContact) -> None:
        self.estimator.add_contact(
            contact.time,
            contact.name,
            contact.point,
            contact.rotation,
            contact.force,
            self._believed_std(contact),
            contact.torque,
        )

    def _believed_std(self, contact: AssembledContact) -> Array | None:
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
            self.faults.show(kind, count)
        if estimate is None or estimate.time == self._last_time and not estimate.pending:
            return
        self._last_time = estimate.time
        self._inertia.publish(inertia_to_message(estimate.inertia, estimate.time, "object"))
        message = DiagnosticArray(header=header(estimate.time, "object"))
        message.status = [*status_of(estimate, self._model), status_message("grip", self._grip)]
        self._status.publish(message)


def status_of(estimate: LiveEstimate, model: Sequence[str]) -> Sequence[DiagnosticStatus]:
    """Return the statuses: parameters with standard deviations, directions, solver, effects.

    Args:
        estimate: the newest.
        model: names of the effects in the model.
    """
    body = estimate.inertia
    tensor = body.inertia_com
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    values = [body.mass, *body.com, *tensor[rows, columns]]
    parameters: dict[str, object] = {}
    for name, value, std in zip(PARAMETER_NAMES, values, estimate.parameter_std, strict=True):
        parameters[name], parameters[f"{name}_std"] = float(value), float(std)
    found = [d.name for d in estimate.directions if d.identified]
    directions = {d.name: d.gain for d in estimate.directions}
    level = DiagnosticStatus.OK if len(found) == len(directions) else DiagnosticStatus.WARN
    text = "; ".join(estimate.remarks) or f"{len(found)} of {len(directions)} directions identified"
    solver: dict[str, object] = {
        "effects": ",".join(model),
        "samples": estimate.samples,
        "duration": estimate.duration,
        "latency": estimate.latency,
        "pending": estimate.pending,
        "rejected": estimate.rejected,
        **estimate.error.to_json(),
    }
    effects = []
    for name, effect in estimate.effects.items():
        entries: dict[str, object] = {}
        for key, entry in effect.to_json().items():
            entries |= {
                key: entry["value"],
                f"{key}_std": entry["std"],
                f"{key}_unit": entry["unit"],
            }
        effects.append(status_message(f"effect {name}", entries))
    return [
        status_message("parameters", parameters, level, text),
        status_message("directions", directions, level, text),
        status_message("solver", solver),
        *effects,
    ]


def main() -> int:
    """Run the node."""
    return run_node(InertialEstimatorNode)
