"""Recordings of pushes that nobody here made: other names, frames, namespaces, several files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.joining import join_pushes
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.recording.pushed import PushedRecording, recorded_model
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

QUICK = ActionOptions(count=2, speed=(0.08, 0.15), travel=0.05)
STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module")
def made():
    """Two pushes that stop hard."""
    return pushed.generate([7], {}, pushed.PushOptions(actions=QUICK))[0]


@pytest.fixture
def bag(made, tmp_path):
    return PushedRecording(made.streams, "made").to_bag(tmp_path / "push")


def rewritten(source, target, rename=str, change=lambda topic, message: message):
    """Copy a recording with other names of topics, and other messages."""
    with (
        Reader(source) as reader,
        Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        new = {
            c.topic: writer.add_connection(rename(c.topic), c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        for connection, stamp, raw in reader.messages():
            message = STORE.deserialize_cdr(raw, connection.msgtype)
            message = change(connection.topic, message)
            data = STORE.serialize_cdr(message, connection.msgtype)
            writer.write(new[connection.topic], stamp, data)
    return target


def framed(frame, *kinds):
    """Messages of topics that end in a kind, in another frame."""

    def change(topic, message):
        if not topic.endswith(kinds):
            return message
        return replace(message, header=replace(message.header, frame_id=frame))

    return change


def test_topics_of_other_names_are_read_as_what_they_stand_for(bag, tmp_path):
    other = rewritten(bag, tmp_path / "other", lambda topic: topic.replace("/object", "/block"))
    remap = {f"/block/{kind}": f"/object/{kind}" for kind in ("pose", "footprint")}
    assert recorded_model(other, {"/block/pose": "/object/pose"}) == "pushed"
    found = PushedRecording.from_bag(other, remap=remap).streams
    wanted = PushedRecording.from_bag(bag).streams
    np.testing.assert_array_equal(found.links[0].pose, wanted.links[0].pose)
    np.testing.assert_array_equal(found.links[0].footprint, wanted.links[0].footprint)
    with pytest.raises(BadInputError, match="is missing"):
        PushedRecording.from_bag(other)


def test_a_namespace_is_read_where_it_is_named_or_the_only_one(bag, tmp_path, made):
    left = rewritten(bag, tmp_path / "left", lambda topic: f"/left{topic}")
    assert recorded_model(left) == "pushed"
    found = PushedRecording.from_bag(left)
    assert any("only namespace, /left" in line for line in found.problem_lines())
    assert len(PushedRecording.from_bag(left, namespace="left").streams.links[0].time)
    with pytest.raises(BadInputError, match="namespace /right"):
        PushedRecording.from_bag(left, namespace="right")


def test_poses_in_the_frame_of_a_table_need_to_be_named_upright(bag, tmp_path):
    other = rewritten(bag, tmp_path / "table", change=framed("table_top", "/pose", "/force"))
    with pytest.raises(BadInputError, match="--world-frame table_top"):
        PushedRecording.from_bag(other)
    found = PushedRecording.from_bag(other, world_frame="table_top")
    assert len(found.streams.contacts["pusher"].time)


def test_a_force_in_the_frame_of_a_pad_is_refused_not_taken_for_the_world(bag, tmp_path):
    other = rewritten(bag, tmp_path / "pad", change=framed("left_pad", "/force"))
    with pytest.raises(BadInputError, match="frame_id 'left_pad'"):
        PushedRecording.from_bag(other)


def test_two_recordings_of_one_object_tell_more_than_one(made, tmp_path, capsys):
    later = pushed.generate([7], {}, pushed.PushOptions(actions=replace(QUICK, count=1)))[0]
    both = join_pushes([made.streams, later.streams])
    assert both.session_starts[0] == 0.0 and both.session_starts[1] > 10.0
    assert len(both.links[0].time) == len(made.streams.links[0].time) + len(
        later.streams.links[0].time
    )
    alone, joined = (estimate(streams) for streams in (made.streams, both))
    force = [e.values["friction_force_n"] for e in (alone, joined)]
    assert force[1][1] < force[0][1]
    truth = made.truth()["links"][0]["friction_force_n"]
    assert abs(force[1][0] - truth) < 3.0 * force[1][1]
    bags = [
        str(PushedRecording(part.streams, "made").to_bag(tmp_path / name))
        for part, name in ((made, "one"), (later, "two"))
    ]
    assert main(["estimate", *bags, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["links"][0]["friction_force_n"]
    assert told["value"] == pytest.approx(force[1][0], rel=1e-3)


def test_recordings_of_different_objects_are_not_joined(made):
    link = made.streams.links[0]
    longer = replace(made.streams, links=(replace(link, footprint=1.1 * link.footprint),))
    with pytest.raises(BadInputError, match="outlines of link_1 differ"):
        join_pushes([made.streams, longer])
    leaning = replace(made.streams, gravity=made.streams.gravity + [0.2, 0.0, 0.0])
    with pytest.raises(BadInputError, match="leans otherwise"):
        join_pushes([made.streams, leaning])


def test_a_part_of_a_recording_is_asked_about(bag, capsys):
    assert main(["estimate", str(bag), "--between", "0,100", "--json"]) == 0
    capsys.readouterr()
    assert main(["estimate", str(bag), "--between", "900,901"]) == 2
    assert "nothing was recorded then" in capsys.readouterr().err
    half = PushedRecording.from_bag(bag).between(0.0, 1.0)
    assert half.duration < 1.01


def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(bag, tmp_path):
    [file] = bag.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: int(0.7 * file.stat().st_size)])
    found, whole = PushedRecording.from_bag(cut), PushedRecording.from_bag(bag)
    assert any("salvaged" in line for line in found.problem_lines())
    np.testing.assert_array_equal(
        found.streams.links[0].footprint, whole.streams.links[0].footprint
    )
    assert 0 < len(found.streams.links[0].time) <= len(whole.streams.links[0].time)


def csv(path, names, columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(names), comments="")


MAPPING = """
object_pose:
  file: tracker.csv
  time: {columns: t, unit: ms}
  position: {columns: [x, y], unit: mm, plane: true}
  yaw: {columns: yaw, unit: deg}
  position_std: {constant: 0.5, unit: mm}
  rotation_std: {constant: 0.2, unit: deg}
  footprint: {constant: %s, unit: mm}
