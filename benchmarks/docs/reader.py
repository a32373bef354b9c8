"""The files and arrays that readers of the docs bring, made as the pages describe them."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts import WristLog, arms, laboratory
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate, generate_at_whitened_rms
from tactile_dynamics_ros.synthetic.recordings import write_bag

ROOT = Path(__file__).resolve().parents[2]
GRIPPER, LOAD = (0.9, np.array([0.0, 0.004, 0.05])), (0.4, np.array([0.01, -0.006, 0.14]))
"""Mass, kg, and centre, m, of what a wrist carries: the gripper, and a load in it."""
SECONDS = 8.0
"""Length of recordings: the shortest from which viscous drag is told from its neighbours."""
OF_AN_ARM = {"/object/pose": "/tcp_pose", "/contact/wrist/force": "/ft/wrench"}
"""Topics of an arm's bag, by what they are."""
_REMAP = re.compile(r"--remap (\S+):=(\S+)")


def _held(path: Path, text: str, regrasp: bool = False) -> None:
    """Write an object in a hand that drags through something viscous; below 0.6 m, if asked so."""
    effect = "viscous_drag[z<0.6]" if "z<0.6" in text else "viscous_drag"
    options = ScenarioOptions(duration=SECONDS, regrasp=regrasp)
    write_bag(generate_at_whitened_rms(3, {effect: 2.0}, options).streams, path)


def _clean(path: Path, text: str) -> None:
    """Write the same object with nothing that drags at it: an estimate of it is saved."""
    write_bag(generate(3, scenario=ScenarioOptions(duration=SECONDS)).streams, path)


def _wrist(
    path: Path, loads: list[tuple[float, np.ndarray]], torque_unit: float = 1.0, sign: float = 1.0
) -> None:
    """Write what a wrist sensor feels of loads.

    Args:
        path: of the recording.
        loads: mass, kg, and centre, m, of each.
        torque_unit: of the recorded torques, per N m.
        sign: 1 for forces on the load, -1 for those on the sensor.
    """
    log = WristLog.carrying(5, loads, SECONDS)
    measured = {"force": sign * log.force, "torque": sign * torque_unit * log.torque}
    contact = {"time": log.time, "position": np.zeros(3), "rotation": np.eye(3), **measured}
    pose = {"time": log.time, "position": log.position, "rotation": log.rotation.as_matrix()}
    pose |= {"position_std": 1e-4, "rotation_std": 3e-4}
    Recording.from_arrays({"wrist": contact}, pose, contact_frame="object").to_bag(path)


def _run(path: Path, text: str) -> None:
    """Write the recording of most pages: in a hand; on a wrist where torques are the matter."""
    if "torque_unit" in text:
        _wrist(path, [LOAD], torque_unit=1e3)
    else:
        _held(path, text)


def _my_run(path: Path, text: str) -> None:
    """Write a directory with the topics that a command names."""
    named = dict(reversed(found) for found in _REMAP.findall(text))
    if "--guess" in text:
        named = OF_AN_ARM
    straight = path.with_name("straight")
    if "wrist" in text or "--guess" in text:
        _wrist(straight, [LOAD], sign=-1.0 if "force_sign" in text else 1.0)
    else:
        _held(straight, text)
    inside = re.search(r"--namespace (\w+)", text)
    _rename(straight, path, named, f"/{inside[1]}" if inside else "")
    shutil.rmtree(straight)


