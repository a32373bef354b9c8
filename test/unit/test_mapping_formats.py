"""Formats of ordinary robot data that a mapping or a bag may have, one test each."""

from __future__ import annotations

import tarfile
import time
from argparse import Namespace

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from benchmarks.support.layouts import WristLog
from benchmarks.support.layouts.bags import kuka_ros1, panda_poses, ur_frames
from benchmarks.support.layouts.writing import write_table
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.csv_mapping import CsvMappingImporter
from tactile_dynamics_ros.recording.importers.tables import read_table

MAPPING = """
contact_frame: object
object_pose:
  file: log.csv
  time: {{columns: [{time}]}}
  position: {{columns: [x, y, z]}}
  {turn}
contacts:
  wrist:
    file: log.csv
    time: {{columns: [{time}]}}
    force: {{columns: [fx, fy, fz], scale: {scale}}}
    position: [0, 0, 0]
    {more}
"""


@pytest.fixture
def log():
    """Return what an arm with a load did."""
    return WristLog.draw(8, 3.0)


@pytest.fixture
def read(log, tmp_path):
    """Return a function that writes a table and a mapping of it, and reads them."""

    def _read(
        columns, turn, force=None, scale="1.0", more="", time="t", top="", stamps=None, **text
    ):
        names = [*time.split(", "), "x", "y", "z", *columns, "fx", "fy", "fz"]
        force = log.force if force is None else force
        stamps = [log.time] if stamps is None else stamps
        parts = [*stamps, log.position, *columns.values(), force]
        write_table(tmp_path / "log.csv", names, parts, **text)
        mapping = MAPPING.format(time=time, turn=turn, scale=scale, more=more) + top
        (tmp_path / "mapping.yaml").write_text(mapping)
        return CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())

    return _read


def _require_same(recording, log, rotation=None, force=None):
    rotation = log.rotation if rotation is None else rotation
    force = log.force if force is None else force
    pose, wrist = recording.streams.pose, recording.streams.contacts["wrist"]
    assert (Rotation.from_matrix(pose.rotation).inv() * rotation).magnitude().max() < 1e-5
    np.testing.assert_allclose(pose.time, log.time, atol=1e-6)
    np.testing.assert_allclose(wrist.force, rotation.apply(force), atol=1e-4)


def _columns(names, values):
    return dict(zip(names, values.T, strict=True))


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_rotation_vectors(log, read, unit):
    vector = log.rotation.as_rotvec(degrees=unit == "deg")
    turn = f"rotation_vector: {{columns: [rx, ry, rz], unit: {unit}}}"
    _require_same(read(_columns(["rx", "ry", "rz"], vector), turn), log)


@pytest.mark.parametrize("order", ["xyz", "ZYX", "ZYZ", "XYZ"])
def test_euler_angles_in_degrees(log, read, order):
    angles = log.rotation.as_euler(order, degrees=True)
    turn = f"euler: {{columns: [a, b, c], order: {order}, unit: deg}}"
    _require_same(read(_columns("abc", angles), turn), log)


@pytest.mark.parametrize("length", [1.0, 16384.0, 0.01])
def test_quaternions_of_any_length_scalar_first(log, read, length):
    named = length * np.roll(log.quaternion, 1, axis=1)
    turn = "quaternion: {columns: [q0, q1, q2, q3], order: wxyz}"
    _require_same(read(_columns(["q0", "q1", "q2", "q3"], named), turn), log)


def test_quaternions_of_any_length_in_arrays(log):
    pose = {"time": log.time, "position": log.position, "quaternion": 7.0 * log.quaternion}
    contact = {"time": log.time, "force": log.force, "position": [0, 0, 0]}
    recording = Recording.from_arrays({"wrist": contact}, pose, contact_frame="object")
    _require_same(recording, log)


def test_rotations_of_the_world_in_the_body_are_inverted(log, read):
    named = log.quaternion * [-1.0, -1.0, -1.0, 1.0]
    turn = "quaternion: {columns: [a, b, c, w], inverse: true}"
    _require_same(read(_columns("abcw", named), turn), log)


NAMED = "quaternion: {columns: [qx, qy, qz, qw]}"


