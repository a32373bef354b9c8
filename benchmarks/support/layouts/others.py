"""Further layouts, which nothing was tuned on: they tell how a guess does on files it never saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.support.layouts.wrist_log import WristLog
from benchmarks.support.layouts.writing import axes, numbered, write_table

_POUND_N = 4.4482216152605
"""Newtons of a pound of force."""
_START_S = 1_714_557_600
"""2024-05-01 10:00 UTC, s since 1970."""


def robotiq_and_pose(log: WristLog, folder: Path) -> list[Path]:
    """A Robotiq sensor's file in ms, and poses of the arm in mm with a rotation vector."""
    names = ["Time[ms]", *(f"F{a}[N]" for a in "XYZ"), *(f"M{a}[Nm]" for a in "XYZ")]
    columns = [1e3 * log.time, -log.force, -log.torque]
    wrench = write_table(folder / "ft300.csv", names, columns, separator="; ")
    names = ["t", "X(mm)", "Y(mm)", "Z(mm)", "RX(rad)", "RY(rad)", "RZ(rad)"]
    columns = [log.time, 1e3 * log.position, log.rotation.as_rotvec()]
    return [wrench, write_table(folder / "arm.csv", names, columns)]


def bota(log: WristLog, folder: Path) -> list[Path]:
    """A Bota sensor beside an end effector's pose, stamps in us."""
    names = ["timestamp_us", *axes("force", "XYZ"), *axes("torque", "XYZ"), "temperature"]
    names += [*axes("ee_"), *axes("ee_q", "xyzw")]
    stamps = np.rint(1e6 * log.time).astype(np.int64) + 123_456
    warm = np.full(len(stamps), 31.5)
    columns = [stamps, -log.force, -log.torque, warm, log.position, log.quaternion]
    return [write_table(folder / "bota.csv", names, columns)]


def matlab_table(log: WristLog, folder: Path) -> list[Path]:
    """`writetable`, which turns brackets of names into underscores."""
    names = ["Time_s_", "X_mm_", "Y_mm_", "Z_mm_", "qw", "qx", "qy", "qz"]
    names += ["Fx_N_", "Fy_N_", "Fz_N_", "Mx_Nm_", "My_Nm_", "Mz_Nm_"]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [log.time, 1e3 * log.position, named, -log.force, -log.torque]
    return [write_table(folder / "table.csv", names, columns)]


def qualisys(log: WristLog, folder: Path) -> list[Path]:
    """QTM's 6DOF export: key and value lines, matrices by columns; the wrench in another file."""
    before = "NO_OF_FRAMES\t2000\nNO_OF_BODIES\t1\nFREQUENCY\t100\nBODY_NAMES\tTool\n"
    names = ["Frame", "Time", "X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"]
    names += [f"Rot[{k}]" for k in range(9)]
    angles = log.rotation.as_euler("XYZ", degrees=True)
    flat = np.swapaxes(log.rotation.as_matrix(), 1, 2).reshape(-1, 9)
    frame, left = np.arange(1, len(log.time) + 1), np.full(len(log.time), 0.3)
    columns = [frame, log.time, 1e3 * log.position, angles, left, flat]
    pose = write_table(folder / "body.tsv", names, columns, separator="\t", before=before)
    names = ["Time", *axes("Force_", "XYZ"), *axes("Moment_", "XYZ")]
    wrench = write_table(
        folder / "plate.tsv", names, [log.time, log.force, log.torque], separator="\t"
    )
    return [pose, wrench]


def abb(log: WristLog, folder: Path) -> list[Path]:
    """ABB's EGM: mm, q1 to q4 with the scalar first."""
    names = ["time", "x", "y", "z", "q1", "q2", "q3", "q4", "fx", "fy", "fz", "tx", "ty", "tz"]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [log.time, 1e3 * log.position, named, log.force, log.torque]
    return [write_table(folder / "egm.csv", names, columns, separator=";")]


