"""Recordings of hands in namespaces: which is read, and what is said where that is not clear."""

import json

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from synthetic_recording import MASS, held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.estimate import SlipEvent
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.probe_slips import holds_slips, read_slips, write_slips

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE = "/object/pose"


@pytest.fixture(scope="module")
def hands(tmp_path_factory):
    """Recordings of two hands that move differently, each at root."""
    folder = tmp_path_factory.mktemp("hands")
    return [held_box(4.0, seed=seed).to_bag(folder / f"hand_{seed}") for seed in (0, 1)]


@pytest.fixture
def together(tmp_path):
    """Return a function that copies recordings into one, each in a namespace."""

    def copy(rename=str, **sources):
        target = tmp_path / "together"
        with Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            for name, source in sources.items():
                prefix = f"/{name}" if name != "root" else ""
                with Reader(source) as reader:
                    known = {
                        c.id: writer.add_connection(
                            rename(prefix + c.topic), c.msgtype, typestore=STORE
                        )
                        for c in reader.connections
                    }
                    for connection, received, data in reader.messages():
                        writer.write(known[connection.id], received, data)
        return target

    return copy


def positions(path, **options):
    """Return where the object of a recording was."""
    return Recording.from_bag(path, **options).streams.pose.position


def test_each_hand_is_read_by_its_namespace(hands, together):
    path = together(left=hands[0], right=hands[1])
    for name, hand in zip(("left", "/right/"), hands, strict=True):
        np.testing.assert_array_equal(positions(path, namespace=name), positions(hand))
    recording = Recording.from_bag(path, namespace="right")
    assert recording.source == f"{path} (namespace /right)"
    assert set(recording.streams.contacts) == {"index", "middle", "ring", "thumb"}
    assert recording.problems == {}


def test_the_only_namespace_is_read_and_named(hands, together):
    path = together(left=hands[0])
    recording = Recording.from_bag(path)
    np.testing.assert_array_equal(recording.streams.pose.position, positions(hands[0]))
    assert recording.problems == {"no topic at root; read from the only namespace, /left": 1}


def test_several_namespaces_are_named_with_the_option(hands, together):
    path = together(left=hands[0], right=hands[1])
    with pytest.raises(BadInputError, match="/left, /right; choose one, as in --namespace left"):
        Recording.from_bag(path)
    with pytest.raises(BadInputError, match="namespace /middle: .* there are /left, /right"):
        Recording.from_bag(path, namespace="middle")


def test_root_wins_where_something_is_there(hands, together):
    path = together(root=hands[0], right=hands[1])
    np.testing.assert_array_equal(positions(path), positions(hands[0]))
    np.testing.assert_array_equal(positions(path, namespace="/"), positions(hands[0]))
    np.testing.assert_array_equal(positions(path, namespace="right"), positions(hands[1]))


def test_a_part_at_root_is_not_completed_from_a_namespace(hands, together):
    path = together(lambda topic: topic if topic == "/left" + POSE else topic[5:], left=hands[0])
    with pytest.raises(BadInputError, match=r"remap it \(/left/object/pose:=/object/pose\)"):
        Recording.from_bag(path)
    found = positions(path, remap={"/left/object/pose": POSE})
    np.testing.assert_array_equal(found, positions(hands[0]))


def test_remapping_inside_a_namespace_names_what_was_recorded(hands, together):
    path = together(lambda topic: topic.replace(POSE, "/tracker/box"), a=hands[0], b=hands[1])
    remap = {"/b/tracker/box": POSE}
    found = positions(path, namespace="b", remap=remap)
    np.testing.assert_array_equal(found, positions(hands[1]))


def test_nested_namespaces_and_contacts_of_any_name(hands, together):
    path = together(lambda topic: "/cell" + topic.replace("index", "contact"), left=hands[0])
    recording = Recording.from_bag(path)
    assert recording.source.endswith("(namespace /cell/left)")
    assert set(recording.streams.contacts) == {"contact", "middle", "ring", "thumb"}


def test_verbs_take_the_namespace(hands, together, capsys):
    path = str(together(left=hands[0], right=hands[1]))
    assert main(["estimate", path, "--namespace", "left", "--json"]) in (0, 3)
    assert abs(json.loads(capsys.readouterr().out)["mass"]["value"] / MASS - 1) < 0.1
    assert main(["compare", path]) == 2
    error = capsys.readouterr().err
    assert "--namespace left" in error
    assert error.count("\n") == 1


def test_slips_of_a_probe_in_a_namespace(tmp_path, together):
    event = SlipEvent(
        **{
            name: {"str": "body", "float": 0.5, "int": 1, "bool": False}[kind]
            for name, kind in SlipEvent.__annotations__.items()
        }
    )
    source = write_slips([event], tmp_path / "slips")
    path = together(left=source, right=source)
    assert holds_slips(path)
    assert holds_slips(path, "left")
    assert not holds_slips(path, "middle")
    assert len(read_slips(path, "right")) == 1
    with pytest.raises(BadInputError, match="--namespace left"):
        read_slips(path)
