"""Kinds of files that people hand over: good ones to mutate, and what reads them."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import yaml
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from benchmarks.replay.motion import record_motion
from tactile_dynamics_ros.cli.bringup import read_configuration
from tactile_dynamics_ros.cli.main import main as command
from tactile_dynamics_ros.core.effects.formula import load_effects
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.manipulation.excitation import OffsetTable
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.shape.object_shape import load_shape
from tactile_dynamics_ros.core.tactile.calibration import SHIPPED_CALIBRATION, ForceCalibration
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.recording.clouds import read_clouds
from tactile_dynamics_ros.recording.importers.bag_tables import read_topic, topic_types
from tactile_dynamics_ros.recording.probe_slips import holds_slips
from tactile_dynamics_ros.recording.pushed import PushedRecording, recorded_model
from tactile_dynamics_ros.recording.pushed.known_files import read_known, write_known
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body
from tactile_dynamics_ros.share import share_file

SECONDS = 1.0
"""Length of the recordings, s: enough for every stream, and read at once."""
_LAWS = (
    "-c*v_x",
    "-c*abs(v_x)*v_x/speed_0*exp(-d*speed/speed_0)",
    "max(c*v_x, d*c*v_x)*min(1, speed/speed_0)",
    "c*v_x*sqrt(1+d^2)/(1+cos(d)^2)",
)
"""Laws to mutate; each has something of what formulas may hold."""


@dataclass(frozen=True)
class Kind:
    """A kind of files.

    Attributes:
        seeds: write good files to a folder and return their paths.
        read: reads one as the package does.
        is_text: whether it is mutated as text too.
    """

    seeds: Callable[[Path], Sequence[Path]]
    read: Callable[[Path], object]
    is_text: bool


def _bags(folder: Path) -> list[Path]:
    plain = write_bag(record_motion(0.0, SECONDS), folder / "held.mcap")
    return [
        plain,
        _copied(plain, folder / "packed", StoragePlugin.MCAP, CompressionMode.STORAGE),
        _copied(plain, folder / "rows", StoragePlugin.SQLITE3, CompressionMode.NONE),
        _copied(plain, folder / "messages", StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        _as_ros1(plain, folder / "held.bag"),
    ]


def _copied(bag: Path, directory: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    """Write a recording anew; return its storage file, beside its metadata."""
    types = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(directory, version=9, storage_plugin=storage)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer, Reader(bag) as reader:
        topics = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=types)
            for one in reader.connections
        }
        for one, stamp, data in reader.messages(reader.connections):
            writer.write(topics[one.id], stamp, data)
    return next(path for path in directory.iterdir() if path.suffix in (".mcap", ".db3"))


def _as_ros1(bag: Path, path: Path) -> Path:
    types, old = get_typestore(Stores.ROS2_JAZZY), get_typestore(Stores.ROS1_NOETIC)
    writer = Ros1Writer(path)
    writer.set_compression(Ros1Writer.CompressionFormat.BZ2)
    with writer, Reader(bag) as reader:
        topics = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=old)
            for one in reader.connections
        }
        for one, stamp, data in reader.messages(reader.connections):
            raw = bytes(types.cdr_to_ros1(data, one.msgtype))
            writer.write(topics[one.id], stamp, raw)
    return path


def _read_bag(path: Path) -> None:
    """Read a recording through every door: as streams, as topics of an importer, as a probe's."""
    holds_slips(path)
    if recorded_model(path) == "pushed":
        PushedRecording.from_bag(path)
    else:
        Recording.from_bag(path)
    types = topic_types(path)
    for kind in ("PoseStamped", "WrenchStamped"):
        for topic in [name for name in types if types[name].endswith(kind)][:1]:
            read_topic(path, topic)