def fanuc(log: WristLog, folder: Path) -> list[Path]:
    """FANUC: X Y Z in mm, W P R about x, y and z in degrees."""
    names = ["TIME", "X", "Y", "Z", "W", "P", "R", "FX", "FY", "FZ", "MX", "MY", "MZ"]
    angles = log.rotation.as_euler("xyz", degrees=True)
    columns = [log.time, 1e3 * log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "fanuc.txt", names, columns, separator=" ")]


def intrinsic_angles(log: WristLog, folder: Path) -> list[Path]:
    """Rx ry rz that turn along, in degrees."""
    names = ["time", "x", "y", "z", "rx", "ry", "rz", *axes("f"), *axes("t")]
    angles = log.rotation.as_euler("XYZ", degrees=True)
    columns = [log.time, log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "xyz.csv", names, columns)]


def doosan(log: WristLog, folder: Path) -> list[Path]:
    """Doosan: angles about z, y and z again, in degrees."""
    names = ["time", "x", "y", "z", "a", "b", "c", *axes("f"), *axes("m")]
    angles = log.rotation.as_euler("ZYZ", degrees=True)
    columns = [log.time, 1e3 * log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "doosan.csv", names, columns)]


def kinova(log: WristLog, folder: Path) -> list[Path]:
    """Kinova's feedback: tool pose with angles in degrees, wrench in axes of the base."""
    names = ["timestamp", *axes("tool_pose_"), *axes("tool_pose_theta_")]
    names += [*axes("tool_external_wrench_force_"), *axes("tool_external_wrench_torque_")]
    angles = log.rotation.as_euler("xyz", degrees=True)
    columns = [log.time, log.position, angles, -log.world_force, -log.world_torque]
    return [write_table(folder / "kinova.csv", names, columns)]


def world_to_body(log: WristLog, folder: Path) -> list[Path]:
    """A quaternion that turns the world into the sensor's axes."""
    inverse = log.quaternion * [-1.0, -1.0, -1.0, 1.0]
    names = ["t", *axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("t")]
    columns = [log.time, log.position, inverse, log.force, log.torque]
    return [write_table(folder / "inverse.csv", names, columns)]


def pandas_dates(log: WristLog, folder: Path) -> list[Path]:
    """`DataFrame.to_csv` with an index without name and dates."""
    words = [
        str(np.datetime64(round(1e6 * (_START_S + t)), "us")).replace("T", " ") for t in log.time
    ]
    names = [
        "",
        "timestamp",
        *axes("pos_"),
        *axes("quat_", "xyzw"),
        *axes("force_"),
        *axes("torque_"),
    ]
    index = np.arange(len(words))
    columns = [index, words, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "frame.csv", names, columns)]


def spreadsheet(log: WristLog, folder: Path) -> list[Path]:
    """A German spreadsheet: dates, decimal commas, a row of units, torques in N mm."""
    words = []
    for t in log.time:
        clock = np.datetime64(round(1e3 * (_START_S + t)), "ms").astype(object)
        words.append(clock.strftime("%d.%m.%Y %H:%M:%S,") + f"{clock.microsecond // 1000:03d}")
    names = ["Zeit", "x", "y", "z", "roll", "pitch", "yaw", *axes("F"), *axes("M")]
    units = "-;mm;mm;mm;deg;deg;deg;N;N;N;Nmm;Nmm;Nmm"
    angles = log.rotation.as_euler("xyz", degrees=True)
    columns = [words, 1e3 * log.position, angles, -log.force, -1e3 * log.torque]
    path = folder / "tabelle.csv"
    return [write_table(path, names, columns, separator=";", decimal=",", after_names=units)]


