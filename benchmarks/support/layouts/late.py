"""Twenty more layouts, written when the guess read all others: its figures are from these."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.support.layouts.wrist_log import WristLog
from benchmarks.support.layouts.writing import axes, numbered, write_table

_START_S = 1_725_000_000
"""Stamp of the first row where stamps count from 1970, s."""


def mujoco(log: WristLog, folder: Path) -> list[Path]:
    """A simulation script: scalar first, numbered forces and torques."""
    names = ["time", *axes("ee_"), "ee_qw", "ee_qx", "ee_qy", "ee_qz"]
    names += [*numbered("sensor_f", 3), *numbered("sensor_t", 3)]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [log.time, log.position, named, log.force, log.torque]
    return [write_table(folder / "mj.csv", names, columns)]


def date_and_time(log: WristLog, folder: Path) -> list[Path]:
    """Date and time in two columns, mm, angles that turn along."""
    words = []
    for t in log.time:
        seconds = 3600.0 * 13 + 60.0 * 7 + t
        words.append(f"13:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}")
    names = ["Date", "Time", "X", "Y", "Z", "Rx", "Ry", "Rz", *axes("F"), *axes("M")]
    angles = log.rotation.as_euler("XYZ", degrees=True)
    dates = ["2024-08-30"] * len(words)
    columns = [dates, words, 1e3 * log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "staubli.csv", names, columns)]


def kawasaki(log: WristLog, folder: Path) -> list[Path]:
    """X Y Z O A T: angles about z, y and z again."""
    names = ["t[s]", "X", "Y", "Z", "O", "A", "T", "Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    angles = log.rotation.as_euler("ZYZ", degrees=True)
    columns = [log.time, 1e3 * log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "kawasaki.csv", names, columns, separator="\t")]


def dotted(log: WristLog, folder: Path) -> list[Path]:
    """Members of structures of a PLC."""
    names = ["TimeStamp", *axes("Pose.Position.", "XYZ"), *axes("Pose.Orientation.", "XYZW")]
    names += [*axes("Wrench.Force.", "XYZ"), *axes("Wrench.Torque.", "XYZ")]
    stamps = np.rint(1e3 * log.time).astype(np.int64)
    columns = [stamps, 1e3 * log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "plc.csv", names, columns, separator=";")]


def influx(log: WristLog, folder: Path) -> list[Path]:
    """A data base's export: stamps in words, names of measurements beside numbers."""
    stamps = [f"{np.datetime64(round(1e6 * (_START_S + t)), 'us')}Z" for t in log.time]
    names = ["result", "table", "_time", *axes("force_"), *axes("torque_"), *axes("position_")]
    names += axes("quaternion_", "wxyz")
    count = len(stamps)
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [["_result"] * count, [0] * count, stamps, log.force, log.torque, log.position, named]
    return [write_table(folder / "influx.csv", names, columns)]


def nanoseconds(log: WristLog, folder: Path) -> list[Path]:
    """Stamps since 1970 in nanoseconds under "ts"."""
    names = ["ts", *axes("tcp_pos_"), *axes("tcp_rot_", "xyzw"), *axes("ft_f"), *axes("ft_t")]
    stamps = _START_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    columns = [stamps, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "ts.csv", names, columns)]


def quoted(log: WristLog, folder: Path) -> list[Path]:
    """Every cell in quotation marks, decimal commas between commas."""
    names = ["time", *axes("pos "), *axes("quat ", "xyzw"), *axes("force "), *axes("torque ")]
    columns = [log.time, log.position, log.quaternion, log.force, log.torque]
    plain = write_table(folder / "quoted.csv", names, columns, separator=";", decimal=",")
    lines = plain.read_text().splitlines()
    plain.write_text("\n".join(",".join(f'"{c}"' for c in line.split(";")) for line in lines))
    return [plain]


def bars(log: WristLog, folder: Path) -> list[Path]:
    """Cells between bars."""
    names = ["time", *axes("p_"), *axes("q_", "xyzw"), *axes("F_"), *axes("T_")]
    columns = [log.time, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "bars.txt", names, columns, separator=" | ")]