def _rename(source: Path, target: Path, named: Mapping[str, str], before: str) -> None:
    """Copy a recording under other names of topics; of two that become one the last is copied.

    An arm's bag has one pose, that of the wrist, unless a command names two.
    """
    recorded = {name: meant for meant, name in named.items()}
    with (
        AnyReader([source]) as reader,
        Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        lines = {}
        for own in reader.connections:
            name = named.get(own.topic, own.topic)
            foreign = named and own.topic == "/contact/wrist/pose" == name
            if recorded.get(name, own.topic) == own.topic and not foreign:
                typestore = reader.typestore
                lines[own.topic] = writer.add_connection(
                    before + name, own.msgtype, typestore=typestore
                )
        for own, stamp, raw in reader.messages():
            if own.topic in lines:
                writer.write(lines[own.topic], stamp, raw)


def _cloud(path: Path, text: str) -> None:
    """Write a box of 80 x 50 x 40 mm on a table, or a can alone, with 0.5 mm of noise."""
    random = np.random.default_rng(0)
    if path.suffix == ".pcd":
        angle = random.uniform(0.0, 2.0 * np.pi, 900)
        points = np.column_stack([np.cos(angle), np.sin(angle), random.uniform(0.0, 0.1, 900)])
        points[:, :2] *= 0.027
        points[:300, 2] = 0.1
        points[:300, :2] *= np.sqrt(random.uniform(0.0, 1.0, (300, 1)))
    else:
        table = np.column_stack([random.uniform(-0.2, 0.2, (400, 2)), np.zeros(400)])
        table = table[(np.abs(table[:, 0]) > 0.04) | (np.abs(table[:, 1]) > 0.025)]
        sides = random.uniform(-0.5, 0.5, (500, 3))
        axis = random.choice(3, 500, p=[0.25, 0.35, 0.4])
        sides[np.arange(500), axis] = np.where(axis == 2, 0.5, random.choice([-0.5, 0.5], 500))
        points = np.vstack([table, sides * [0.08, 0.05, 0.04] + [0.0, 0.0, 0.02]])
    points = points + random.normal(0.0, 5e-4, points.shape)
    head = _pcd_head(len(points)) if path.suffix == ".pcd" else _ply_head(len(points))
    rows = "\n".join(f"{x:f} {y:f} {z:f}" for x, y, z in points)
    path.write_text("\n".join(head) + f"\n{rows}\n")


def _ply_head(count: int) -> list[str]:
    lines = ["ply", "format ascii 1.0", f"element vertex {count}"]
    return [*lines, *(f"property float {axis}" for axis in "xyz"), "end_header"]


def _pcd_head(count: int) -> list[str]:
    lines = ["VERSION 0.7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1"]
    lines += [f"WIDTH {count}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {count}"]
    return [*lines, "DATA ascii"]


def _log(path: Path, text: str) -> None:
    """Write a wrist with 1.2 kg and a bias, as a controller logs it."""
    random = np.random.default_rng(1)
    time = np.arange(0.0, 10.0, 0.02)
    turn = Rotation.from_rotvec(0.8 * np.sin(np.outer(time, [2.9, 3.7, 2.1])))
    gravity = turn.inv().apply([0.0, 0.0, -9.81])
    force = 1.2 * gravity + [3.0, -2.0, 5.0] + random.normal(0.0, 0.05, (len(time), 3))
    torque = np.cross([0.01, 0.0, 0.06], 1.2 * gravity) + random.normal(0, 0.003, (len(time), 3))
    place = np.tile([0.4, 0.1, 0.5], (len(time), 1)) + random.normal(0, 1e-4, (len(time), 3))
    rows = np.column_stack([time, place, turn.as_quat(), force, torque])
    names = "time,x,y,z,qx,qy,qz,qw,fx,fy,fz,tx,ty,tz"
    np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.6f")


def _arrays(path: Path, text: str) -> None:
    """Write the same as arrays of one length."""
    table = path.with_suffix(".columns")
    _log(table, text)
    rows = np.genfromtxt(table, delimiter=",", names=True)
    table.unlink()
    np.savez(path, **{name: rows[name] for name in rows.dtype.names})


def _table_of(layout: Callable[[WristLog, Path], list[Path]], made: str) -> Callable[..., None]:
    """Return what writes one of the files of a layout."""

    def write(path: Path, text: str) -> None:
        scratch = path.with_name("layout")
        scratch.mkdir()
        layout(WristLog.draw(400), scratch)
        shutil.move(scratch / made, path)
        shutil.rmtree(scratch)

    return write


def _poses(path: Path, text: str) -> None:
    """Write poses over time, or static poses with their wrenches."""
    if "static-poses" not in text:
        _table_of(laboratory.ati_and_pose, "poses.csv")(path, text)
        return
    laboratory.static_angles(WristLog.draw_static(400), path.parent)
    shutil.move(path.with_name("static.csv"), path)


def _tracker(path: Path, text: str) -> None:
    """Write half a second of an object's poses, for the mapping of docs/recordings.md."""
    rows = "\n".join(f"{10 * k},0,0,500,0,0,0,1" for k in range(50))
    path.write_text(f"t_ms,x,y,z,qx,qy,qz,qw\n{rows}\n")


def _index(path: Path, text: str) -> None:
    """Write the forces of a finger on that object."""
    rows = "\n".join(f"{0.01 * k + 0.008:.3f},-1,-2,-3,0.1,0,0.5,-1,0,0" for k in range(50))
    path.write_text(f"t,fx,fy,fz,px,py,pz,nx,ny,nz\n{rows}\n")


def _runs(path: Path, text: str) -> None:
    """Write a folder of two recordings."""
    path.mkdir()
    for name in "ab":
        _held(path / f"{name}.mcap", text)


def _pushes(path: Path, text: str) -> None:
    """Write pushes of a block."""
    from tactile_dynamics_ros.recording.pushed import PushedRecording
    from tactile_dynamics_ros.synthetic import pushed

    options = pushed.PushOptions("single", pushed.ActionOptions(4, "push", (0.03, 0.2)))
    PushedRecording(pushed.generate([1], {}, options)[0].streams, "pushes").to_bag(path)


FILES: dict[str, Callable[[Path, str], None]] = {
    "run.mcap": _run,
    "first.mcap": _clean,
    "second.mcap": lambda path, text: _held(path, text, regrasp=True),
    "empty.mcap": lambda path, text: _wrist(path, [GRIPPER]),
    "loaded.mcap": lambda path, text: _wrist(path, [GRIPPER, LOAD]),
    "pushes.mcap": _pushes,
    "my_run": _my_run,
    "runs": _runs,
    "cloud.ply": _cloud,
    "can.pcd": _cloud,
    "log.csv": _log,
    "arrays.npz": _arrays,
    "trace.csv": _table_of(arms.kuka, "trace.csv"),
    "hand.csv": _table_of(arms.fingers, "hand.csv"),
    "wrench.csv": _table_of(laboratory.ati_and_pose, "netft.csv"),
    "poses.csv": _poses,
    "tracker.csv": _tracker,
    "index.csv": _index,
    "my_robot.yaml": lambda path, text: shutil.copy(ROOT / "config" / "panda_gripper.yaml", path),
}
"""What writes a reader's file, given its path and the text that names it."""


def arrays() -> dict[str, np.ndarray]:
    """Return the arrays that snippets take as the reader's own, by name."""
    time, ones = np.arange(0.0, 2.0, 0.01), np.ones((200, 1))
    static = WristLog.draw_static(400)
    return {
        "t": time,
        "f": ones * [0.0, 0.0, 2.0],
        "p": ones * [0.0, 0.0, 0.02],
        "n": ones * [0.0, 0.0, 1.0],
        "t_pose": time,
        "p_object": ones * [0.0, 0.0, 0.5],
        "q_object": ones * [0.0, 0.0, 0.0, 1.0],
        "xy": ones * [0.1, 0.2],
        "theta": 0.0 * time,
        "corners": np.array([[-0.04, -0.03], [0.04, -0.03], [0.04, 0.03], [-0.04, 0.03]]),
        "force": static.force,
        "torque": static.torque,
        "q": static.quaternion,
    }