def _named(log):
    return _columns(["qx", "qy", "qz", "qw"], log.quaternion)


def test_signs_per_axis(log, read):
    signs = np.array([-1.0, 1.0, -1.0])
    recording = read(_named(log), NAMED, force=signs * log.force, scale="[-1, 1, -1]")
    _require_same(recording, log)


def test_a_constant_rotation_of_the_sensor(log, read):
    mounted = Rotation.from_euler("xyz", [0.0, 90.0, 30.0], degrees=True)
    more = "sensor_rotation: {euler: [0, 90, 30], order: xyz, unit: deg}"
    recording = read(_named(log), NAMED, force=mounted.inv().apply(log.force), more=more)
    _require_same(recording, log)


def test_a_world_that_lies_on_its_side(log, read):
    lying = Rotation.from_euler("x", -90.0, degrees=True)
    named = (lying * log.rotation).as_quat()
    top = "world_rotation: {euler: [90, 0, 0], order: xyz, unit: deg}\n"
    recording = read(_columns(["qx", "qy", "qz", "qw"], named), NAMED, top=top)
    _require_same(recording, log)


def test_seconds_and_nanoseconds(log, read):
    stamps = 1_717_000_000 * 10**9 + np.rint(1e9 * log.time).astype(np.int64)
    recording = read(_named(log), NAMED, time="sec, ns", stamps=[stamps // 10**9, stamps % 10**9])
    _require_same(recording, log)


def test_a_table_without_names_is_read_by_the_numbers_of_its_columns(log, tmp_path):
    parts = [log.time, log.position, log.quaternion, log.force]
    write_table(tmp_path / "log.csv", None, parts, separator=" ")
    (tmp_path / "mapping.yaml").write_text(
        MAPPING.format(time="1", turn="quaternion: {columns: [5, 6, 7, 8]}", scale="1.0", more="")
        .replace("[x, y, z]", "[2, 3, 4]")
        .replace("[fx, fy, fz]", "[9, 10, 11]")
    )
    recording = CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())
    _require_same(recording, log)


@pytest.mark.parametrize(
    "text",
    [
        {"before": "# a note\n% another\n"},
        {"separator": ";", "decimal": ","},
        {"separator": "\t", "decimal": ",", "encoding": "utf-16"},
        {"encoding": "utf-16-le"},
        {"before": "Logger 3\nSerial: 12\n\n", "separator": ";", "end": ";"},
    ],
    ids=["comments", "decimal comma", "UTF-16", "UTF-16 without a mark", "preamble"],
)
def test_habits_of_loggers(log, read, text):
    _require_same(read(_named(log), NAMED, **text), log)


def test_a_bad_row_is_named_by_its_line(log, read, tmp_path):
    read(_named(log), NAMED)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[7] = lines[7].replace(lines[7].split(",")[2], "oops")
    lines[100] = lines[100].rpartition(",")[0]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    recording = CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())
    notes = recording.problem_lines()
    assert any(
        "log.csv, line 8: 'oops' under 'y' is not a number (row left out)" in n for n in notes
    )
    assert any("log.csv, line 101 has 10 cells, not 11 (row left out)" in n for n in notes)
    assert len(recording.streams.pose.time) == len(log.time) - 2


def test_a_table_of_bad_rows_is_refused_by_the_first(tmp_path):
    rows = [f"{k},{'x' if k % 3 else k}" for k in range(60)]
    (tmp_path / "bad.csv").write_text("\n".join(["t,fx", *rows[:30:3], *rows[30:]]))
    with pytest.raises(BadInputError, match="line 13: 'x' under 'fx' is not a number, and 1"):
        read_table(tmp_path / "bad.csv")


def test_times_of_day_may_pass_midnight(tmp_path):
    rows = ["clock;fx;fy", "23:59:59,5;1;2", "00:00:00,25;1;3"]
    (tmp_path / "night.csv").write_text("\n".join(rows))
    mapping = "contacts: {a: {file: night.csv, time: {columns: clock}}}"
    (tmp_path / "m.yaml").write_text(mapping)
    from tactile_dynamics_ros.recording.importers.fields import read_field

    time = read_field("here", "time", {"columns": "clock"}, read_table(tmp_path / "night.csv"))
    assert np.diff(time) == pytest.approx([0.75])


