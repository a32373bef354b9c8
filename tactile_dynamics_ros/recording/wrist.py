"""What the wrist's force/torque sensor carries, hand and object, from the bag of a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.kinematic_tree import chain
from tactile_dynamics_ros.core.robot.robot import Robot
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot
from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.core.streams.streams import PoseStream, Streams
from tactile_dynamics_ros.recording.importers.bag_reader import WRENCH_COLUMNS
from tactile_dynamics_ros.recording.importers.bag_tables import read_topic, topic_types
from tactile_dynamics_ros.recording.importers.joint_angles import link_pose
from tactile_dynamics_ros.recording.recording import Recording

WRENCH = "/wrist/wrench"
JOINTS = "/joint_states"


def read_wrist(
    path: str | Path, robot_name: str | None = None, namespace: str | None = None
) -> Recording:
    """Read what the wrist carries as a held object of its own, in the frame of the flange.

    The flange moves as the joints and the URDF tell. The sensor reports the wrench of the hand on
    the flange; what is carried feels the opposite.

    Args:
        path: bag with `/wrist/wrench` and `/joint_states`.
        robot_name: of the robot whose flange is the frame of the sensor, or path of its yaml file;
            the default robot if None.
        namespace: of the topics; root if None.

    Raises:
        BadInputError: it cannot be read, a topic is missing, or joints of the arm are.
    """
    robot = load_robot(robot_name or DEFAULT_ROBOT)
    prefix = f"/{namespace.strip('/')}" if namespace else ""
    known = topic_types(Path(path))
    lacking = [topic for topic in (prefix + WRENCH, prefix + JOINTS) if topic not in known]
    if lacking:
        raise BadInputError(
            f"{path}: no {' and no '.join(lacking)}; the wrist sensor and the joints of the arm "
            "have to be recorded"
        )
    wrench = read_topic(Path(path), prefix + WRENCH)
    joints = read_topic(Path(path), prefix + JOINTS)
    steps = chain(robot.tree, robot.base, robot.flange)
    moving = [step.name for step in steps if step.axis is not None]
    absent = sorted(set(moving) - set(joints.names))
    if absent:
        raise BadInputError(
            f"{path}: joint '{absent[0]}' of robot '{robot.name}' is not on {JOINTS}; say which "
            "robot it is by --robot"
        )
    return wrist_recording(
        (wrench.column("time"), wrench.columns(*WRENCH_COLUMNS)),
        (joints.column("time"), {name: joints.column(name) for name in moving}),
        robot,
        f"{path}, wrist",
    )


def wrist_recording(
    wrench: tuple[Array, Array],
    joints: tuple[Array, Mapping[str, Array]],
    robot: Robot,
    source: str,
) -> Recording:
    """What the wrist carries, from arrays.

    Args:
        wrench: (N,) s, and (N, 6) force and torque of the hand on the flange, N and N m.
        joints: (M,) s, and (M,) rad or m by name of each joint of the arm.
        robot: its flange is the frame of the sensor.
        source: name for messages to the user.
    """
    steps = chain(robot.tree, robot.base, robot.flange)
    position, rotation = link_pose(steps, joints[1])
    carried = {"time": wrench[0], "force": -wrench[1][:, :3], "torque": -wrench[1][:, 3:]}
    return Recording.from_arrays(
        {"wrist": carried | {"position": np.zeros(3), "rotation": np.eye(3)}},
        {"time": joints[0], "position": position, "rotation": rotation},
        contact_frame="object",
        source=source,
    )


def while_held(wrist: Recording, held: Recording) -> tuple[Streams, PoseStream, PoseStream]:
    """What the wrist carried while contacts pushed the object, on the clock of the contacts.

    Args:
        wrist: of `read_wrist`.
        held: of the fingertips, from the same bag.

    Returns:
        The wrist's streams of that time, the flange's poses in them, and the object's poses.

    Raises:
        BadInputError: the object has no poses, nothing pushes, or the wrist was not read meanwhile.
    """
    contacts = held.streams.contacts.values()
    stamps = np.concatenate([c.time[np.any(c.force != 0.0, axis=1)] for c in contacts])
    if held.streams.pose is None or not len(stamps):
        raise BadInputError("wrist: poses of the object while it is held are needed beside it")
    start, stop = float(stamps.min()), float(stamps.max())
    later = (wrist.epoch_ns - held.epoch_ns) * 1e-9
    part = cut_streams(wrist.streams, start - later, stop - later)
    sensor = part.contacts.get("wrist")
    if part.pose is None or sensor is None or len(sensor.time) < 2:
        raise BadInputError(f"{wrist.source}: nothing was recorded while the object was held")
    flange = replace(part.pose, time=part.pose.time + later)
    sensor = replace(sensor, time=sensor.time + later, pose_time=sensor.pose_time + later)
    poses = cut_streams(held.streams, start, stop).pose
    return (
        replace(part, pose=flange, contacts={"wrist": sensor}),
        flange,
        poses or held.streams.pose,
    )
