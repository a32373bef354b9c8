"""Node: torques and wrench of the world on an arm without a wrist sensor, by its joint torques."""

from __future__ import annotations

import json
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
    WrenchStamped,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.effects import JOINTS
from tactile_dynamics_ros.core.joints.estimate import refit
from tactile_dynamics_ros.core.joints.live import (
    ExternalTorque,
    JointMonitor,
    KnownArm,
    MonitorConfig,
)
from tactile_dynamics_ros.core.joints.model import SHORTEST
from tactile_dynamics_ros.core.reading import read_text
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.conversions import (
    MessageError,
    pose_to_message,
    std_to_message,
    uncertain_pose_to_message,
    wrench_to_message,
)
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.friction_messages import WORLD
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.names import (
    JOINT_STATES,
    MONITOR_EXTERNAL,
    MONITOR_MODEL,
    MONITOR_STATUS,
    MONITOR_VALID,
    MONITOR_WRENCH,
    MONITOR_WRENCH_STD,
    OBJECT_POSE,
    ROBOT_DESCRIPTION,
    contact_topic,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.stream_clock import StreamClock
from tactile_dynamics_ros.ros.wire import Joints, encode_joint_state, to_stamp

KEPT = 0.1
"""Age of the oldest pose that is told after a pause, s: what the filter of wrench_compensator
bridges. Nothing older belongs to the motion that goes on."""


@dataclass(frozen=True)
class JointMonitorConfig:
    """Which arm it is, and its model."""

    model: str = parameter("", "file of `estimate --save` of a recording of this arm")
    urdf: str = parameter("", "URDF of the arm; empty: as on robot_description")
    effects: tuple[str, ...] = parameter(
        (), "effects of joints, fitted to the newest measurements; empty: as in the file; live"
    )
    contact: str = parameter(
        "",
        "name of a contact as which the flange is told too, as a wrist sensor would: its wrench "
        "with all that the model does not carry on contact/<name>, its pose as object/pose; "
        "empty: not",
    )
    rate_hz: float = parameter(25.0, "rate of the answers", "Hz", 1.0, 200.0)


class JointMonitorNode(Shell):
    """Publishes model torque, external torque, and the wrench at the flange, with their doubts."""

    def __init__(self) -> None:
        super().__init__("joint_monitor")
        self._averaging = declare_config(self, MonitorConfig)
        self.monitor: JointMonitor | None = None
        self._urdf = ""
        self._wanted: tuple[str, ...] = ()
        self._fit_from = -np.inf
        self._background: Background | None = None
        self._fitting: Future[KnownArm] | None = None
        config = declare_config(
            self, JointMonitorConfig, live=["effects"], on_change=self._change_model
        )
        self._change_model(config)
        self._known = _read_known(config.model) if config.model else None
        self._sensor = FlangeSensor(self, config.contact) if config.contact else None
        if self._known is None:
            self.get_logger().warning("parameter model is empty; give a file of `estimate --save`")
        self._told = -np.inf
        self._time = StreamClock(self)
        self._time.on_move.append(self._begin_anew)
        if config.urdf:
            self._on_urdf(read_text(Path(config.urdf), "a URDF"))
        else:
            self.listen(String, ROBOT_DESCRIPTION, lambda m: self._on_urdf(m.data), LATCHED)
        self.listen(JointState, JOINT_STATES, self._on_joints, need=Need.ALWAYS)
        self._model = self.stream(JointState, MONITOR_MODEL)
        self._external = self.stream(JointState, MONITOR_EXTERNAL)
        self._wrench = self.stream(WrenchStamped, MONITOR_WRENCH)
        self._wrench_std = self.stream(WrenchStamped, MONITOR_WRENCH_STD)
        self._valid = self.latched(Bool, MONITOR_VALID)
        self._status = self.latched(DiagnosticArray, MONITOR_STATUS)
        self.every(1.0 / config.rate_hz, self._tell)

    def _on_urdf(self, text: str) -> None:
        if self._known is None or self.monitor is not None:
            return
        arm = Arm.from_urdf(text, self._known.joints, ROBOT_DESCRIPTION)
        self.monitor, self._urdf = JointMonitor(arm, self._known, self._averaging), text
        self._warn_of(self._known)

    def _warn_of(self, known: KnownArm) -> None:
        for name in known.left_out:
            self.get_logger().warning(f"effect {name} depends on the past; it is left out live")

    def destroy_node(self) -> None:
        """Stop the background work too."""
        if self._background is not None:
            self._background.close()
        super().destroy_node()

    def _change_model(self, config: JointMonitorConfig) -> str:
        """Take other effects; return what they are fitted to."""
        labels = tuple(name for name in config.effects if name)
        JOINTS.create_all([label.partition(":")[0] for label in labels])
        self._wanted = labels
        if self._background is not None:
            self._background.drop()
        self._fitting, self._fit_from = None, -np.inf
        if not labels:
            if self.monitor is not None and self._known is not None:
                self.monitor.known = self._known
            return "the model of the file"
        self._background = self._background or Background()
        span, least = (0.0 if self.monitor is None else self.monitor.span), SHORTEST
        names = f"{', '.join(labels)} will be fitted"
        if span < least:
            return f"{names} once {least:g} s of motion were measured"
        return f"{names} to the last {span:.0f} s; nothing may have touched the arm meanwhile"

    def _advance_fit(self) -> None:
        """Begin the fit that is wanted, once enough was measured, and take it over."""
        if self.monitor is None or not self._wanted or self._background is None:
            return
        newest = self._time.newest
        if self._fitting is None:
            if self.monitor.span >= SHORTEST and newest >= self._fit_from:
                asked = self.monitor.recent(self._urdf), self._wanted, self.monitor.known
                self._fitting = self._background.submit(refit, *asked)
            return
        if not self._fitting.done():
            return
        done, self._fitting = self._fitting, None
        try:
            self.monitor.known, self._wanted = done.result(), ()
        except TactileDynamicsError as error:
            self._fit_from = newest + SHORTEST
            self.faults.add("not_fitted", str(error))
            return
        self._warn_of(self.monitor.known)

    def _begin_anew(self) -> None:
        self._told = -np.inf

    def _on_joints(self, message: Joints) -> None:
        if self.monitor is None or not set(self.monitor.arm.names) <= set(message.names):
            return
        if len(message.efforts) != len(message.names):
            raise MessageError(
                "no_effort", f"{JOINT_STATES}: no effort; expected one of each joint"
            )
        places = [message.names.index(name) for name in self.monitor.arm.names]
        position, effort = message.positions[places], message.efforts[places]
        if not (np.isfinite(position).all() and np.isfinite(effort).all()):
            raise MessageError("not_finite", f"{JOINT_STATES}: a position or effort is no number")
        self.monitor.add(self._time.admit(message.stamp, JOINT_STATES), position, effort)

    def _tell(self) -> None:
        self._advance_fit()
        found = None if self.monitor is None else self.monitor.latest()
        if self.monitor is None or found is None or found.time <= self._told:
            return
        if self._sensor is not None:
            self._sensor.tell(self.monitor, max(self._told, found.time - KEPT), found)
        self._told = found.time
        names, stamp = self.monitor.arm.names, to_stamp(found.time)
        nothing = np.zeros(0)
        for publisher, torque in ((self._model, found.predicted), (self._external, found.external)):
            publisher.publish(encode_joint_state(names, stamp, nothing, effort=torque))
        frame = self.monitor.arm.flange
        self._wrench.publish(wrench_to_message(found.wrench, found.time, frame))
        self._wrench_std.publish(wrench_to_message(found.wrench_std, found.time, frame))
        self._valid.publish(Bool(data=not found.doubt))
        self._status.publish(self._status_of(names, found))

    def _status_of(self, names: tuple[str, ...], found: ExternalTorque) -> DiagnosticArray:
        touched = [names[j] for j in found.touched(self._averaging.significance)]
        if found.doubt:
            level, text = DiagnosticStatus.WARN, found.doubt
        elif touched:
            level, text = DiagnosticStatus.OK, f"something touches the arm: {', '.join(touched)}"
        else:
            level, text = DiagnosticStatus.OK, "nothing touches the arm beyond noise"
        pairs = zip(names, found.external, found.std, strict=True)
        effects = () if self.monitor is None else self.monitor.known.labels
        values: dict[str, object] = {"touched": ",".join(touched), "effects": ",".join(effects)}
        for name, torque, std in pairs:
            values |= {name: float(torque), f"{name}_std": float(std)}
        message = DiagnosticArray(status=[status_message("external", values, level, text)])
        message.header.stamp = self.get_clock().now().to_msg()
        return message


class FlangeSensor:
    """Tells wrench and pose of the flange as a wrist sensor and a tracker do.

    Stamps end with those of the wrench, so that who listens knows the motion when it comes.

    Args:
        node: that publishes.
        name: of the contact.
    """

    def __init__(self, node: Shell, name: str) -> None:
        self._force = node.stream(WrenchStamped, contact_topic(name, "force"))
        self._std = node.stream(Vector3Stamped, contact_topic(name, "force_std"))
        self._place = node.stream(PoseStamped, contact_topic(name, "pose"))
        self._pose = node.stream(PoseWithCovarianceStamped, OBJECT_POSE)

    def tell(self, monitor: JointMonitor, since: float, found: ExternalTorque) -> None:
        """Publish poses since a time, s, and what the arm applies on what it carries.

        A wrench that is in doubt is left out.
        """
        time, poses = monitor.flange_poses(since, found.time)
        for stamp, pose in zip(time.tolist(), poses, strict=True):
            self._place.publish(pose_to_message(pose, stamp, WORLD))
            self._pose.publish(uncertain_pose_to_message(pose, np.zeros((6, 6)), stamp, WORLD))
        if found.doubt or not len(time):
            return
        turn = poses[-1, :3, :3]
        wrench = -(found.wrench.reshape(2, 3) @ turn.T).reshape(6)
        std = np.sqrt(turn**2 @ found.wrench_std[3:] ** 2)
        self._std.publish(std_to_message(std, found.time, WORLD))
        self._force.publish(wrench_to_message(wrench, found.time, WORLD))


def _read_known(path: str) -> KnownArm:
    """Read the model of an arm.

    Raises:
        BadInputError: it cannot be read, or is something else.
    """
    try:
        document = json.loads(read_text(Path(path), "a model of an arm"))
    except json.JSONDecodeError as error:
        raise BadInputError(
            f"{path}: no JSON ({error}); give a file of `estimate --save`"
        ) from error
    return KnownArm.from_document(document, path)


def main() -> int:
    """Run the node."""
    return run_node(JointMonitorNode)
