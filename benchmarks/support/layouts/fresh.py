"""Layouts that were written last, after the guess: what it does on these is what is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts.wrist_log import WristLog
from benchmarks.support.layouts.writing import axes, numbered, write_table

_START_S = 1_722_000_000
"""Stamp of the first row where stamps count from 1970, s."""
_QUAT = ["qx", "qy", "qz", "qw"]


def fri(log: WristLog, folder: Path) -> list[Path]:
    """A KUKA FRI logger: stamp in two parts, 3x4 matrices by rows, external wrench."""
    names = ["timeSec", "timeNanoSec", *(f"m{i}{j}" for i in range(3) for j in range(4))]
    names += [*axes("extF"), *axes("extM")]
    matrix = np.concatenate([log.rotation.as_matrix(), log.position[:, :, None]], axis=2)
    stamps = _START_S * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    columns = [stamps // 10**9, stamps % 10**9, matrix.reshape(-1, 12), -log.force, -log.torque]
    return [write_table(folder / "fri.csv", names, columns)]


def netbox_and_trajectory(log: WristLog, folder: Path) -> list[Path]:
    """An ATI Net F/T capture and a trajectory in TUM's format."""
    names = ["RDT Sequence", "FT Sequence", "Status", "Fx", "Fy", "Fz", "Tx", "Ty", "Tz", "Time"]
    count = np.arange(len(log.time))
    columns = [count, 7 * count, 0 * count, -log.force, -log.torque, log.time]
    wrench = write_table(folder / "capture.csv", names, columns)
    title = "# timestamp tx ty tz qx qy qz qw\n"
    columns = [log.time, log.position, log.quaternion]
    pose = write_table(folder / "tum.txt", None, columns, separator=" ", before=title)
    return [wrench, pose]


def two_without_names(log: WristLog, folder: Path) -> list[Path]:
    """A trajectory and wrenches, neither with names."""
    pose = [log.time, log.position, log.quaternion]
    wrench = [log.time, log.force, log.torque]
    return [
        write_table(folder / "path.txt", None, pose, separator=" "),
        write_table(folder / "loads.txt", None, wrench, separator=" "),
    ]


def panda_py(log: WristLog, folder: Path) -> list[Path]:
    """A Python client of Franka: underscores, matrices by columns, wrench in axes of the base."""
    matrix = np.tile(np.eye(4), (len(log.time), 1, 1))
    matrix[:, :3, :3], matrix[:, :3, 3] = log.rotation.as_matrix(), log.position
    names = ["t", *numbered("O_T_EE_", 16), *numbered("O_F_ext_hat_K_", 6), *numbered("dq_", 7)]
    wrench = -np.concatenate([log.world_force, log.world_torque], axis=1)
    flat = np.swapaxes(matrix, 1, 2).reshape(-1, 16)
    columns = [log.time, flat, wrench, np.sin(log.time[:, None] + np.arange(7))]
    return [write_table(folder / "panda.csv", names, columns)]


def polyscope(log: WristLog, folder: Path) -> list[Path]:
    """A thread on a UR controller that writes p and f."""
    names = ["time", *(f"p[{k}]" for k in range(6)), *(f"f[{k}]" for k in range(6))]
    pose = np.concatenate([log.position, log.rotation.as_rotvec()], axis=1)
    wrench = -np.concatenate([log.world_force, log.world_torque], axis=1)
    return [write_table(folder / "polyscope.csv", names, [log.time, pose, wrench], separator=";")]


def flattened(log: WristLog, folder: Path) -> list[Path]:
    """Messages flattened by a script: pose_x, pose_qx, wrench_fx."""
    names = ["stamp", *axes("pose_"), *(f"pose_{q}" for q in _QUAT)]
    names += [*axes("wrench_f"), *axes("wrench_t")]
    columns = [_START_S + log.time, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "flat.csv", names, columns, digits=15)]


def link_names(log: WristLog, folder: Path) -> list[Path]:
    """Names of links in front, angles in radians."""
    names = ["time_from_start", *axes("ee_link_"), "ee_link_roll", "ee_link_pitch", "ee_link_yaw"]
    names += [*axes("ft_sensor_f"), *axes("ft_sensor_t")]
    angles = log.rotation.as_euler("xyz")
    columns = [log.time, log.position, angles, -log.force, -log.torque]
    return [write_table(folder / "links.csv", names, columns)]


