"""Logs as drivers and interfaces of robot arms write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.support.layouts.wrist_log import WristLog
from benchmarks.support.layouts.writing import axes, numbered, write_table

EPOCH_S = 1_717_000_000
"""Stamp of the first row where stamps count from 1970."""


def rtde(log: WristLog, folder: Path) -> list[Path]:
    """Universal Robots' RTDE recorder: blanks, rotation vector, wrench in axes of the base."""
    names = ["timestamp", *numbered("actual_q_", 6), *numbered("actual_TCP_pose_", 6)]
    names += [*numbered("actual_TCP_speed_", 6), *numbered("actual_TCP_force_", 6)]
    joints = 0.3 * np.sin(log.time[:, None] + np.arange(6))
    pose = np.concatenate([log.position, log.rotation.as_rotvec()], axis=1)
    speed = np.gradient(pose, log.time, axis=0)
    wrench = -np.concatenate([log.world_force, log.world_torque], axis=1)
    stamps = 5123.4 + log.time
    columns = [stamps, joints, pose, speed, wrench]
    return [write_table(folder / "rtde.csv", names, columns, separator=" ")]


def libfranka(log: WristLog, folder: Path) -> list[Path]:
    """Franka's state log: matrices by columns, wanted values beside measured ones."""
    matrix = np.tile(np.eye(4), (len(log.time), 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = log.rotation.as_matrix(), log.position
    flat = np.swapaxes(matrix, 1, 2).reshape(-1, 16)
    names = ["time", *(f"O_T_EE[{k}]" for k in range(16)), *(f"O_T_EE_d[{k}]" for k in range(16))]
    names += [f"q[{k}]" for k in range(7)] + [f"K_F_ext_hat_K[{k}]" for k in range(6)]
    joints = 0.3 * np.cos(log.time[:, None] + np.arange(7))
    wrench = -np.concatenate([log.force, log.torque], axis=1)
    columns = [log.time, flat, np.roll(flat, 1, axis=0), joints, wrench]
    return [write_table(folder / "state.csv", names, columns)]


def kuka(log: WristLog, folder: Path) -> list[Path]:
    """A KUKA trace on a German computer: mm, A B C in degrees, decimal commas."""
    angles = log.rotation.as_euler("ZYX", degrees=True)
    names = ["Zeit [s]", "X [mm]", "Y [mm]", "Z [mm]", "A", "B", "C"]
    names += [f"Kraft {a} [N]" for a in "XYZ"] + [f"Moment {a} [Nm]" for a in "XYZ"]
    columns = [log.time, 1e3 * log.position, angles, -log.force, -log.torque]
    path = folder / "trace.csv"
    return [write_table(path, names, columns, separator=";", decimal=",", encoding="latin-1")]


def rostopic_echo(log: WristLog, folder: Path) -> list[Path]:
    """`rostopic echo -p` of a wrench and of a pose: two files, stamps in nanoseconds."""
    stamps = EPOCH_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    head = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    late = stamps + 1_500_000
    count = np.arange(len(stamps))
    frames = [["base_link"] * len(stamps), ["ft_sensor"] * len(stamps)]
    pose = write_table(
        folder / "pose.csv",
        [*head, *axes("field.pose.position."), *axes("field.pose.orientation.", "xyzw")],
        [late, count, stamps, frames[0], log.position, log.quaternion],
        digits=12,
    )
    wrench = write_table(
        folder / "wrench.csv",
        [*head, *axes("field.wrench.force."), *axes("field.wrench.torque.")],
        [late, count, stamps, frames[1], -log.force, -log.torque],
        digits=12,
    )
    return [pose, wrench]


def plotjuggler(log: WristLog, folder: Path) -> list[Path]:
    """PlotJuggler's export of two topics."""
    names = [
        "__time",
        *axes("/tcp_pose/pose/position/"),
        *axes("/tcp_pose/pose/orientation/", "xyzw"),
    ]
    names += [*axes("/ft_sensor/wrench/force/"), *axes("/ft_sensor/wrench/torque/")]
    columns = [EPOCH_S + log.time, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "export.csv", names, columns, digits=14)]


def sec_nanosec(log: WristLog, folder: Path) -> list[Path]:
    """A script on ROS 2 that writes both parts of the stamp."""
    stamps = EPOCH_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    names = [
        "header.stamp.sec",
        "header.stamp.nanosec",
        *axes("position."),
        *axes("orientation.", "xyzw"),
    ]
    names += [*axes("force."), *axes("torque.")]
    columns = [stamps // 10**9, stamps % 10**9, log.position, log.quaternion, log.force, log.torque]
    return [write_table(folder / "both.csv", names, columns)]


def fingers(log: WristLog, folder: Path) -> list[Path]:
    """A hand with two fingers and a thumb, in axes of the world."""
    points = {"index": (0.03, 0.02, 0.0), "middle": (0.03, -0.02, 0.0), "thumb": (-0.03, 0.0, 0.0)}
    names = ["t", *axes("object_p"), *axes("object_q", "xyzw")]
    columns: list[np.ndarray] = [log.time, log.position, log.quaternion]
    squeeze = {"index": (-2.0, 0.0, 0.0), "middle": (-2.0, 0.0, 0.0), "thumb": (4.0, 0.0, 0.0)}
    for finger, point in points.items():
        names += [*axes(f"{finger}_f"), *axes(f"{finger}_p")]
        force = log.world_force / 3.0 + log.rotation.apply(squeeze[finger])
        columns += [force, log.position + log.rotation.apply(point)]
    return [write_table(folder / "hand.csv", names, columns)]
