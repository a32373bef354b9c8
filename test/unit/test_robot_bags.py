"""Recordings as drivers of robots write them: any types, clocks, frames and files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts import WristLog
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.bag_tables import read_topic
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables

EPOCH_NS = 1_717_000_000_000_000_000
STORE = get_typestore(Stores.ROS2_JAZZY)
STATE = "driver_msgs/msg/RobotState"
STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nfloat64[16] o_t_ee\nfloat64[16] f_t_ee\nfloat64[16] o_t_ee_d\n"
        "float64[6] o_f_ext_hat_k\nfloat64[6] k_f_ext_hat_k\nfloat64[7] tau_j\nstring mode\n",
        STATE,
    )
)
ARM_URDF = """<robot name="arm"><link name="base"/>
{joints}
<link name="tool0"/><joint name="end" type="fixed"><parent link="c"/><child link="tool0"/>
<origin rpy="0 0 0.7" xyz="0 0 0.1"/></joint></robot>"""
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}


def _made(kind: str, **fields: Any) -> Any:
    name = kind if "/" in kind else f"geometry_msgs/msg/{kind}"
    return STORE.types[name](**fields)


def _header(stamp_ns: int, frame: str = "") -> Any:
    time = _made("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return _made("std_msgs/msg/Header", stamp=time, frame_id=frame)


def _vector(values: np.ndarray, kind: str = "Vector3") -> Any:
    return _made(kind, **dict(zip("xyz", map(float, values), strict=True)))


def _turn(rotation: Rotation) -> Any:
    return _made("Quaternion", **dict(zip("xyzw", map(float, rotation.as_quat()), strict=True)))


def _wrench(force: np.ndarray, torque: np.ndarray) -> Any:
    return _made("Wrench", force=_vector(force), torque=_vector(torque))


def _pose(position: np.ndarray, rotation: Rotation) -> Any:
    return _made("Pose", position=_vector(position, "Point"), orientation=_turn(rotation))


def _static(parent: str, child: str, position: np.ndarray, rotation: Rotation) -> Any:
    step = _made("Transform", translation=_vector(position), rotation=_turn(rotation))
    stamped = _made(
        "TransformStamped", header=_header(0, parent), child_frame_id=child, transform=step
    )
    return _made("tf2_msgs/msg/TFMessage", transforms=[stamped])


@dataclass
class Bag:
    """Messages of one load, to be written as a recording; drivers read the load on the sensor."""

    log: WristLog
    rows: list[tuple[str, int, Any]]

    def add(self, topic: str, make: Any, stamp_offset_ns: int = 0) -> Bag:
        """Add one message per sample, made of row, stamp and force and torque on the sensor."""
        for k, time in enumerate(self.log.time.tolist()):
            received = EPOCH_NS + round(1e9 * time)
            self.rows.append((topic, received, make(k, received + stamp_offset_ns)))
        return self

    def add_poses(self, topic: str = "/tcp_pose", offset_ns: int = 0, body: Any = None) -> Bag:
        """Add stamped poses of the sensor, or of a body from it."""
        place, turn = body or (np.zeros(3), Rotation.identity())

        def made(k: int, stamp: int) -> Any:
            rotation = self.log.rotation[k] * turn
            pose = _pose(self.log.position[k] + self.log.rotation[k].apply(place), rotation)
            return _made("PoseStamped", header=_header(stamp, "base"), pose=pose)

        return self.add(topic, made, offset_ns)

    def add_wrenches(self, frame: str = "ft_frame", topic: str = "/ft/wrench") -> Bag:
        """Add stamped wrenches."""
        return self.add(
            topic,
            lambda k, stamp: _made(
                "WrenchStamped",
                header=_header(stamp, frame),
                wrench=_wrench(-self.log.force[k], -self.log.torque[k]),
            ),
        )

    def write(self, path: Path, plugin: StoragePlugin = StoragePlugin.MCAP, mode: Any = None):
        """Write a rosbag2 directory, of MCAP unless told otherwise."""
        writer = Writer(path, version=9, storage_plugin=plugin)
        if mode is not None:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            known: dict[str, Any] = {}
            for topic, time, message in sorted(self.rows, key=lambda row: row[1]):
                kind = message.__msgtype__
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=STORE)
                writer.write(known[topic], time, STORE.serialize_cdr(message, kind))
        return path


@pytest.fixture
def bag() -> Bag:
    """Return a load of which nothing is written yet."""
    return Bag(WristLog.draw(11, 6.0), [])


def _read(path: Path, **answers: str) -> Recording:
    guess = guess_tables([path], Answers(answers))
    assert guess.question == ""
    return read_mapping(guess.mapping, path.parent, "mapping")


def _require_load(recording: Recording, log: WristLog) -> None:
    """Check that forces on the load and poses of the sensor are those of the log."""
    pose, wrist = recording.streams.pose, recording.streams.contacts["wrist"]
    assert (Rotation.from_matrix(pose.rotation).inv() * log.rotation).magnitude().max() < 1e-5
    np.testing.assert_allclose(pose.position, log.position, atol=1e-6)
    np.testing.assert_allclose(wrist.force, log.rotation.apply(log.force), atol=1e-4)
    np.testing.assert_allclose(wrist.torque, log.rotation.apply(log.torque), atol=1e-4)


def _unstamped(log: WristLog, kind: str, k: int) -> Any:
    force, torque = -log.force[k], -log.torque[k]
    if kind == "Wrench":
        return _wrench(force, torque)
    if kind == "Twist":
        return _made("Twist", linear=_vector(force), angular=_vector(torque))
    layout = _made("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    data = np.concatenate([force, torque])
    return _made("std_msgs/msg/Float64MultiArray", layout=layout, data=data)


@pytest.mark.parametrize("kind", ["Wrench", "Twist", "Float64MultiArray"])
def test_messages_without_stamps_are_taken_at_their_receive_times(bag, tmp_path, kind):
    bag.add_poses().add("/ft_sensor/data", lambda k, _: _unstamped(bag.log, kind, k))
    recording = _read(bag.write(tmp_path / "run"))
    _require_load(recording, bag.log)
    [line] = [line for line in recording.problem_lines() if "receive" in line]
    assert line.startswith("/ft_sensor/data, unstamped: taken at their receive times")


def test_an_unstamped_wrench_may_be_remapped(bag, tmp_path):
    bag.add_poses().add("/ft", lambda k, _: _unstamped(bag.log, "Wrench", k))
    remap = {"/tcp_pose": "/object/pose", "/ft": "/contact/wrist/force"}
    recording = Recording.from_bag(bag.write(tmp_path / "run"), remap=remap)
    wrist = recording.streams.contacts["wrist"]
    np.testing.assert_allclose(wrist.force, -bag.log.rotation.apply(bag.log.force), atol=1e-6)
    assert "unstamped: taken at their receive times" in "".join(recording.problem_lines())


def _state(log: WristLog, k: int, stamp: int) -> Any:
    """Return a state as that of Franka's driver, matrices column by column."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = log.rotation[k].as_matrix(), log.position[k]
    own = -np.concatenate([log.force[k], log.torque[k]])
    base = np.concatenate([log.rotation[k].apply(part) for part in (own[:3], own[3:])])
    return _made(
        STATE,
        header=_header(stamp, "base"),
        o_t_ee=pose.T.ravel(),
        f_t_ee=np.eye(4).ravel(),
        o_t_ee_d=(pose + 0.01).T.ravel(),
        o_f_ext_hat_k=base,
        k_f_ext_hat_k=own,
        tau_j=np.arange(7.0),
        mode="move",
    )


