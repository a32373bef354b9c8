"""A wrist sensor beside the fingertips: the hand is taken out, the rest seen from the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import tactile_dynamics_ros as td
from benchmarks.support.layouts.wrist_log import INERTIA_PER_MASS, WristLog
from tactile_dynamics_ros.api.wrist import WristShare
from tactile_dynamics_ros.core.effects import create_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.wrist import (
    fingertip_gains,
    grip,
    seen_from,
    told_apart,
)
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.streams.streams import PoseStream
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

HAND = (1.1, np.array([-0.02, 0.0, 0.09]))
LOAD = (0.4, np.array([0.01, -0.006, 0.17]))
IN_FLANGE = np.eye(4)
IN_FLANGE[:3, :3] = Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix()
IN_FLANGE[:3, 3] = 0.02, 0.01, 0.16


def wrist_of(log: WristLog) -> Recording:
    wrench = {"time": log.time, "force": log.force, "torque": log.torque}
    contact = wrench | {"position": np.zeros(3), "rotation": np.eye(3), "force_std": 0.05}
    pose = {"time": log.time, "position": log.position, "rotation": log.rotation.as_matrix()}
    return Recording.from_arrays({"wrist": contact}, pose, contact_frame="object", source="wrist")


def fingers_of(log: WristLog, later: float = 0.0) -> Recording:
    """A load as a contact that carries torque feels it, in the object's own frame."""
    turn, place = log.rotation.as_matrix(), log.position
    world = {"force": log.rotation.apply(log.force), "torque": log.rotation.apply(log.torque)}
    contact = world | {"time": log.time, "position": place, "pose_time": log.time}
    pose = {
        "time": log.time,
        "position": place + turn @ IN_FLANGE[:3, 3],
        "rotation": turn @ IN_FLANGE[:3, :3],
    }
    contact |= {"rotation": turn, "force_std": 0.05}
    return Recording.from_arrays({"pad": contact}, pose, source="fingers")


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    found = td.estimate(wrist_of(WristLog.carrying(31, [HAND], 6.0)), "force_bias")
    return found.save(tmp_path_factory.mktemp("hand") / "hand.yaml")


def true_load() -> InertialParameters:
    mass, com = LOAD
    back = IN_FLANGE[:3, :3].T
    inertia = back @ (mass * INERTIA_PER_MASS) @ back.T
    return InertialParameters(mass, back @ (com - IN_FLANGE[:3, 3]), inertia)


def in_stds(found, truth: InertialParameters) -> np.ndarray:
    apart = found.inertia.dynamic_parameters - truth.dynamic_parameters
    return np.abs(apart) / np.sqrt(np.diag(found.covariance))


def test_the_object_is_what_the_wrist_carries_without_the_hand(hand):
    fingers = fingers_of(WristLog.carrying(32, [LOAD], 6.0))
    wrist = wrist_of(WristLog.carrying(32, [HAND, LOAD], 6.0))
    alone = td.estimate(fingers, "force_bias")
    both = td.estimate(fingers, "force_bias", wrist=wrist, hand=hand)
    assert in_stds(both.wrist.body, true_load()).max() < 4.0
    assert in_stds(both.found, true_load()).max() < 4.0
    assert both.found.parameter_std[0] < alone.found.parameter_std[0]
    assert both.to_json()["wrist"]["differs"] == []
    assert "the wrist by itself" in both.notes[0]


def test_a_hand_in_another_posture_is_noticed_and_not_averaged(hand):
    other = (HAND[0], HAND[1] + np.array([0.0, 0.003, 0.0]))
    fingers = fingers_of(WristLog.carrying(33, [LOAD], 6.0))
    wrist = wrist_of(WristLog.carrying(33, [other, LOAD], 6.0))
    found = td.estimate(fingers, "force_bias", wrist=wrist, hand=hand)
    assert "centre of mass" in found.to_json()["wrist"]["differs"]
    assert "the fingertips alone count" in found.notes[0]
    alone = td.estimate(fingers, "force_bias").found
    np.testing.assert_allclose(found.found.covariance, alone.covariance)


def test_a_body_seen_from_another_frame_is_the_same_body():
    found = estimate(wrist_of(WristLog.carrying(34, [LOAD], 5.0)), [create_effect("force_bias")])
    inverse = np.linalg.inv(IN_FLANGE)
    moved = seen_from(found.to_estimate(), inverse, np.zeros((6, 6)))
    own = found.to_estimate().inertia
    assert moved.inertia.mass == pytest.approx(own.mass)
    expected = inverse[:3, :3] @ own.com + inverse[:3, 3]
    np.testing.assert_allclose(moved.inertia.com, expected, atol=1e-12)
    turned = inverse[:3, :3] @ own.inertia_com @ inverse[:3, :3].T
    np.testing.assert_allclose(moved.inertia.inertia_com, turned, atol=1e-12)
    shaken = seen_from(found.to_estimate(), inverse, np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6]))
    added = shaken.parameter_covariance - moved.parameter_covariance
    np.testing.assert_allclose(np.diag(added)[1:4], 1e-6, rtol=1e-6)