URDF = """<robot name="arm">
  <link name="base"/><link name="one"/><link name="two"/><link name="tool"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="bend" type="continuous"><parent link="one"/><child link="two"/>
    <origin xyz="0.1 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="mount" type="fixed"><parent link="two"/><child link="tool"/>
    <origin xyz="0.2 0 0" rpy="0 0 1.5707963267948966"/></joint>
</robot>"""


@pytest.mark.parametrize("named", [True, False])
def test_joint_angles_with_a_urdf(tmp_path, named):
    time = np.arange(300) / 100.0
    turn, bend = np.sin(time), 0.8 * np.cos(2.0 * time)
    rotation = Rotation.from_euler("ZY", np.stack([turn, bend], axis=1)) * Rotation.from_euler(
        "z", 90.0, degrees=True
    )
    force = rotation.inv().apply([0.0, 0.0, 9.81])
    names = ["t", "turn", "bend"] if named else ["t", "q1", "q2"]
    angles = [turn, bend] if named else [np.degrees(turn), np.degrees(bend)]
    write_table(tmp_path / "log.csv", [*names, "fx", "fy", "fz"], [time, *angles, force])
    (tmp_path / "arm.urdf").write_text(URDF)
    joints = "" if named else "joints: {columns: [q1, q2], unit: deg}"
    (tmp_path / "mapping.yaml").write_text(
        f"""
contact_frame: object
object_pose:
  {{file: log.csv, time: {{columns: t}}, urdf: arm.urdf, frame: tool{joints and ", "}{joints}}}
contacts:
  wrist:
    {{file: log.csv, time: {{columns: t}}, force: {{columns: [fx, fy, fz]}}, position: [0, 0, 0]}}
"""
    )
    streams = CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace()).streams
    assert (Rotation.from_matrix(streams.pose.rotation).inv() * rotation).magnitude().max() < 1e-6
    place = np.stack([np.cos(turn), np.sin(turn), np.zeros(300)], axis=1)
    along = Rotation.from_euler("ZY", np.stack([turn, bend], axis=1)).apply([0.2, 0.0, 0.0])
    np.testing.assert_allclose(
        streams.pose.position, 0.1 * place + along + [0.0, 0.0, 0.3], atol=1e-6
    )
    np.testing.assert_allclose(
        streams.contacts["wrist"].force, np.tile([0.0, 0.0, 9.81], (300, 1)), atol=1e-6
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("frame: tool", "frame: wrist", "no joints lead from link 'base' to link 'wrist'"),
        ("urdf: arm.urdf", "urdf: leg.urdf", "leg.urdf: no such file"),
        (
            "joints: {columns: [q1, q2]",
            "joints: {columns: [q1]",
            "expected one for each of turn, bend",
        ),
    ],
)
def test_joint_angles_that_do_not_fit_the_urdf_are_refused(tmp_path, old, new, message):
    write_table(tmp_path / "log.csv", ["t", "q1", "q2"], [np.arange(9.0)] * 3)
    (tmp_path / "arm.urdf").write_text(URDF)
    text = (
        "object_pose: {file: log.csv, time: {columns: t}, urdf: arm.urdf, frame: tool, "
        "joints: {columns: [q1, q2]}}"
    )
    (tmp_path / "mapping.yaml").write_text(text.replace(old, new))
    with pytest.raises(BadInputError, match=message):
        CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())


def _own_signs(recording, log):
    """Turn the drivers' sign, which is that of the load on the sensor."""
    wrist = recording.streams.contacts["wrist"]
    np.testing.assert_allclose(wrist.force, -log.world_force, atol=0.2)
    np.testing.assert_allclose(wrist.torque, -log.world_torque, atol=0.02)
    np.testing.assert_allclose(wrist.position, log.position, atol=1e-6)