def test_the_state_of_a_driver_is_read_by_the_definition_in_the_recording(bag, tmp_path):
    path = bag.add("/robot_state", lambda k, stamp: _state(bag.log, k, stamp)).write(tmp_path / "r")
    _require_load(_read(path), bag.log)
    table = read_topic(path, "/robot_state", field="o_t_ee")
    assert table.names == ("time", *(str(k) for k in range(16)))
    np.testing.assert_allclose(table.values[:, 13:16], bag.log.position)


def test_a_field_that_is_not_there_is_refused_with_those_that_are(bag, tmp_path):
    path = bag.add("/robot_state", lambda k, stamp: _state(bag.log, k, stamp)).write(tmp_path / "r")
    with pytest.raises(BadInputError, match="no field 'o_t_e'; it has header, o_t_ee, f_t_ee"):
        read_topic(path, "/robot_state", field="o_t_e")


def test_topics_of_a_ur_driver(bag, tmp_path):
    bag.add_poses("/tcp_pose_broadcaster/pose")
    bag.add_wrenches("tool0", "/force_torque_sensor_broadcaster/wrench")
    _require_load(_read(bag.write(tmp_path / "ur")), bag.log)


def test_of_wrenches_in_two_frames_that_of_the_sensor_is_taken(bag, tmp_path):
    bag.add_poses("/broadcaster/current_pose").add_poses("/broadcaster/last_desired_pose")
    bag.add_wrenches("arm_link0", "/broadcaster/wrench_in_base_frame")
    bag.add_wrenches("arm_link8", "/broadcaster/wrench_in_stiffness_frame")
    path = bag.write(tmp_path / "run")
    _require_load(_read(path), bag.log)
    topics = guess_tables([path]).mapping["contacts"]["wrist"]["topic"]
    assert topics == "/broadcaster/wrench_in_stiffness_frame"
    other = guess_tables([path], Answers({"wrench": "/broadcaster/wrench_in_base_frame"}))
    assert other.mapping["contacts"]["wrist"]["topic"] == "/broadcaster/wrench_in_base_frame"