def onrobot(log: WristLog, folder: Path) -> list[Path]:
    """ISO stamps, rotation vector, everything in one table."""
    stamps = [f"{np.datetime64(round(1e6 * (_START_S + t)), 'us')}Z" for t in log.time]
    names = ["Timestamp", *(f"F{a}" for a in "xyz"), *(f"T{a}" for a in "xyz")]
    names += [*axes("pose_"), "pose_rx", "pose_ry", "pose_rz"]
    columns = [stamps, log.force, log.torque, log.position, log.rotation.as_rotvec()]
    return [write_table(folder / "hex.csv", names, columns)]


def denso(log: WristLog, folder: Path) -> list[Path]:
    """X Y Z in mm, RX RY RZ in degrees, a figure of the arm."""
    names = ["Time[ms]", "X", "Y", "Z", "RX", "RY", "RZ", "Fig"]
    names += [*axes("Force_", "XYZ"), *axes("Moment_", "XYZ")]
    angles = log.rotation.as_euler("xyz", degrees=True)
    figure = np.full(len(log.time), 5)
    columns = [1e3 * log.time, 1e3 * log.position, angles, figure, log.force, log.torque]
    return [write_table(folder / "denso.csv", names, columns, separator=";")]


def millinewtons(log: WristLog, folder: Path) -> list[Path]:
    """A small sensor in mN and mN m."""
    names = ["time_s", *(f"p{a}_mm" for a in "xyz"), *_QUAT]
    names += [*(f"F{a}_mN" for a in "xyz"), *(f"T{a}_mNm" for a in "xyz")]
    columns = [log.time, 1e3 * log.position, log.quaternion, 1e3 * log.force, 1e3 * log.torque]
    return [write_table(folder / "small.csv", names, columns)]


def microseconds(log: WristLog, folder: Path) -> list[Path]:
    """Stamps of sixteen digits in us, quaternion under "ori"."""
    names = ["utime", *axes("pos."), *axes("ori.", "xyzw"), *axes("force."), *axes("torque.")]
    stamps = _START_S * 10**6 + np.rint(1e6 * log.time).astype(np.int64)
    columns = [stamps, log.position, log.quaternion, -log.force, -log.torque]
    return [write_table(folder / "lcm.csv", names, columns)]


def german_export(log: WristLog, folder: Path) -> list[Path]:
    """Measuring software in German: brackets with units, decimal commas, tabs."""
    names = ["Zeit [ms]", *(f"Pos. {a} [mm]" for a in "XYZ"), *axes("Quat ", "wxyz")]
    names += [*(f"Kraft {a} [N]" for a in "XYZ"), *(f"Moment {a} [Nm]" for a in "XYZ")]
    named = np.roll(log.quaternion, 1, axis=1)
    columns = [1e3 * log.time, 1e3 * log.position, named, -log.force, -log.torque]
    path = folder / "messung.txt"
    return [write_table(path, names, columns, separator="\t", decimal=",", encoding="latin-1")]


def bare_numbers(log: WristLog, folder: Path) -> list[Path]:
    """R00 to R22, P0 to P2, F0 to F5."""
    names = ["Time", *(f"R{i}{j}" for i in range(3) for j in range(3))]
    names += [*numbered("P", 3), *numbered("F", 6)]
    wrench = np.concatenate([log.force, log.torque], axis=1)
    columns = [log.time, log.rotation.as_matrix().reshape(-1, 9), log.position, wrench]
    return [write_table(folder / "bare.csv", names, columns)]


def lost_markers(log: WristLog, folder: Path) -> list[Path]:
    """A camera that loses its markers: empty cells in one row of twelve."""
    names = ["time", *axes("pos_"), *axes("rot_", "xyzw"), *axes("f"), *axes("t")]
    cells = np.concatenate([log.position, log.quaternion], axis=1)
    words = [[f"{value:.9g}" for value in row] for row in cells]
    for k in range(5, len(words), 12):
        words[k] = [""] * 7
    parts = [list(column) for column in zip(*words, strict=True)]
    columns = [log.time, *parts, -log.force, -log.torque]
    return [write_table(folder / "markers.csv", names, columns)]