def test_a_bag_with_base_frame_and_wrench_in_sensor_axes(log, tmp_path):
    [path] = panda_poses(log, tmp_path)
    recording = Recording.from_bag(
        path,
        remap={
            "/current_pose": ["/object/pose", "/contact/wrist/pose"],
            "/external_wrench": "/contact/wrist/force",
        },
    )
    _own_signs(recording, log)
    notes = "\n".join(recording.problem_lines())
    assert "frame 'panda_link0' taken as the world, z up" in notes
    assert "/contact/wrist/force is in axes of 'panda_K': turned by the contact's pose" in notes
    assert "negate them" in notes


def test_a_sensor_without_a_pose_of_its_own_is_where_the_object_is(log, tmp_path):
    [path] = kuka_ros1(log, tmp_path)
    recording = Recording.from_bag(
        path,
        remap={
            "/iiwa/state/CartesianPose": "/object/pose",
            "/ati/ft": "/contact/wrist/force",
        },
    )
    _own_signs(recording, log)
    assert "/contact/wrist/pose not recorded: taken as that of /object/pose" in "".join(
        recording.problem_lines()
    )


def test_poses_in_a_frame_that_may_not_stand_upright_need_a_word(log, tmp_path):
    [path] = panda_poses(log, tmp_path)
    remap = {"/current_pose": "/object/pose", "/external_wrench": "/contact/wrist/force"}
    assert Recording.from_bag(path, remap=remap, world_frame="panda_link0").streams.pose
    with pytest.raises(BadInputError, match="expected 'table'"):
        Recording.from_bag(path, remap=remap, world_frame="table")


def test_frames_of_tf_become_a_pose(log, tmp_path):
    [path] = ur_frames(log, tmp_path)
    (tmp_path / "mapping.yaml").write_text(
        f"""
contact_frame: object
object_pose: {{file: {path.name}, topic: /tf, frame: tool0, time: {{columns: time}},
  position: {{columns: [position.x, position.y, position.z]}},
  quaternion: {{columns: [orientation.x, orientation.y, orientation.z, orientation.w]}}}}
contacts:
  wrist: {{file: {path.name}, topic: /ft/wrench, time: {{columns: time}}, delay: 0.001,
    force: {{columns: [force.x, force.y, force.z], scale: -1}}, position: [0, 0, 0]}}
"""
    )
    recording = CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())
    _require_same(recording, log)
    text = (tmp_path / "mapping.yaml").read_text()
    (tmp_path / "mapping.yaml").write_text(text.replace("tool0", "tool9"))
    with pytest.raises(BadInputError, match="no frame 'tool9' on /tf; there are "):
        CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace())