@pytest.mark.parametrize("topic", ["/tool0_pose", "/arm/cartesian"])
def test_a_sensor_is_turned_as_tf_static_says(bag, tmp_path, topic):
    place, turn = np.array([0.02, 0.0, -0.05]), Rotation.from_euler("z", -45.0, degrees=True)
    bag.add_poses(topic, body=(place, turn)).add_wrenches("ft_frame")
    inverse = -turn.inv().apply(place)
    bag.rows.append(("/tf_static", EPOCH_NS, _static("tool0", "ft_frame", inverse, turn.inv())))
    _require_load(_read(bag.write(tmp_path / "run")), bag.log)


def test_a_remapped_sensor_is_turned_as_tf_static_says(bag, tmp_path):
    turn = Rotation.from_euler("z", -45.0, degrees=True)
    bag.add_poses("/pose", body=(np.zeros(3), turn)).add_wrenches("ft_frame")
    step = _static("tool0", "ft_frame", np.zeros(3), turn.inv())
    bag.rows.append(("/tf_static", EPOCH_NS, step))
    remap = {"/pose": "/object/pose", "/ft/wrench": "/contact/wrist/force"}
    recording = Recording.from_bag(bag.write(tmp_path / "run"), remap=remap)
    wrist = recording.streams.contacts["wrist"]
    np.testing.assert_allclose(wrist.force, -bag.log.rotation.apply(bag.log.force), atol=1e-6)
    lines = "".join(recording.problem_lines())
    assert "of 'tool0', on which 'ft_frame' sits turned by 45 deg" in lines


def _arm(log: WristLog) -> tuple[str, np.ndarray]:
    """Return an arm of three slides and three joints, and its positions (N, 6)."""
    kinds = [("prismatic", a) for a in "xyz"] + [("revolute", a) for a in "zyx"]
    names = ["base", "p", "q", "r", "a", "b", "c"]
    joints = "".join(
        f'<link name="{names[k + 1]}"/><joint name="j{k}" type="{kind}"><parent '
        f'link="{names[k]}"/><child link="{names[k + 1]}"/><axis xyz="{AXES[axis]}"/>'
        '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
        for k, (kind, axis) in enumerate(kinds)
    )
    wrist = log.rotation * Rotation.from_euler("z", -0.7)
    place = log.position - wrist.apply([0.0, 0.0, 0.1])
    return ARM_URDF.format(joints=joints), np.hstack([place, wrist.as_euler("ZYX")])


