"""Links on a table are followed in depth images, silent when they are gone, found again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.following.script import write_script
from benchmarks.following.stage import GRIPPER, LENS, Stage
from benchmarks.following.trial import GRIPPER_URDF, camera_pose, modelled, tool
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.core.tracking.depth_image import PinholeCamera
from tactile_dynamics_ros.core.tracking.links.link_tracker import Link
from tactile_dynamics_ros.core.tracking.links.motion import LinkMotion, LinkMotionConfig
from tactile_dynamics_ros.core.tracking.links.table_tracker import TableTracker
from tactile_dynamics_ros.core.tracking.robot_volume import TreeVolume
from tactile_dynamics_ros.core.tracking.watch import TrackingState
from tactile_dynamics_ros.sim.objects import planar_object

AWAY = np.array([0.5, 0.0, 2.0, 0.0])


@pytest.fixture
def pair():
    """A jointed pair, its script, a stage and a tracker."""
    thing = planar_object(83)
    moments = write_script(thing, 4)
    stage = Stage([part.solid() for part in thing.parts], 3)
    links = modelled(thing, moments[0])
    yield moments, stage, links, TableTracker([e.link for e in links], TreeVolume(GRIPPER_URDF))
    stage.close()


def show(stage, tracker, moment, parts, joints=AWAY):
    pose = camera_pose(0.7, 0.4, 0.0)
    stage.place(parts, tool(joints))
    camera = PinholeCamera(LENS.intrinsics, LENS.width, LENS.height, pose)
    return tracker.update(stage.measure(pose), camera, moment.time, joints)


def test_both_links_are_followed_silent_when_gone_and_found_again(pair):
    moments, stage, links, tracker = pair
    for moment in moments[:12]:
        told = show(stage, tracker, moment, moment.parts)
    for each in links:
        error = told[each.link.name].pose - moment.parts[each.part] @ each.offset
        assert np.linalg.norm(error[:2, 3]) < 2e-3
        assert 1e-4 < np.sqrt(told[each.link.name].covariance[3, 3]) < 3e-3
    later = [replace(moment, time=moment.time + 0.1 * k) for k in range(1, 15)]
    assert [show(stage, tracker, m, ()) for m in later[:2]] == [{}, {}]
    assert set(tracker.states.values()) == {TrackingState.HIDDEN}
    told = [show(stage, tracker, m, moment.parts) for m in later[2:6]]
    assert len(told[-1]) == 2


def test_the_robot_is_where_its_urdf_and_its_joints_say():
    pose = camera_pose(0.0, 0.4, 0.0)
    camera = PinholeCamera(LENS.intrinsics, LENS.width, LENS.height, pose)
    row, column = np.mgrid[: LENS.height, : LENS.width].astype(float)
    rays = camera.rays(row.ravel(), column.ravel()).reshape(LENS.height, LENS.width, 3)
    joints = np.array([0.5, 0.03, 0.5 * GRIPPER[2], 0.4])
    volume = TreeVolume(GRIPPER_URDF, margin=0.0)
    stage = Stage([], 0)
    stage.place((), None)
    bare = stage.render(pose)
    stage.place((), tool(joints))
    drawn = stage.render(pose) < bare - 2e-3
    stage.close()
    expected = volume.depth(joints, pose, rays) < bare - 2e-3
    assert drawn.sum() > 1000
    assert np.mean(drawn != expected) < 0.01
    assert volume.joint_names == ("x", "y", "z", "yaw")


def test_what_no_image_shows_stays_unknown():
    prior = np.diag([0.1**2] * 3 + [1e-3**2] * 3)
    motion = LinkMotion(np.eye(4), prior, np.zeros(3), (2, 3, 4), LinkMotionConfig())
    seen = np.diag([0.0, 1e6, 1e6])
    spread = [motion.correct(np.eye(4), seen, 0.1 * k)[0, 0] for k in range(20)]
    assert np.all(np.diff(spread) > 0.0)
    assert motion.predicted(1.95) == pytest.approx(np.eye(4), abs=1e-6)


def test_a_turn_that_other_turns_explain_as_well_is_told_as_unsure_when_found_again():
    thing = planar_object(122)
    assert thing.parts[0].outline == "cylinder"
    moment = write_script(thing, 4)[0]
    stage = Stage([part.solid() for part in thing.parts], 3)
    true = modelled(thing, moment)[0].link
    half = true.shape.half * [1.02, 0.98, 1.0]
    oval = Superquadric(half, np.array([0.05, 1.0]), np.zeros(2), true.pose)
    std = dict.fromkeys(("x", "y", "yaw", "ax", "ay", "az"), 1e-3)
    tracker = TableTracker([Link.of_superquadric("link_1", oval, std)])
    assert len(tracker.links[0].link.shape.symmetry_axes) == 0
    told = [show(stage, tracker, replace(moment, time=0.1 * k), moment.parts) for k in range(4)]
    assert np.sqrt(told[-1]["link_1"].covariance[2, 2]) < np.deg2rad(5.0)
    for k in range(10):
        assert show(stage, tracker, replace(moment, time=1.0 + 0.1 * k), ()) == {}
    again = [replace(moment, time=3.0 + 0.5 * k) for k in range(4)]
    told = [show(stage, tracker, later, moment.parts) for later in again]
    assert np.sqrt(told[-1]["link_1"].covariance[2, 2]) > np.deg2rad(10.0)
    stage.close()