contacts:
  pusher:
    file: tip.csv
    time: {columns: t}
    force: {columns: [fx, fy], plane: true, scale: -1}
    force_std: 0.03
    position: {columns: [px, py], unit: cm, plane: true}
    position_std: {constant: 0.3, unit: mm}
    height: {constant: %s, unit: mm}
"""


def test_tables_of_a_pushed_object_become_a_recording(made, tmp_path, capsys):
    [link], [contact] = made.streams.links, made.streams.contacts.values()
    x, y, yaw = link.pose.T
    names = ["t", "x", "y", "yaw"]
    csv(tmp_path / "tracker.csv", names, [1e3 * link.time, 1e3 * x, 1e3 * y, np.degrees(yaw)])
    at = [np.interp(contact.time, contact.pose_time, axis) for axis in contact.point.T]
    force = -contact.force[:, :2]
    csv(
        tmp_path / "tip.csv",
        ["t", "fx", "fy", "px", "py"],
        [contact.time, force, 1e2 * at[0], 1e2 * at[1]],
    )
    outline = (1e3 * link.footprint).tolist()
    (tmp_path / "mapping.yaml").write_text(MAPPING % (outline, 1e3 * np.median(at[2])))
    out = tmp_path / "run.mcap"
    assert main(["import", "csv", str(tmp_path / "mapping.yaml"), str(out)]) == 0
    capsys.readouterr()
    found, wanted = (
        estimate(streams).values["friction_force_n"]
        for streams in (PushedRecording.from_bag(out).streams, made.streams)
    )
    assert abs(found[0] - wanted[0]) < 0.5 * wanted[1]
    read = PushedRecording.from_bag(out).streams
    np.testing.assert_allclose(read.links[0].footprint, link.footprint, atol=1e-6)
    assert read.contacts["pusher"].point_std == pytest.approx(3e-4)


def test_two_columns_are_a_plane_only_where_it_is_said(made, tmp_path, capsys):
    csv(tmp_path / "tracker.csv", ["t", "x", "y", "yaw"], [np.arange(9.0)] * 4)
    csv(tmp_path / "tip.csv", ["t", "fx", "fy", "px", "py"], [np.arange(9.0)] * 5)
    mapping = (MAPPING % ([[0, 0], [1, 0], [0, 1]], 12)).replace("fy], plane: true", "fy]")
    (tmp_path / "mapping.yaml").write_text(mapping)
    assert main(["import", "csv", str(tmp_path / "mapping.yaml"), str(tmp_path / "out")]) == 2
    assert "plane: true" in capsys.readouterr().err


def test_arrays_of_two_parts_need_an_outline_of_each(made):
    link = made.streams.links[0]
    part = {"time": link.time, "position": link.pose[:, :2], "yaw": link.pose[:, 2]}
    contact = made.streams.contacts["pusher"]
    touch = {"time": contact.time, "force": contact.force, "position": [0.0, 0.0, 0.02]}
    whole = part | {"footprint": link.footprint[::-1]}
    found = PushedRecording.from_arrays({"pusher": touch}, [whole, whole]).streams
    np.testing.assert_allclose(found.links[1].pose[:, :2], link.pose[:, :2], atol=1e-12)
    np.testing.assert_allclose(found.links[0].footprint, np.roll(link.footprint, 0, axis=0))
    with pytest.raises(BadInputError, match="link_2 has no footprint"):
        PushedRecording.from_arrays({"pusher": touch}, [whole, part])
    with pytest.raises(BadInputError, match="3 links"):
        PushedRecording.from_arrays({"pusher": touch}, [whole] * 3)