def _joint_state(stamp: int, positions: np.ndarray) -> Any:
    names = [f"j{k}" for k in range(len(positions))]
    none = np.zeros(0)
    return _made(
        "sensor_msgs/msg/JointState",
        header=_header(stamp),
        name=names[::-1],
        position=positions[::-1].copy(),
        velocity=none,
        effort=none,
    )


@pytest.mark.parametrize("in_bag", [True, False])
def test_joint_angles_and_a_urdf_stand_for_a_pose(bag, tmp_path, in_bag):
    urdf, positions = _arm(bag.log)
    bag.add("/joint_states", lambda k, stamp: _joint_state(stamp, positions[k])).add_wrenches()
    if in_bag:
        bag.rows.append(("/robot_description", EPOCH_NS, _made("std_msgs/msg/String", data=urdf)))
    path = bag.write(tmp_path / "arm")
    (tmp_path / "arm.urdf").write_text(urdf)
    _require_load(_read(path, **({} if in_bag else {"urdf": "arm.urdf"})), bag.log)


def test_joints_of_a_gripper_on_the_same_topic_do_not_disturb_those_of_the_arm(bag, tmp_path):
    urdf, positions = _arm(bag.log)
    bag.add("/joint_states", lambda _, stamp: _joint_state(stamp, np.ones(1)))
    bag.add("/joint_states", lambda k, stamp: _joint_state(stamp, positions[k])).add_wrenches()
    (tmp_path / "arm.urdf").write_text(urdf)
    recording = _read(bag.write(tmp_path / "arm"), urdf="arm.urdf")
    _require_load(recording, bag.log)
    assert "messages with fewer joints (left out)" in "".join(recording.problem_lines())


def test_joint_angles_without_a_urdf_ask_for_one(bag, tmp_path):
    _, positions = _arm(bag.log)
    bag.add("/joint_states", lambda k, stamp: _joint_state(stamp, positions[k])).add_wrenches()
    assert "say --urdf FILE" in guess_tables([bag.write(tmp_path / "arm")]).question


def test_stamps_of_two_clocks_are_read_as_proposed(bag, tmp_path, capsys):
    path = bag.add_poses(offset_ns=-(10**15)).add_wrenches().write(tmp_path / "run")
    command = ["import", "bag", str(path), str(tmp_path / "out.mcap")]
    assert main(command) == 2
    assert "say --stamps receive" in capsys.readouterr().err
    assert main([*command, "--stamps", "receive"]) == 0
    _require_load(_read(path, stamps="receive"), bag.log)
    assert np.ptp(Recording.from_bag(tmp_path / "out.mcap").streams.pose.time) > 5.9


def test_a_contract_on_two_clocks_is_read_at_receive_times_if_told(bag, tmp_path):
    bag.add_poses("/object/pose", -(10**15)).add_wrenches("ft_frame", "/contact/wrist/force")
    path = bag.write(tmp_path / "run")
    with pytest.raises(BadInputError, match="never overlap; .* say --stamps receive"):
        Recording.from_bag(path)
    wrist = Recording.from_bag(path, stamps="receive").streams.contacts["wrist"]
    np.testing.assert_allclose(wrist.force, -bag.log.rotation.apply(bag.log.force), atol=1e-6)


