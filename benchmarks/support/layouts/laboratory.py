"""Logs as sensors, cameras and programs of a laboratory write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.support.layouts.wrist_log import WristLog
from benchmarks.support.layouts.writing import axes, numbered, write_table

_WRENCH = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]


def ati_and_pose(log: WristLog, folder: Path) -> list[Path]:
    """An ATI sensor's file with a preamble and torques in N mm, and a file of poses."""
    preamble = "ATI Industrial Automation\nSerial: FT12345\nCalibration: SI-130-10\n\n"
    names = ["Time (s)", "Status", *(f"{w} ({'N' if w[0] == 'F' else 'N-mm'})" for w in _WRENCH)]
    status = ["0x00000000"] * len(log.time)
    columns = [log.time, status, -log.force, -1e3 * log.torque]
    wrench = write_table(folder / "netft.csv", names, columns, before=preamble)
    names = ["time", *axes("p"), "qw", "qx", "qy", "qz"]
    named = np.roll(log.quaternion, 1, axis=1)
    return [wrench, write_table(folder / "poses.csv", names, [log.time, log.position, named])]


def optitrack(log: WristLog, folder: Path) -> list[Path]:
    """Motive's export: several lines of titles, y up; the wrench in a file of its own."""
    to_file = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    turned = type(log.rotation).from_matrix(to_file @ log.rotation.as_matrix())
    before = "Format Version,1.23,Take Name,Take 7,Capture Frame Rate,100\n\n"
    width = 7
    before += ",,Type" + ",Rigid Body" * width + "\n,,Name" + ",Tool" * width + "\n"
    before += ",," + ",".join(["Rotation"] * 4 + ["Position"] * 3) + "\n"
    before = before.replace(",,Type", ",Type").replace(",,Name", ",Name")
    names = ["Frame", "Time (Seconds)", "X", "Y", "Z", "W", "X", "Y", "Z"]
    frame = np.arange(len(log.time))
    columns = [frame, log.time, turned.as_quat(), log.position @ to_file.T]
    pose = write_table(folder / "take.csv", names, columns, before=before)
    names = ["time_s", *axes("force_"), *axes("torque_")]
    wrench = write_table(folder / "wrench.csv", names, [log.time, log.force, log.torque])
    return [pose, wrench]


def vicon(log: WristLog, folder: Path) -> list[Path]:
    """Nexus-like table: a row of units, mm, helical angles in degrees, wrench beside it."""
    names = ["Time", "RX", "RY", "RZ", "TX", "TY", "TZ", *_WRENCH[:3], "Mx", "My", "Mz"]
    units = ",".join(
        ["s", "deg", "deg", "deg", "mm", "mm", "mm", "N", "N", "N", "Nmm", "Nmm", "Nmm"]
    )
    before = "Segments\n100\n"
    turn = np.degrees(log.rotation.as_rotvec())
    columns = [log.time, turn, 1e3 * log.position, -log.force, -1e3 * log.torque]
    path = folder / "nexus.csv"
    return [write_table(path, names, columns, before=before, after_names=units)]


def matlab_without_names(log: WristLog, folder: Path) -> list[Path]:
    """`writematrix` with tabs and decimal commas, no names."""
    columns = [log.time, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "data.txt", None, columns, separator="\t", decimal=",")]


def numpy_savetxt(log: WristLog, folder: Path) -> list[Path]:
    """`savetxt` with names in a comment, quaternion with w first."""
    named = np.roll(log.quaternion, 1, axis=1)
    title = "# t px py pz qw qx qy qz fx fy fz tx ty tz\n"
    columns = [log.time, log.position, named, log.force, log.torque]
    return [write_table(folder / "log.txt", None, columns, separator=" ", before=title)]


def integer_quaternions(log: WristLog, folder: Path) -> list[Path]:
    """An IMU board's quaternions as integers of 16384, q0 to q3, time in whole milliseconds."""
    named = np.rint(16384 * np.roll(log.quaternion, 1, axis=1)).astype(np.int64)
    names = ["ms", *axes("pos_"), *numbered("q", 4), *axes("f"), *axes("m")]
    stamps = np.rint(1e3 * log.time).astype(np.int64)
    columns = [stamps, log.position, named, log.force, log.torque]
    return [write_table(folder / "board.csv", names, columns)]


def roll_pitch_yaw(log: WristLog, folder: Path) -> list[Path]:
    """Angles in degrees, position in mm, units behind underscores."""
    angles = log.rotation.as_euler("xyz", degrees=True)
    names = ["t_ms", "x_mm", "y_mm", "z_mm", "roll_deg", "pitch_deg", "yaw_deg"]
    names += ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"]
    columns = [1e3 * log.time, 1e3 * log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "angles.csv", names, columns)]


def labview(log: WristLog, folder: Path) -> list[Path]:
    """LabVIEW on a computer with decimal commas: UTF-16, tabs, times of day."""
    clock = [_clock(36000.0 + t) for t in log.time]
    names = ["Uhrzeit", "Pos X", "Pos Y", "Pos Z", "Quat W", "Quat X", "Quat Y", "Quat Z"]
    names[0] = "Time"
    names += [f"Force {a}" for a in "XYZ"] + [f"Torque {a}" for a in "XYZ"]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [clock, log.position, named, log.force, log.torque]
    path = folder / "labview.txt"
    return [write_table(path, names, columns, separator="\t", decimal=",", encoding="utf-16")]


def matrices(log: WristLog, folder: Path) -> list[Path]:
    """Rotation matrices by rows, time in seconds, forces first."""
    names = ["time", *axes("f"), *axes("t"), *axes("p")]
    names += [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    flat = log.rotation.as_matrix().reshape(-1, 9)
    columns = [log.time, -log.force, -log.torque, log.position, flat]
    return [write_table(folder / "matrices.csv", names, columns)]


def unlabelled_turn(log: WristLog, folder: Path) -> list[Path]:
    """X y z rx ry rz of which nobody says what rx is: Euler angles in degrees."""
    angles = log.rotation.as_euler("xyz", degrees=True)
    names = ["time", "x", "y", "z", "rx", "ry", "rz", *axes("F"), *axes("M")]
    columns = [log.time, log.position, angles, log.force, log.torque]
    return [write_table(folder / "turn.csv", names, columns)]


def static_angles(log: WristLog, folder: Path) -> list[Path]:
    """A spreadsheet of static poses: angles in degrees, no time."""
    angles = log.rotation.as_euler("xyz", degrees=True)
    names = ["pose", "roll", "pitch", "yaw", *(w for w in _WRENCH)]
    number = np.arange(1, len(log.time) + 1)
    columns = [number, angles, -log.force, -log.torque]
    path = folder / "static.csv"
    return [write_table(path, names, columns, separator=";", decimal=",", end=";")]


def static_without_names(log: WristLog, folder: Path) -> list[Path]:
    """Quaternions and wrenches of static poses without names."""
    columns = [log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "poses.txt", None, columns, separator=" ")]


def _clock(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60.0)
    return f"{int(minutes // 60):02d}:{int(minutes % 60):02d}:{rest:06.3f}".replace(".", ",")
