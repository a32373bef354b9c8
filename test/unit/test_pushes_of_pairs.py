"""How two parts on a joint begin to move, and the push that would tell what they are."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.planar.linked.description import remedies
from tactile_dynamics_ros.core.planar.linked.pushes import (
    KnownPair,
    PairPushes,
    begun_motion,
    locked,
    possible_pushes,
    telling_push,
)
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions

BOX = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
LONG = BOX * [1.4, 1.0]
JOINT = np.array([[0.055, 0.01], [-0.075, -0.005]])


@pytest.fixture(scope="module")
def pair():
    """A short and a long box on a joint that is off their middle line."""
    return KnownPair((SupportPatch(BOX), SupportPatch(LONG)), np.array([1.2, 2.0]), JOINT, 0.01)


@pytest.fixture(scope="module")
def pushes():
    """All around both, bent by 30 degrees on a turned table."""
    return possible_pushes((BOX, LONG), JOINT, np.array([[0.1, -0.2, 0.7, 0.7 + 0.52]]), (0.1,))


def _lost(pair, pushes, velocity):
    """Power (K,) that all points of both footprints and the joint take, by each point's speed."""
    total = pair.torque * np.abs(velocity[:, 3] - velocity[:, 2])
    for row, (a, b) in enumerate(pushes.pose[:, 2:]):
        vx, vy, first, second = velocity[row]
        turn = [np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]) for t in (a, b)]
        arm = turn[0] @ pair.joint[0]
        at_joint = np.array([vx - first * arm[1], vy + first * arm[0]])
        for k, (base, rate) in enumerate([(np.array([vx, vy]), first), (at_joint, second)]):
            patch = pair.patches[k]
            feet = patch.centroid + patch.offset - (pair.joint[1] if k else 0.0)
            feet = feet @ turn[k].T
            speed = base + rate * np.stack([-feet[:, 1], feet[:, 0]], axis=1)
            total[row] += pair.forces[k] * patch.share @ np.linalg.norm(speed, axis=1)
    return total


def _touched_speed(pair, pushes, velocity):
    """Velocity (K, 2) of the touched point, as a difference quotient of its place."""
    h = 1e-6
    return (replace(pushes, pose=pushes.pose + h * velocity).place(pair) - pushes.place(pair)) / h


def test_a_push_does_the_work_that_friction_takes_and_no_motion_takes_less(pair, pushes):
    motion = begun_motion(pushes, pair)
    wanted = pushes.speed[:, None] * pushes.way
    np.testing.assert_allclose(_touched_speed(pair, pushes, motion.velocity), wanted, atol=1e-6)
    lost = _lost(pair, pushes, motion.velocity)
    np.testing.assert_allclose(np.sum(motion.force * wanted, axis=1), lost, rtol=0.01)
    random = np.random.default_rng(0)
    for _ in range(20):
        other = motion.velocity + random.normal(size=motion.velocity.shape) * [0.02, 0.02, 0.3, 0.3]
        miss = _touched_speed(pair, pushes, other) - wanted
        other[:, :2] -= miss  # both rates kept, the touched point moves as the tip
        assert np.all(_lost(pair, pushes, other) > lost * 0.998)


def test_a_joint_that_holds_passes_on_what_its_friction_would_have_to_be(pair, pushes):
    held = begun_motion(pushes, locked(pair))
    assert np.abs(held.turning).max() < 1e-3
    assert np.abs(held.torque).max() > 0.02
    stiff = replace(pair, torque=1.2 * np.abs(held.torque))
    loose = replace(pair, torque=0.7 * np.abs(held.torque))
    strong = np.abs(held.torque) > 0.01
    assert np.abs(begun_motion(pushes, stiff).turning[strong]).max() < 0.05
    assert np.abs(begun_motion(pushes, loose).turning[strong]).min() > 0.1


def test_pushes_go_inwards_and_leave_the_other_part_alone(pair, pushes):
    inside = replace(pushes, point=pushes.point + 1e-3 * pushes.normal)
    for part, outline in ((0, BOX), (1, LONG)):
        points = inside.point[pushes.part == part]
        assert len(points) > 4
        assert np.all(np.abs(points) < outline.max(axis=0))
    away = pushes.place(pair)[:, None] - pushes.place(pair)[None]
    first = pushes.part == 0
    assert np.linalg.norm(away[first][:, ~first], axis=2).min() > 0.01


def test_what_would_tell_two_parts_names_part_place_way_and_torque():
    [made] = pushed.generate(
        [701], {}, pushed.PushOptions(kind="rigid_pair", actions=ActionOptions(count=1))
    )
    parts = Pair.of_streams(made.streams).seen
    push = telling_push(parts)
    held = _torque_of(push, parts)
    assert push.torque == pytest.approx(held, rel=0.02)
    assert f"push link_{push.part + 1} at (" in push.words
    assert "mm at 0.2 m/s" in push.words
    [said] = remedies("undecided", False, (), push=push)
    assert said.endswith(push.words)
    [said] = remedies("jointed", True, ("link_1.mass",), push=push)
    assert said.endswith(push.words)


def _torque_of(push, parts):
    """Torque (N m) between both parts in that push, from the other part's friction."""
    first, second = (SupportPatch(outline) for outline in parts.outlines)
    yaws = np.array([parts.poses[0][-1, 2], parts.poses[1][-1, 2]])
    pose = np.append(parts.poses[0][-1], yaws[1])[None]
    areas = np.array([np.prod(np.ptp(o, axis=0)) for o in parts.outlines])
    middle = parts.outlines[0][:, 0].max()
    joint = np.array([[middle, 0.0], [middle - parts.offset[0], 0.0]])
    known = KnownPair((first, second), parts.force * areas / areas.sum(), joint, 1e3)
    along = push.heading - yaws[push.part]
    way = np.array([[np.cos(along), np.sin(along)]])
    one = PairPushes(np.array([push.part]), push.point[None], way, np.array([0.2]), pose)
    return float(np.abs(begun_motion(one, known).torque[0]))