def aligned(log: WristLog, folder: Path) -> list[Path]:
    """Columns aligned by blanks, units in brackets below the names."""
    names = ["Time", "x", "y", "z", "roll", "pitch", "yaw", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
    units = "[s] [mm] [mm] [mm] [deg] [deg] [deg] [N] [N] [N] [Nmm] [Nmm] [Nmm]"
    angles = log.rotation.as_euler("xyz", degrees=True)
    columns = [log.time, 1e3 * log.position, angles, -log.force, -1e3 * log.torque]
    path = folder / "aligned.dat"
    return [write_table(path, names, columns, separator="   ", after_names=units)]


def greek(log: WristLog, folder: Path) -> list[Path]:
    """phi, theta and psi in radians."""
    names = ["t", "x", "y", "z", "phi", "theta", "psi", *axes("F"), *axes("M")]
    columns = [log.time, log.position, log.rotation.as_euler("xyz"), -log.force, -log.torque]
    return [write_table(folder / "greek.csv", names, columns)]


def short_names(log: WristLog, folder: Path) -> list[Path]:
    """p.x, q.w, F.z, T.z."""
    names = ["sec", *axes("p."), *axes("q.", "xyzw"), *axes("F."), *axes("T.")]
    columns = [log.time, log.position, log.quaternion, log.force, log.torque]
    return [write_table(folder / "short.csv", names, columns)]


def raw_with_units(log: WristLog, folder: Path) -> list[Path]:
    """Units behind "raw", torques in N cm."""
    names = ["Time [ms]", *(f"Pos_{a} [cm]" for a in "xyz"), *axes("Quat_", "wxyz")]
    names += [*(f"F{a}_raw [N]" for a in "xyz"), *(f"M{a}_raw [Ncm]" for a in "xyz")]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [1e3 * log.time, 1e2 * log.position, named, -log.force, -1e2 * log.torque]
    return [write_table(folder / "raw.csv", names, columns)]


def transform_rows(log: WristLog, folder: Path) -> list[Path]:
    """T0 to T15, row by row."""
    matrix = np.tile(np.eye(4), (len(log.time), 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = log.rotation.as_matrix(), log.position
    names = ["time", *numbered("tool_T", 16), *numbered("wrench_", 6)]
    wrench = -np.concatenate([log.force, log.torque], axis=1)
    return [write_table(folder / "rows.csv", names, [log.time, matrix.reshape(-1, 16), wrench])]


def xarm(log: WristLog, folder: Path) -> list[Path]:
    """xArm: mm and degrees, external force in six numbers."""
    names = ["timestamp", "x", "y", "z", "roll", "pitch", "yaw"]
    names += [f"ext_force[{k}]" for k in range(6)]
    angles = log.rotation.as_euler("xyz", degrees=True)
    wrench = -np.concatenate([log.force, log.torque], axis=1)
    columns = [_START_S + log.time, 1e3 * log.position, angles, wrench]
    return [write_table(folder / "xarm.csv", names, columns, digits=15)]


def vectors_without_names(log: WristLog, folder: Path) -> list[Path]:
    """Time, position, rotation vector, force, torque; no names."""
    columns = [log.time, log.position, log.rotation.as_rotvec(), -log.force, -log.torque]
    return [write_table(folder / "vectors.txt", None, columns)]


def forces_first_without_names(log: WristLog, folder: Path) -> list[Path]:
    """Time, force, torque, position, quaternion with the scalar first; no names."""
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [log.time, log.force, log.torque, log.position, named]
    return [write_table(folder / "forces.txt", None, columns, separator="\t")]


def static_angles_without_names(log: WristLog, folder: Path) -> list[Path]:
    """Roll, pitch and yaw in degrees, force, torque, row by row; no names."""
    angles = log.rotation.as_euler("xyz", degrees=True)
    return [write_table(folder / "rows.txt", None, [angles, -log.force, -log.torque])]


def static_with_stamps(log: WristLog, folder: Path) -> list[Path]:
    """Means of static poses with the second at which each was taken."""
    names = ["time", *axes("p"), *axes("q", "xyzw"), *axes("f"), *axes("t")]
    stamps = 6.0 * log.time + 0.35
    columns = [stamps, log.position, log.quaternion, log.force, log.torque]
    return [write_table(folder / "means.csv", names, columns)]


def two_styles(log: WristLog, folder: Path) -> list[Path]:
    """Poses at 50 Hz in mm and degrees, wrenches at 100 Hz in milliseconds of the same clock."""
    names = ["Time(s)", "X(mm)", "Y(mm)", "Z(mm)", "Roll(deg)", "Pitch(deg)", "Yaw(deg)"]
    angles = log.rotation.as_euler("xyz", degrees=True)
    columns = [log.time[::2], 1e3 * log.position[::2], angles[::2]]
    pose = write_table(folder / "tracker.csv", names, columns)
    names = ["ms", *axes("Force"), *axes("Torque")]
    columns = [1e3 * log.time, -log.force, -log.torque]
    return [pose, write_table(folder / "cell.csv", names, columns, separator=";", decimal=",")]


def yaw_first(log: WristLog, folder: Path) -> list[Path]:
    """Yaw, pitch and roll in this order, and a counter without time of its own but "elapsed"."""
    names = ["frame", "elapsed", "yaw", "pitch", "roll", *axes("pos_"), *axes("f_"), *axes("tau_")]
    angles = log.rotation.as_euler("xyz", degrees=True)[:, ::-1]
    frame = np.arange(len(log.time))
    columns = [frame, log.time, angles, log.position, log.force, log.torque]
    return [write_table(folder / "yaw.csv", names, columns)]