def run(*words: object) -> None:
    """Run a verb in this process; what it refuses or cannot tell is an answer.

    Raises:
        BadInputError: it ended with exit code 2, so that the case counts as refused.
    """
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as err,
    ):
        code = command([str(word) for word in words])
    lines = err.getvalue().strip().splitlines()
    if code == 2 and (not lines or not lines[-1].startswith("error: ")):
        raise AssertionError(f"refused without a word: {lines[-1:]}")
    if code:
        raise TactileDynamicsError(lines[-1] if lines else "")


def _tables(folder: Path) -> list[Path]:
    motion = record_motion(0.0, SECONDS)
    pose, contact = motion.pose, motion.contacts["thumb"]
    assert pose is not None
    turns = matrix_to_quaternion(pose.rotation)
    columns = np.column_stack([pose.time, pose.position, turns, contact.force])
    names = "t,x,y,z,qx,qy,qz,qw,fx,fy,fz"
    paths = [folder / "logged.csv", folder / "blanks.txt"]
    np.savetxt(paths[0], columns, "%.6f", ",", header=names, comments="")
    np.savetxt(paths[1], columns, "%.6f", header=names.replace(",", " "))
    return paths


def _read_table(path: Path) -> None:
    run("import", path, "--guess", "--out", path.with_suffix(".mapping.yaml"), "--json")


def _mappings(folder: Path) -> list[Path]:
    [table, _] = _tables(folder)
    mapping = {
        "object_pose": {
            "file": table.name,
            "time": {"columns": ["t"], "unit": "s"},
            "position": {"columns": ["x", "y", "z"], "unit": "m"},
            "quaternion": {"columns": ["qx", "qy", "qz", "qw"], "order": "xyzw"},
        },
        "contacts": {
            "thumb": {
                "file": table.name,
                "time": {"columns": ["t"], "unit": "s"},
                "force": {"columns": ["fx", "fy", "fz"], "unit": "N"},
                "position": {"constant": [0.0, 0.01, -0.04]},
            }
        },
    }
    path = folder / "mapping.yaml"
    path.write_text(yaml.safe_dump(mapping, sort_keys=False))
    return [path]


def _read_mapping(path: Path) -> None:
    run("import", "csv", path, path.with_name(f"{path.stem}.mcap"), "--json")


def _memories(folder: Path) -> list[Path]:
    body = InertialParameters(0.4, np.array([0.01, 0.0, 0.02]), np.diag([9e-4, 7e-4, 5e-4]))
    phi = body.dynamic_parameters
    effects = {"viscous_drag": {"c": {"value": 0.1, "std": 0.02, "unit": "kg/s"}}}
    known = KnownBody(phi, np.diag((0.01 + 0.01 * phi) ** 2), "before", ("mass",), effects, 2)
    pushed = KnownPushed(np.array([1.0, 0.4, 0.01, 0.0]), 1e-3 * np.eye(4), "before")
    return [
        write_body(known, folder / "body.yaml"),
        write_known(pushed, folder / "pushed.yaml"),
        _written(folder / "part.urdf", _PART),
    ]


_PART = """<robot name="part"><link name="hull"><inertial><origin xyz="0 0 0.1" rpy="0 0 0.2"/>
<mass value="0.4"/><inertia ixx="9e-4" iyy="7e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial>
</link></robot>"""
"""A part with known inertia, as a data sheet has it."""


def _read_memory(path: Path) -> None:
    (read_known if path.name.startswith("pushed") else read_body)(path)


def _written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def _effect_files(folder: Path) -> list[Path]:
    paths = []
    for k, law in enumerate(_LAWS):
        entry = {
            "sentence": "it drags",
            "parameters": {
                "c": {"unit": "kg/s", "prior_std": 1.0},
                "d": {"unit": "1", "prior_std": 1.0, "typical": 0.3},
            },
            "constants": {"speed_0": {"value": 0.1, "unit": "m/s"}},
            "definitions": {"twice": "2*c"},
            "wrench": {"force": [law, "-twice*v_y", "0"], "axes": "body", "at": "com"},
        }
        text = yaml.safe_dump({"effects": {f"own_{k}": entry}}, sort_keys=False)
        paths.append(_written(folder / f"own_{k}.yaml", text))
    return paths