def test_joint_states_of_a_bag_with_a_urdf(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = ("sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped")
    joint_state, wrench_stamped = (store.types[kind] for kind in kinds)
    vector = store.types["geometry_msgs/msg/Vector3"]
    angles = np.stack([np.linspace(0.0, 1.0, 200), np.linspace(0.5, -0.5, 200)], axis=1)
    with Writer(tmp_path / "arm", version=9) as writer:
        joints, wrenches = (
            writer.add_connection(topic, kind, typestore=store)
            for topic, kind in zip(("/joint_states", "/ft"), kinds, strict=True)
        )
        for k, (turn, bend) in enumerate(angles.tolist()):
            stamp = store.types["builtin_interfaces/msg/Time"](sec=7, nanosec=k * 4_000_000)
            header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
            none = np.zeros(0)
            state = joint_state(header, ["bend", "turn"], np.array([bend, turn]), none, none)
            pull = store.types["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, 5.0), vector(0, 0, 0))
            time = 7 * 10**9 + k * 4_000_000
            writer.write(joints, time, store.serialize_cdr(state, kinds[0]))
            message = wrench_stamped(header, pull)
            writer.write(wrenches, time, store.serialize_cdr(message, kinds[1]))
    (tmp_path / "arm.urdf").write_text(URDF)
    (tmp_path / "mapping.yaml").write_text(
        """
contact_frame: object
object_pose:
  {file: arm, topic: /joint_states, time: {columns: time}, urdf: arm.urdf, frame: two, base: base}
contacts:
  wrist: {file: arm, topic: /ft, time: {columns: time}, position: [0, 0, 0],
    force: {columns: [force.x, force.y, force.z]}}
"""
    )
    streams = CsvMappingImporter().read(tmp_path / "mapping.yaml", Namespace()).streams
    expected = Rotation.from_euler("ZY", angles)
    turned = Rotation.from_matrix(streams.pose.rotation)
    assert (turned.inv() * expected).magnitude().max() < 1e-6
    np.testing.assert_allclose(
        streams.contacts["wrist"].force, expected.apply([0.0, 0.0, 5.0]), atol=1e-6
    )


def test_a_table_of_a_million_columns_is_refused_at_once(tmp_path):
    file = tmp_path / "wide.csv"
    row = ",".join(["0.5"] * 1_000_000)
    file.write_text(f"{row}\n{row}\n")
    began = time.process_time()
    with pytest.raises(BadInputError, match="wide.csv: a line has 1000000 cells, expected at most"):
        read_table(file)
    assert time.process_time() - began < 5.0


def test_numbers_that_no_sensor_gives_are_missing(tmp_path):
    file = tmp_path / "odd.csv"
    file.write_text("t,f\n0.0,1.0\n0.1,inf\n0.2,-1e300\n0.3,2.0\n")
    np.testing.assert_array_equal(read_table(file).column("f"), [1.0, np.nan, np.nan, 2.0])


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("contacts: 0.5", "contacts: expected names"),
        ("object_pose: [1]", "object_pose"),
        ("contacts: {a: {file: t.csv, force: {columns: 5.5}}}", "of another kind than expected"),
    ],
)
def test_a_mapping_whose_entries_are_of_another_kind_is_refused(tmp_path, entry, words):
    (tmp_path / "t.csv").write_text("t,f\n0.0,1.0\n0.1,2.0\n")
    (tmp_path / "m.yaml").write_text(entry)
    with pytest.raises(BadInputError, match=words):
        CsvMappingImporter().read(tmp_path / "m.yaml", Namespace())


def test_a_member_that_expands_far_beyond_its_archive_is_refused(tmp_path):
    (tmp_path / "zeros.csv").write_bytes(b"0,0\n" * 4_000_000)
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as archive:
        archive.add(tmp_path / "zeros.csv", "zeros.csv")
    with pytest.raises(BadInputError, match="zeros.csv expands to more than"):
        read_table(tmp_path / "a.tar.gz" / "zeros.csv")


@pytest.mark.parametrize(
    ("cells", "numbers"),
    [
        (["0,5", "999,5", "1.000,5", "12.345,25"], [0.5, 999.5, 1000.5, 12345.25]),
        (["0.5", "999.5", "1,000.5", "12,345.25"], [0.5, 999.5, 1000.5, 12345.25]),
        (["0.5", "999.5", "1'000.5", "12'345.25"], [0.5, 999.5, 1000.5, 12345.25]),
        (["0,5", "999,5", "1\u202f000,5", "12\u00a0345,25"][:3], [0.5, 999.5, 1000.5]),
        (["0", "1.234.567", "1.000", "5"], [0.0, 1234567.0, 1000.0, 5.0]),
        (["1.234", "2.345", "3.456", "4.567"], [1.234, 2.345, 3.456, 4.567]),
    ],
)
def test_thousands_are_parted_as_the_numbers_themselves_tell(tmp_path, cells, numbers):
    decimal = "0,25" if any(cell.endswith(",5") for cell in cells) else "7"
    rows = "\n".join(f"{cell};{decimal}" for cell in cells)
    (tmp_path / "t.csv").write_text(f"t;f\n{rows}\n", encoding="utf-8")
    np.testing.assert_allclose(read_table(tmp_path / "t.csv").column("t"), numbers)


def test_integers_in_thousands_beside_decimals_of_the_other_sign(tmp_path):
    rows = "\n".join(f"{k // 1000}.{k % 1000:03};0,{k % 10}" for k in range(1000, 1400, 10))
    (tmp_path / "t.csv").write_text(f"ms;f\n{rows}\n")
    table = read_table(tmp_path / "t.csv")
    np.testing.assert_allclose(table.column("ms"), np.arange(1000, 1400, 10))
    assert "thousands as 1.000" in table.layout
