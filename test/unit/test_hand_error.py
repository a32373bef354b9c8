"""Contacts that the hand tells go with the fused pose, unless the object slipped."""

from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from synthetic_recording import MASS, held_box

from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.tracking.hand_error import carry_contacts
from tactile_dynamics_ros.recording import Recording

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE, HAND = "/object/pose", "/object/pose/kinematic"
TURN = Rotation.from_rotvec([0.0, 0.008, -0.004]).as_matrix()
PIVOT = np.array([0.5, 0.0, 0.6])
SHIFT = np.array([1e-3, -0.5e-3, 1e-3]) + PIVOT - TURN @ PIVOT


def moved(pose, turn, shift):
    """Return a pose stream moved in the world."""
    return replace(pose, position=pose.position @ turn.T + shift, rotation=turn @ pose.rotation)


def told_by(streams, turn, shift):
    """Return the streams with contacts as a hand with that error tells them."""
    contacts = {
        name: replace(
            c,
            force=c.force @ turn.T,
            torque=c.torque @ turn.T,
            position=c.position @ turn.T + shift,
            rotation=turn @ c.rotation,
        )
        for name, c in streams.contacts.items()
    }
    return replace(streams, contacts=contacts)


def assert_same_contacts(found, expected):
    for name, contact in expected.contacts.items():
        for field in ("force", "torque", "position", "rotation"):
            got, wanted = getattr(found.contacts[name], field), getattr(contact, field)
            np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_an_error_of_the_hand_is_taken_from_contacts_and_forces():
    true = held_box(seconds=4.0).streams
    told = told_by(true, TURN, SHIFT)
    carried = carry_contacts(told, moved(true.pose, TURN, SHIFT))
    assert_same_contacts(carried, true)
    assert carried.pose is true.pose
    assert estimate_body(carried).to_estimate().inertia.dynamic_parameters[0] == pytest.approx(
        MASS, rel=0.02
    )


def test_where_the_object_slipped_contacts_stay():
    true = held_box(seconds=2.0).streams
    small = np.array([0.0, 2e-3, 0.0])
    slipped = moved(true.pose, np.eye(3), [0.0, 0.0, 0.02])
    half = len(slipped.time) // 2
    slipped.position[:half] = true.pose.position[:half] + small
    carried = carry_contacts(true, slipped)
    for name, contact in carried.contacts.items():
        shift = contact.position - true.contacts[name].position
        np.testing.assert_allclose(shift[:half], np.tile(-small, (half, 1)), atol=1e-12)
        np.testing.assert_allclose(shift[half:], 0.0, atol=1e-12)


def test_contacts_do_not_leap_while_an_object_begins_to_slip():
    true = held_box(seconds=2.0).streams
    growing = np.linspace(0.0, 0.01, len(true.pose.time))
    hand = replace(true.pose, position=true.pose.position + growing[:, None] * [1.0, 0.0, 0.0])
    moves = carry_contacts(true, hand).contacts["thumb"].position
    moves = np.linalg.norm(moves - true.contacts["thumb"].position, axis=1)
    assert moves.max() == pytest.approx(2.5e-3, abs=1e-5)
    assert moves[0] == moves[-1] == 0.0
    assert np.abs(np.diff(moves)).max() < 2.0 * growing[1]


def test_contacts_stay_where_the_hand_tells_no_pose_for_a_while():
    true = held_box(seconds=2.0).streams
    small = np.array([1e-3, 0.0, 0.0])
    hand = moved(true.pose, np.eye(3), small)
    covered = hand.time < 1.0
    hand = replace(
        hand, time=hand.time[covered], position=hand.position[covered],
        rotation=hand.rotation[covered],
    )  # fmt: skip
    carried = carry_contacts(true, hand)
    shift = carried.contacts["thumb"].position - true.contacts["thumb"].position
    np.testing.assert_allclose(shift[true.pose.time < 1.05], -small[None].repeat(105, 0), atol=1e-9)
    np.testing.assert_allclose(shift[true.pose.time > 1.15], 0.0, atol=1e-12)


def test_a_hand_with_the_stamps_of_another_clock_changes_nothing():
    true = held_box(seconds=1.0).streams
    hand = moved(true.pose, TURN, SHIFT)
    assert carry_contacts(true, replace(hand, time=1.01 * hand.time)) is true


def bag_with_hand(true, path, change):
    """Write a recording with a pose by the hand: each pose of the object, changed."""
    plain = true.to_bag(path / "plain")
    target = path / "with_hand"
    with (
        Reader(plain) as reader,
        Writer(target, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        known = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=STORE)
            for c in reader.connections
        }
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        hand = writer.add_connection(HAND, kind, typestore=STORE)
        for connection, received, data in reader.messages():
            writer.write(known[connection.id], received, data)
            if connection.topic == POSE:
                message = STORE.deserialize_cdr(data, kind)
                change(message)
                writer.write(hand, received, STORE.serialize_cdr(message, kind))
    return target


def test_a_recording_with_the_hands_pose_is_corrected(tmp_path):
    true = held_box(seconds=1.0)

    def shift(message):
        message.pose.pose.position.x += 2e-3

    found = Recording.from_bag(bag_with_hand(true, tmp_path, shift))
    for name, contact in found.streams.contacts.items():
        before = true.streams.contacts[name].position
        wanted = before - [2e-3, 0.0, 0.0]
        np.testing.assert_allclose(contact.position, wanted, atol=1e-9)
    assert not found.problems


def test_a_recording_whose_hand_pose_is_useless_is_read_as_if_it_had_none(tmp_path):
    true = held_box(seconds=1.0)

    def spoil(message):
        message.header.frame_id = "palm"

    found = Recording.from_bag(bag_with_hand(true, tmp_path, spoil))
    assert_same_contacts(found.streams, Recording.from_bag(tmp_path / "plain").streams)
    assert any(text.startswith(HAND) for text in found.problems)