def _formulas(folder: Path) -> list[Path]:
    return [_written(folder / f"law_{k}.txt", law) for k, law in enumerate(_LAWS)]


def _read_formula(path: Path) -> None:
    """Read a text as the law of an effect."""
    [file, *_] = _effect_files(path.parent)
    document = yaml.safe_load(file.read_text())
    document["effects"]["own_0"]["wrench"]["force"][0] = path.read_text(errors="replace")
    load_effects(_written(path.with_suffix(".yaml"), yaml.safe_dump(document)))


def _robots(folder: Path) -> list[Path]:
    urdf = share_file("config/robots/allegro_iiwa.urdf").read_text()
    file = share_file("config/robots/allegro_iiwa.yaml").read_text()
    own = _written(folder / "robot.urdf", urdf)
    document = yaml.safe_load(file) | {"urdf": own.name}
    return [own, _written(folder / "robot.yaml", yaml.safe_dump(document, sort_keys=False))]


def _read_robot(path: Path) -> None:
    """Read a robot from its yaml file, or with a URDF in place of its own."""
    load_robot(str(path.with_suffix(".yaml")))


def _settings(folder: Path) -> list[Path]:
    names = ("config/allegro_iiwa.yaml", "config/objects/box_0.yaml")
    copies = [_written(folder / Path(name).name, share_file(name).read_text()) for name in names]
    motion = '{"time": [0.0, 1.0, 2.0], "offsets": [[0, 0, 0, 0, 0, 0], [0.1, 0, 0, 0, 0, 0], '
    motion += "[0, 0, 0, 0, 0, 0]]}"
    calibration = _written(folder / "calibration.json", SHIPPED_CALIBRATION.read_text())
    return [*copies, _written(folder / "motion.json", motion), calibration]


def _read_setting(path: Path) -> None:
    if path.name.startswith("motion"):
        OffsetTable.from_file(path)
    elif path.name.startswith("calibration"):
        ForceCalibration.load(path)
    elif path.name.startswith("box"):
        load_shape(path)
    else:
        read_configuration(path)


def _clouds(folder: Path) -> list[Path]:
    from pypcd4 import PointCloud
    from pypcd4.pypcd4 import Encoding

    box = trimesh.creation.box((0.1, 0.06, 0.04))
    points = np.asarray(trimesh.sample.sample_surface(box, 300, seed=1)[0])
    paths = [folder / name for name in ("a.ply", "b.ply", "c.xyz", "d.npz", "e.obj", "f.stl")]
    cloud = trimesh.PointCloud(points)
    paths[0].write_bytes(cloud.export(file_type="ply"))
    paths[1].write_bytes(box.export(file_type="ply", encoding="ascii"))
    np.savetxt(paths[2], points)
    np.savez_compressed(paths[3], points=points)
    box.export(paths[4])
    box.export(paths[5])
    for encoding in (Encoding.ASCII, Encoding.BINARY, Encoding.BINARY_COMPRESSED):
        path = folder / f"{encoding.value}.pcd"
        PointCloud.from_xyz_points(points.astype(np.float32)).save(path, encoding=encoding)
        paths.append(path)
    return paths


def _read_cloud(path: Path) -> None:
    read_clouds([path])


KINDS: dict[str, Kind] = {
    "bags": Kind(_bags, _read_bag, is_text=False),
    "tables": Kind(_tables, _read_table, is_text=True),
    "mappings": Kind(_mappings, _read_mapping, is_text=True),
    "memories": Kind(_memories, _read_memory, is_text=True),
    "effects": Kind(_effect_files, load_effects, is_text=True),
    "formulas": Kind(_formulas, _read_formula, is_text=True),
    "robots": Kind(_robots, _read_robot, is_text=True),
    "settings": Kind(_settings, _read_setting, is_text=True),
    "clouds": Kind(_clouds, _read_cloud, is_text=False),
}
"""Kinds by name; each gets the same number of cases."""