def bagpy(log: WristLog, folder: Path) -> list[Path]:
    """Bagpy's tables of two topics with time, secs and nsecs."""
    stamps = _START_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    head = ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id"]
    start = [stamps * 1e-9, np.arange(len(stamps)), stamps // 10**9, stamps % 10**9]
    pose = write_table(
        folder / "tcp-pose.csv",
        [*head, *axes("pose.position."), *axes("pose.orientation.", "xyzw")],
        [*start, ["base"] * len(stamps), log.position, log.quaternion],
        digits=16,
    )
    wrench = write_table(
        folder / "ft-wrench.csv",
        [*head, *axes("wrench.force."), *axes("wrench.torque.")],
        [*start, ["ft"] * len(stamps), -log.force, -log.torque],
        digits=16,
    )
    return [pose, wrench]


def pounds(log: WristLog, folder: Path) -> list[Path]:
    """An American calibration: pounds and inch pounds."""
    names = ["Time (s)", *(f"F{a} (lbf)" for a in "xyz"), *(f"T{a} (lbf-in)" for a in "xyz")]
    names += [*axes("Pos ", "XYZ"), *axes("Quat ", "WXYZ")]
    named = np.roll(log.quaternion, 1, axis=1)
    torque = -log.torque / (_POUND_N * 0.0254)
    columns = [log.time, -log.force / _POUND_N, torque, log.position, named]
    return [write_table(folder / "pounds.csv", names, columns)]


def static_vectors(log: WristLog, folder: Path) -> list[Path]:
    """A teach pendant's list of poses with rotation vectors, readings beside them."""
    names = ["X", "Y", "Z", "RX", "RY", "RZ", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
    columns = [1e3 * log.position, log.rotation.as_rotvec(), -log.force, -log.torque]
    return [write_table(folder / "teach.csv", names, columns)]


def static_kuka(log: WristLog, folder: Path) -> list[Path]:
    """Static poses with A B C in degrees and times of day."""
    words = [f"09:{k // 2:02d}:{30 * (k % 2):02d}" for k in range(len(log.time))]
    names = ["time", "A", "B", "C", "FX", "FY", "FZ", "TX", "TY", "TZ"]
    angles = log.rotation.as_euler("ZYX", degrees=True)
    columns = [words, angles, log.force, log.torque]
    return [write_table(folder / "static_kuka.csv", names, columns, separator="\t")]


def no_time(log: WristLog, folder: Path) -> list[Path]:
    """Samples of a motion, and nothing that tells their rate."""
    names = [*axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("t")]
    columns = [log.position, log.quaternion, log.force, log.torque]
    return [write_table(folder / "untimed.csv", names, columns)]


def compensated(log: WristLog, folder: Path) -> list[Path]:
    """A controller's wrench from which it has taken the weight of the load."""
    left = np.random.default_rng(1).normal(size=log.force.shape)
    names = ["time", *axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("t")]
    columns = [log.time, log.position, log.quaternion, 0.3 * left, 0.02 * left]
    return [write_table(folder / "compensated.csv", names, columns)]


def ros2_echo(log: WristLog, folder: Path) -> list[Path]:
    """`ros2 topic echo --csv` of two topics: no names, both parts of the stamp, a frame."""
    stamps = _START_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    start = [stamps // 10**9, stamps % 10**9]
    count = len(stamps)
    pose = [*start, ["base_link"] * count, log.position, log.quaternion]
    wrench = [*start, ["tool0"] * count, -log.force, -log.torque]
    return [
        write_table(folder / "pose.csv", None, pose),
        write_table(folder / "wrench.csv", None, wrench),
    ]


def milliseconds_unsaid(log: WristLog, folder: Path) -> list[Path]:
    """Whole milliseconds under "time", w first in q0 to q3, raw and filtered forces."""
    names = ["time", *axes("pos."), *numbered("q", 4), *axes("f_raw_"), *axes("tau_raw_")]
    named = np.roll(log.quaternion, 1, axis=1)
    stamps = np.rint(1e3 * log.time).astype(np.int64)
    columns = [stamps, log.position, named, -log.force, -log.torque]
    return [write_table(folder / "raw.csv", names, columns)]