def test_the_bag_of_a_robot_is_estimated_with_one_command(bag, tmp_path, capsys):
    urdf, positions = _arm(bag.log)
    (tmp_path / "arm.urdf").write_text(urdf)
    bag.add("/joint_states", lambda k, stamp: _joint_state(stamp, positions[k])).add_wrenches()
    command = ["estimate", str(bag.write(tmp_path / "arm")), "--effects", "force_bias", "--json"]
    assert main(command) == 2
    assert "say --urdf FILE" in capsys.readouterr().err
    assert main([*command, "--urdf", str(tmp_path / "arm.urdf")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert abs(found["mass"]["value"] - bag.log.mass) < 3.0 * found["mass"]["std"]
    np.testing.assert_allclose(found["com"]["value"], bag.log.com, atol=2e-3)


@pytest.mark.parametrize("mode", [None, CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_storage_and_compression_do_not_matter(bag, tmp_path, plugin, mode):
    if plugin is StoragePlugin.MCAP and mode is CompressionMode.FILE:
        pytest.skip("rosbag2 does not write it")
    path = bag.add_poses().add_wrenches().write(tmp_path / "run", plugin, mode)
    _require_load(_read(path), bag.log)


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_parts_of_a_split_recording_are_joined_in_order(bag, tmp_path, plugin):
    (tmp_path / "run").mkdir()
    bag.add_poses().add_wrenches()
    rows, count = sorted(bag.rows, key=lambda row: row[1]), len(bag.rows) // 12
    for k in range(12):
        last = len(rows) if k == 11 else (k + 1) * count
        part = Bag(bag.log, rows[k * count : last]).write(tmp_path / f"part_{k}", plugin)
        [file] = [f for f in part.iterdir() if f.suffix in (".mcap", ".db3")]
        file.rename(tmp_path / "run" / f"run_{k}{file.suffix}")
    _require_load(_read(tmp_path / "run"), bag.log)
    remap = {"/tcp_pose": "/object/pose", "/ft/wrench": "/contact/wrist/force"}
    recording = Recording.from_bag(tmp_path / "run", remap=remap)
    assert len(recording.streams.pose.time) == len(bag.log.time)
    assert "jumps" not in "".join(recording.problem_lines())


def test_a_recording_of_ros_1_in_two_files(bag, tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    (tmp_path / "run").mkdir()
    half = len(bag.log.time) // 2
    for part, rows in enumerate((range(half), range(half, len(bag.log.time)))):
        with Ros1Writer(tmp_path / "run" / f"run_{part}.bag") as writer:
            pose, twist = (
                writer.add_connection(topic, f"geometry_msgs/msg/{kind}", typestore=store)
                for topic, kind in (("/tcp", "Pose"), ("/atift_sensor/data", "Twist"))
            )
            for k in rows:
                time = EPOCH_NS + round(1e9 * bag.log.time[k])
                message = _pose(bag.log.position[k], bag.log.rotation[k])
                writer.write(pose, time, store.serialize_ros1(message, pose.msgtype))
                message = _unstamped(bag.log, "Twist", k)
                writer.write(twist, time, store.serialize_ros1(message, twist.msgtype))
    _require_load(_read(tmp_path / "run"), bag.log)


def test_a_type_that_cannot_be_read_does_not_hide_the_others(bag, tmp_path):
    bag.add_poses().add_wrenches().add("/state", lambda k, stamp: _state(bag.log, k, stamp))
    path = bag.write(tmp_path / "run")
    [file] = path.glob("*.mcap")
    content = file.read_bytes()
    assert b"string mode" in content
    file.write_bytes(content.replace(b"string mode", b"?tring mode"))
    _require_load(_read(path), bag.log)


def test_a_load_whose_weight_was_zeroed_is_read_by_its_motion(tmp_path):
    log = WristLog.draw(12, 6.0)
    still = Rotation.from_euler("y", 90.0, degrees=True)
    time = log.time
    moved = np.stack([0 * time, 0.25 * np.sin(4.0 * time), 0 * time], axis=1)
    acceleration = -16.0 * moved
    force = 2.0 * still.inv().apply(acceleration)
    log = WristLog(
        time, moved, still * Rotation.identity(len(time)), force, 0.0 * force, 2.0, log.com
    )
    bag = Bag(log, []).add_poses().add_wrenches()
    guess = guess_tables([bag.write(tmp_path / "run")])
    assert guess.question == ""
    assert guess.mapping["contacts"]["wrist"]["force"]["scale"] == -1.0
    [text] = [text for label, text in guess.understood if label == "weight"]
    assert "none in the forces" in text and "about 2 kg" in text
