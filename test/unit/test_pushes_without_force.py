"""Pushes of which only poses of tip and object are known: what is told, what is not."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.support.compliant_pushes import draw_arms, push_compliantly
from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
from tactile_dynamics_ros.api.reading import read_pushed_recording
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushedStreams
from tactile_dynamics_ros.core.planar.tip import Stiffness, contact_of_tip, force_by_stiffness
from tactile_dynamics_ros.recording.bag_writer import write_tables
from tactile_dynamics_ros.recording.pushed import PushedRecording, writer
from tactile_dynamics_ros.recording.topics import POSE_STAMPED
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions, generate

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])


def recorded(seed, speed, count):
    """Streams with poses of object and tip alone, and the truth."""
    options = PushOptions(actions=ActionOptions(speed=speed, count=count, pauses=0))
    hidden = generate([seed], options=options)[0]
    motion, rng = hidden.motion, np.random.default_rng(seed)
    ticks = np.arange(5, len(motion.time), 5)
    place = motion.pusher[ticks, :2] + 3e-4 * rng.normal(size=(len(ticks), 2))
    place = np.column_stack([place, np.full(len(ticks), hidden.scene.tip.height)])
    link = hidden.streams.links[0]
    contact = contact_of_tip(link, motion.time[ticks], place)
    streams = PushedStreams((link,), {"pusher": contact}, hidden.streams.gravity)
    return streams, hidden.truth()["links"][0]


@pytest.fixture(scope="module")
def slow():
    return recorded(9310, (0.03, 0.08), 4)


@pytest.fixture(scope="module")
def found(slow):
    return estimate(slow[0])


def test_the_middle_of_a_tip_is_moved_to_the_outline_by_the_gap_that_it_keeps_in_motion():
    time = np.arange(0.0, 3.0, 0.01)
    along = 0.05 * np.clip(time - 1.0, 0.0, 1.0)
    pose = np.column_stack([0.3 + along, 0.0 * time, 0.0 * time])
    near = np.minimum(time - 1.0, 0.0)  # it comes from afar
    place = np.column_stack([0.3 + along - 0.05 - 0.006 + 0.05 * near, 0.0 * time, 0.0 * time])
    contact = contact_of_tip(LinkStream(time, pose, None, BOX), time, place)
    touching = (time > 1.1) & (time < 2.0)
    np.testing.assert_allclose(contact.point[touching, 0], pose[touching, 0] - 0.05, atol=1e-4)
    np.testing.assert_allclose(contact.normal[touching, 0], 1.0)
    assert not len(contact.time)


def test_without_force_the_centre_is_told_and_nothing_is_invented(slow, found):
    truth = slow[1]
    com = np.array([found.values[name][0] for name in ("com_x", "com_y")])
    std = np.array([found.values[name][1] for name in ("com_x", "com_y")])
    assert np.all(np.abs(com - truth["com"]) < 3.0 * std)
    assert np.all(std < 0.006)
    assert {"mass", "friction_force_n", "inertia_zz"} <= set(found.undetermined)
    (link,) = found.to_document()["links"]
    assert not {"mass", "friction_force_n", "inertia_zz"} & set(link)
    assert found.to_document()["covariance"]["names"] == ["com_x", "com_y"]
    assert found.lines()[0].startswith("forces            not measured")


def test_slow_pushes_do_not_slide_on_and_it_says_what_would_tell_friction(found):
    assert "friction" in found.undetermined
    assert "friction" not in found.values
    assert "stop hard from 0.2 m/s" in found.lines()[-1]


def test_the_answer_is_that_the_scale_is_unknown_whatever_is_pushed(slow, found):
    asked = EstimateOfPushes(PushedRecording(slow[0], "poses"), found)
    with pytest.raises(NotIdentifiableError, match="no force was measured"):
        asked.require_answer()
    assert not [row for row in asked.rows() if row[0].startswith(("mass", "friction force"))]


def test_an_effect_that_changes_forces_is_refused(slow):
    with pytest.raises(NotIdentifiableError, match="none was measured"):
        estimate(slow[0], ["support_tilt"])


def test_fast_pushes_alone_are_refused_with_what_to_do(slow):
    streams = slow[0]
    link, contact = streams.links[0], streams.contacts["pusher"]
    fast = replace(
        streams,
        links=(replace(link, time=0.05 * link.time),),
        contacts={"pusher": replace(contact, pose_time=0.05 * contact.pose_time)},
    )
    with pytest.raises(NotIdentifiableError, match="push slowly"):
        estimate(fast)


def test_the_friction_coefficient_follows_from_slides_after_hard_stops():
    from tactile_dynamics_ros.core.planar.sparse.sliding import friction_from_slides

    streams, truth = recorded(9312, (0.25, 0.35), 4)
    sliding = friction_from_slides(streams, np.array(truth["com"]))
    value, std = sliding.friction
    assert sliding.slides >= 2
    assert abs(value - truth["friction"]) < 3.0 * std
    assert std < 0.35 * value


def test_a_bag_with_the_pusher_s_pose_in_place_of_contacts_is_read(slow, tmp_path):
    streams = slow[0]
    contact = streams.contacts["pusher"]
    yaw = np.zeros(len(contact.pose_time))
    streams = replace(streams, pusher_time=contact.pose_time, pusher_yaw=yaw)
    link, turn = streams.links[0], np.eye(3)
    tables = [
        writer._link(0, link, turn, 10**9),
        writer._footprint(0, link.footprint, 0.0, 10**9),
        writer._pusher(streams, turn, 10**9),
    ]
    write_tables(tables, tmp_path / "bag")
    recording, _ = read_pushed_recording(tmp_path / "bag")
    (name,) = recording.streams.contacts
    assert name == "pusher"
    assert not recording.streams.feels
    found = recording.streams.contacts[name]
    np.testing.assert_allclose(found.point[:, 2], contact.point[:, 2])
    assert np.median(np.linalg.norm(found.point - contact.point, axis=1)) < 1e-3


STATED = Stiffness(np.full(2, 300.0), 0.1)


def behind_command(force, zero, drag, mass):
    """A tip that goes to and fro beside a box, presses it from 2.5 to 4.5 s; its command."""
    time = np.arange(0.0, 7.0, 0.01)
    free = 0.03 * np.sin(2.0 * np.pi * time) - 0.09
    press = np.clip(np.minimum(time - 2.0, 5.0 - time) / 0.5, 0.0, 1.0)
    press = press**2 * (3.0 - 2.0 * press)
    x = free * (1.0 - press) - 0.05 * press
    place = np.column_stack([x, 0.3 * (1.0 - press) * free, np.full(len(time), 0.02)])
    speed = np.gradient(place[:, :2], time, axis=0)
    own = zero + drag * speed + mass * np.gradient(speed, time, axis=0)
    touch = np.where((time > 2.5) & (time < 4.5), 1.0, 0.0)[:, None] * np.array([force, 0.0])
    target = place.copy()
    target[:, :2] += (own + touch) / STATED.along
    noise = 1e-4 * np.random.default_rng(0).normal(size=(len(time), 2))
    return time, place + np.pad(noise, ((0, 0), (0, 1))), target


def test_a_tip_s_force_is_its_lag_without_what_the_arm_itself_takes_up():
    time, place, target = behind_command(2.0, np.array([0.4, -0.2]), 50.0, 3.0)
    link = LinkStream(time, np.zeros((len(time), 3)), None, BOX)
    contact = replace(contact_of_tip(link, time, place), point=place)
    pushed, doubt, mass_std = force_by_stiffness(link, contact, place, target, STATED)
    steady = (pushed.time > 2.7) & (pushed.time < 4.3)
    np.testing.assert_allclose(pushed.force[steady].mean(axis=0), [2.0, 0.0, 0.0], atol=0.1)
    assert STATED.std < doubt < 1.2 * STATED.std and 0.0 < mass_std < 0.3
    assert 0.0 < pushed.force_std.max() < 0.3
    with pytest.raises(NotIdentifiableError, match="record approach and retreat"):
        touching = slice(240, 460)
        force_by_stiffness(
            link,
            replace(contact, pose_time=time[touching], point=place[touching]),
            place[touching],
            target[touching],
            STATED,
        )


def test_with_a_known_stiffness_the_scale_follows_and_its_doubt_is_in_the_interval(tmp_path):
    options = PushOptions(actions=ActionOptions(count=3, gap=0.03, speed=(0.05, 0.25)))
    (found,) = push_compliantly([9415], options, draw_arms([9415], 300.0, STATED.std))
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (len(found.time), 1))
    tables = [
        writer._link(0, found.link, np.eye(3), 10**9),
        writer._footprint(0, found.link.footprint, 0.0, 10**9),
    ]
    followed = [
        writer._encode(topic, POSE_STAMPED, found.time, np.hstack([path, turn]), 10**9)
        for topic, path in (
            (writer.PUSHER_POSE, found.place),
            (writer.PUSHER_TARGET, found.target),
        )
    ]
    write_tables([*tables, *followed], tmp_path / "bag")
    recording, (note,) = read_pushed_recording(tmp_path / "bag", stiffness=STATED)
    assert "are known to 1" in note
    estimated = estimate(recording)
    value, std = estimated.values["friction_force_n"]
    assert abs(value - found.truth["friction_force_n"]) < 3.0 * std
    assert std > STATED.std * value
    mass, spread = estimated.values["mass"]
    assert abs(mass - found.truth["mass"]) < 3.0 * spread
    write_tables([*tables, followed[0]], tmp_path / "no_command")
    with pytest.raises(BadInputError, match="/pusher/target is missing"):
        read_pushed_recording(tmp_path / "no_command", stiffness=STATED)