def two_rates(log: WristLog, folder: Path) -> list[Path]:
    """Poses at 33 Hz and wrenches at 100 Hz, stamps since 1970."""
    names = ["ros_time", *axes("translation."), *axes("rotation.", "xyzw")]
    columns = [_START_S + log.time[::3], log.position[::3], log.quaternion[::3]]
    pose = write_table(folder / "vrpn.csv", names, columns, digits=15)
    names = ["ros_time", *axes("wrench.force."), *axes("wrench.torque.")]
    columns = [_START_S + log.time, -log.force, -log.torque]
    return [pose, write_table(folder / "ft.csv", names, columns, digits=15)]


def numbered_quaternion(log: WristLog, folder: Path) -> list[Path]:
    """quat_1 to quat_4 with the scalar last."""
    names = ["t", *(f"pos_{k}" for k in (1, 2, 3)), *(f"quat_{k}" for k in (1, 2, 3, 4))]
    names += [*(f"force_{k}" for k in (1, 2, 3)), *(f"moment_{k}" for k in (1, 2, 3))]
    columns = [log.time, log.position, log.quaternion, log.force, log.torque]
    return [write_table(folder / "numbered.csv", names, columns)]


def static_named_rows(log: WristLog, folder: Path) -> list[Path]:
    """Static poses with a word per row and angles in radians."""
    words = [f"P{k + 1}" for k in range(len(log.time))]
    names = ["Name", "Roll (rad)", "Pitch (rad)", "Yaw (rad)", *axes("F"), *axes("M")]
    columns = [words, log.rotation.as_euler("xyz"), -log.force, -log.torque]
    return [write_table(folder / "named.csv", names, columns)]


def static_matrices(log: WristLog, folder: Path) -> list[Path]:
    """Static poses with matrices, semicolons and decimal commas."""
    names = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    names += [*axes("Force ", "XYZ"), *axes("Torque ", "XYZ")]
    columns = [log.rotation.as_matrix().reshape(-1, 9), log.force, log.torque]
    return [write_table(folder / "static.csv", names, columns, separator=";", decimal=",")]


def simulator(log: WristLog, folder: Path) -> list[Path]:
    """A simulator: steps, simulated time, scalar first, forces in axes of the world."""
    names = ["step", "sim_time", *axes("ee_pos_"), *axes("ee_quat_", "wxyz")]
    names += [*axes("wrist_force_"), *axes("wrist_torque_")]
    named = np.roll(log.quaternion, 1, axis=1)
    step = np.arange(len(log.time)) * 10
    columns = [step, log.time, log.position, named, log.world_force, log.world_torque]
    return [write_table(folder / "sim.csv", names, columns)]


def tags(log: WristLog, folder: Path) -> list[Path]:
    """Rvec and tvec, as computer vision calls them."""
    names = ["timestamp", *axes("tvec_"), *axes("rvec_"), *axes("force_"), *axes("torque_")]
    columns = [log.time, log.position, log.rotation.as_rotvec(), -log.force, -log.torque]
    return [write_table(folder / "tags.csv", names, columns)]


def turned_sensor(log: WristLog, folder: Path) -> list[Path]:
    """A sensor that is mounted at 45 degrees against the flange whose pose is written."""
    mounted = Rotation.from_euler("z", 45.0, degrees=True)
    names = ["t", *axes("p"), *_QUAT, *axes("f"), *axes("t")]
    force, torque = mounted.inv().apply(log.force), mounted.inv().apply(log.torque)
    columns = [log.time, log.position, log.quaternion, force, torque]
    return [write_table(folder / "turned.csv", names, columns)]


def left_handed(log: WristLog, folder: Path) -> list[Path]:
    """A game engine: left-handed axes with y up."""
    mirror = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    turned = Rotation.from_matrix(mirror @ log.rotation.as_matrix() @ mirror)
    names = ["t", *axes("p"), *_QUAT, *axes("f"), *axes("t")]
    columns = [log.time, log.position @ mirror, turned.as_quat(), log.force, log.torque]
    return [write_table(folder / "engine.csv", names, columns)]