def test_the_wrist_tells_mass_centre_and_inertia_each_for_itself():
    model = estimate(wrist_of(WristLog.carrying(34, [LOAD], 5.0)), [create_effect("force_bias")])
    found = model.to_estimate()
    apart = replace(found, covariance=told_apart(found))
    own = apart.parameter_covariance
    np.testing.assert_allclose(np.diag(own), found.parameter_std**2, rtol=1e-6)
    np.testing.assert_allclose(own[0, 1:], 0.0, atol=1e-9 * own[0, 0])
    blind = replace(found, not_excited=("inertia_xx",))
    std = replace(found, covariance=told_apart(blind)).parameter_std
    assert std[4:].min() > 100.0 * found.parameter_std[4:].max()
    np.testing.assert_allclose(std[:4], found.parameter_std[:4], rtol=1e-6)


def test_the_grip_is_the_mean_pose_and_no_pose_is_made_up():
    log = WristLog.carrying(35, [LOAD], 2.0)
    turn = log.rotation.as_matrix()
    flange = PoseStream(log.time, log.position, turn)
    place = log.position + turn @ IN_FLANGE[:3, 3]
    held = PoseStream(log.time, place, turn @ IN_FLANGE[:3, :3])
    mean, covariance = grip(flange, held)
    np.testing.assert_allclose(mean, np.linalg.inv(IN_FLANGE), atol=1e-9)
    assert np.abs(covariance).max() < 1e-12
    later = PoseStream(log.time + 100.0, held.position, held.rotation)
    with pytest.raises(BadInputError, match="of the same recording"):
        grip(flange, later)


def test_gains_of_all_fingertips_show_where_the_mass_is_known():
    clean = generate(36, {}, ScenarioOptions(duration=8.0))
    names = tuple(clean.streams.contacts)
    gains = dict(zip(names, (0.2, 0.05, 0.1, -0.1), strict=True))
    contacts = {
        name: replace(stream, force=(1.0 + gains[name]) * stream.force)
        for name, stream in clean.streams.contacts.items()
    }
    fitted = estimate(
        replace(clean.streams, contacts=contacts), [create_effect("force_scale:" + "+".join(names))]
    )
    found = fingertip_gains(fitted, clean.scenario.body.mass, 0.002 * clean.scenario.body.mass)
    for name, (gain, std) in found.items():
        assert abs(gain - gains[name]) < 4.0 * std < 0.1


def test_wrist_and_joints_of_a_bag_become_what_the_wrist_carries(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    kinematics = HandKinematics()
    robot = kinematics.robot
    joints, wrench = (
        store.types[f"{kind}"]
        for kind in ("sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped")
    )
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    vector = store.types["geometry_msgs/msg/Vector3"]
    pair = store.types["geometry_msgs/msg/Wrench"]
    with Writer(tmp_path / "bag", version=9) as writer:
        lines = [
            writer.add_connection(topic, kind.__msgtype__, typestore=store)
            for topic, kind in (("/joint_states", joints), ("/wrist/wrench", wrench))
        ]
        for k in range(50):
            head = header(stamp=stamp(sec=k // 10, nanosec=k % 10 * 10**8), frame_id="f")
            angles = robot.start + 0.01 * k
            state = joints(
                header=head,
                name=list(robot.joint_names),
                position=angles,
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            measured = wrench(
                header=head,
                wrench=pair(
                    force=vector(x=1.0, y=2.0, z=-10.0), torque=vector(x=0.1, y=0.2, z=0.3)
                ),
            )
            for line, message, kind in zip(lines, (state, measured), (joints, wrench), strict=True):
                writer.write(line, k * 10**8, store.serialize_cdr(message, kind.__msgtype__))
    carried = td.read_wrist(tmp_path / "bag").streams
    turn = carried.pose.rotation
    in_flange = np.einsum("nji,nj->ni", turn, carried.contacts["wrist"].force)
    np.testing.assert_allclose(in_flange, np.tile([-1.0, -2.0, 10.0], (50, 1)), atol=1e-9)
    assert np.linalg.norm(carried.pose.position[-1] - carried.pose.position[0]) > 0.05
    with pytest.raises(BadInputError, match="--robot"):
        td.read_wrist(tmp_path / "bag", "panda_gripper")


def test_a_bag_without_wrist_is_refused_in_one_line(tmp_path):
    clean = generate(37, {}, ScenarioOptions(duration=2.0))
    bag = Recording(clean.streams, "clean").to_bag(tmp_path / "bag")
    with pytest.raises(BadInputError, match="no /wrist/wrench and no /joint_states"):
        td.read_wrist(bag)


def test_the_wrist_needs_the_file_of_the_hand():
    with pytest.raises(BadInputError, match="the file of the hand"):
        td.estimate(fingers_of(WristLog.carrying(32, [LOAD], 2.0)), hand="hand.yaml")


def test_wrist_share_needs_something_held():
    log = WristLog.carrying(38, [LOAD], 2.0)
    share = WristShare(fingers_of(log), wrist_of(log).between(90.0, 91.0), _exact_hand())
    with pytest.raises(BadInputError, match="nothing was recorded while the object was held"):
        _ = share.body


def _exact_hand() -> KnownBody:
    mass, com = HAND
    return KnownBody.exact(InertialParameters(mass, com, mass * INERTIA_PER_MASS), "hand")
