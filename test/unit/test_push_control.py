"""Pushing to a pose: prediction against the mechanics, search, closed loop, what stops it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.peers.centring import CentringPusher
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.actions.affordances import ExploreConfig
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer
from tactile_dynamics_ros.core.planar.actions.information import Belief, PredictedObject
from tactile_dynamics_ros.core.planar.control.controller import ControlConfig, PushController
from tactile_dynamics_ros.core.planar.control.foresight import Task, next_for
from tactile_dynamics_ros.core.planar.control.performance import Clock, Guard, GuardConfig, Seen
from tactile_dynamics_ros.core.planar.control.plan import Bounds, Push, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody, pushed
from tactile_dynamics_ros.core.planar.mechanics.linkage import Link, Linkage, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import StepConfig, simulate
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

BOX = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
BOUNDS = Bounds(np.array([0.0, -0.6]), np.array([1.0, 0.6]))
GOAL = np.array([0.5, 0.1, 0.0])


def body(com=(0.008, -0.005)):
    return PushedBody.from_footprint(BOX, np.array(com), 0.006, 0.35)


def test_a_pushed_box_goes_where_friction_of_every_point_takes_it():
    thing = body()
    start, way = np.array([-0.05, 0.02]), np.array([0.03, 0.0])
    pose, tip = np.zeros((1, 3)), start[None] - [0.006, 0.0]
    for _ in range(60):
        pose, tip = pushed(thing, pose, tip, way[None] / 60)
    patch = SupportPatch(BOX)
    one = np.ones(1)
    link = Link(patch, one, 0.3 * one, thing.com[None], 1e-6 * one, 1e-3 * one, one)
    steps = 120
    path = np.zeros((1, steps + 1, 3))
    path[0, :, :2] = start + np.linspace(0.0, 1.0, steps + 1)[:, None] * way
    outline_tip = Tip(BOX, 1e-6 * one, 0.35 * one)
    config = StepConfig(quasi_static=True)
    motion = simulate(Linkage((link,)), outline_tip, np.zeros((1, 1, 3)), path, config)
    np.testing.assert_allclose(pose[0, :2], motion.pose[0, -1, 0, :2], atol=2.5e-3)
    assert pose[0, 2] == pytest.approx(motion.pose[0, -1, 0, 2], abs=0.06)
    assert abs(pose[0, 2]) > 0.15  # it turned at all


def test_a_tip_beside_the_object_moves_nothing():
    pose, _ = pushed(body(), np.zeros((1, 3)), np.array([[-0.06, 0.0]]), np.array([[0.003, 0.0]]))
    np.testing.assert_array_equal(pose, np.zeros((1, 3)))


def test_a_footprint_that_encloses_nothing_is_refused():
    with pytest.raises(BadInputError, match="enclose"):
        PushedBody.from_footprint(np.zeros((4, 2)), None, 0.006, 0.35)


def test_round_outlines_keep_their_size_with_fewer_vertices():
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    circle = 0.05 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    few = PushedBody.from_footprint(circle[::-1], None, 0.006, 0.35).outline
    assert len(few) <= 48
    np.testing.assert_allclose(np.linalg.norm(few, axis=1), 0.05, atol=1e-9)
    assert area_and_centroid(few)[0] > 0.0  # anticlockwise again


class World:
    """An object with another centre of mass than the planner believes, and noisy poses."""

    def __init__(self, pose, com=(0.004, 0.0)):
        self.thing, self.pose = body(com), np.array(pose)
        self.tip, self.time, self.force = np.array([0.3, -0.2, 0.3, 0.0]), 0.0, 0.0
        self.seen_pose, self.seen_time = self.pose, 0.0
        self.rng = np.random.default_rng(0)

    def seen(self):
        if self.time - self.seen_time >= 1.0 / 30.0 or self.time == 0.0:
            self.seen_pose = self.pose + self.rng.normal(size=3) * [5e-4, 5e-4, 3e-3]
            self.seen_time = self.time
        return Seen(self.time, self.tip, self.seen_pose, self.seen_time, self.force)

    def go(self, target):
        low = self.tip[2] < 0.05 and target[2] < 0.05
        if low:
            way = (target - self.tip)[None, :2]
            pose, _ = pushed(self.thing, self.pose[None], self.tip[None, :2], way)
            self.pose = pose[0]
        self.tip = target
        self.time += 0.02

    def run(self, controller):
        for _ in range(8000):
            controller.skip_way()
            target = controller.advance(self.seen())
            if controller.outcome is not None:
                return controller.outcome
            self.go(target)
        raise AssertionError("it does not end")


def test_an_object_comes_to_its_goal_though_its_centre_is_not_quite_known():
    world = World((0.45, 0.07, 0.4))
    outcome = world.run(PushController(PushPlanner(body(), GOAL, BOUNDS)))
    away = world.pose - GOAL
    assert outcome.reached, outcome
    assert np.hypot(*away[:2]) < 3e-3
    assert abs(away[2]) < np.deg2rad(2.5)
    assert outcome.pushes <= 10


class Deluded(PushPlanner):
    """Expects that going on always helps, whatever the object does."""

    def go_on(self, plan, pose, tip, normal):
        return Push(tip, normal, 0.1, normal, 0.0, plan)


def test_a_push_ends_where_the_object_moves_otherwise_than_predicted():
    world = World([0.45, 0.1, 0.0])
    planner = Deluded(body(), GOAL, BOUNDS)
    controller = PushController(planner, config=ControlConfig(most_time=15.0))
    errors = []
    while controller.outcome is None and controller.pushes < 2:
        target = controller.advance(world.seen())
        if controller.phase == "push":
            errors.append(float(planner.error(world.pose[None])[0]))
        world.go(target)
    assert min(errors) + 0.025 < errors[-1] < min(errors) + 0.035


def test_corrections_on_the_way_are_what_makes_it_exact():
    ends = []
    for rate in (10.0, 0.5):
        world = World((0.44, 0.1, 0.1), com=(-0.012, 0.008))
        config = ControlConfig(rate_hz=rate, most_time=60.0)
        controller = PushController(PushPlanner(body(), GOAL, BOUNDS), config=config)
        while controller.phase != "leave" and controller.outcome is None:
            controller.skip_way()
            world.go(controller.advance(world.seen()))
        ends.append(float(controller.planner.error(world.pose[None])[0]))
    assert ends[0] < ends[1]


def test_the_rule_of_the_centre_brings_a_straight_object_near():
    world = World((0.4, 0.0, 0.1), com=(0.0, 0.0))
    thing = body((0.0, 0.0))
    outcome = world.run(PushController(CentringPusher(thing, GOAL, BOUNDS)))
    assert outcome.error_m < 0.03


def test_pushes_begin_and_end_where_the_arm_may_be():
    low, high = np.array([0.3, -0.05]), np.array([0.8, 0.5])
    planner = PushPlanner(body(), GOAL, Bounds(low, high))
    push = planner.plan(np.array([0.4, 0.03, 0.0]))
    for point in (push.start, push.start + push.length * push.direction):
        assert np.all(point > low - 2e-3)
        assert np.all(point < high + 2e-3)


def still(time=1.0, force=0.0, pose_time=1.0, tip=(0.5, 0.0, 0.2, 0.0)):
    return Seen(time, np.array(tip), np.array([0.4, 0.0, 0.0]), pose_time, force)


def test_a_guard_stops_for_force_stale_poses_and_an_arm_that_does_not_follow():
    guard = Guard(GuardConfig(most_force=10.0, stale=0.5))
    assert guard.reason(still(), None) == ""
    assert "bears 11.0 N" in guard.reason(still(force=11.0), None)
    assert "0.6 s old" in guard.reason(still(pose_time=0.4), None)
    far = np.array([0.6, 0.0, 0.2, 0.0])
    assert guard.reason(still(), far) == ""
    assert guard.reason(still(1.9, pose_time=1.9), far) == ""
    assert "does not follow" in guard.reason(still(2.1, pose_time=2.1), far)


def test_what_has_ended_moves_nothing_any_more():
    controller = PushController(PushPlanner(body(), GOAL, BOUNDS))
    controller.advance(still(0.0, pose_time=0.0))
    controller.stop(still(0.1, pose_time=0.1), "it was told to stop")
    seen = still(5.0, pose_time=5.0)
    np.testing.assert_array_equal(controller.advance(seen), seen.tip)
    assert controller.outcome.why == "it was told to stop"
    assert not controller.outcome.reached
    assert controller.outcome.pushes == 0


def test_a_push_that_is_stopped_midway_has_not_reached_its_goal_wherever_it_was_seen():
    world = World((0.47, 0.1, 0.0))
    controller = PushController(PushPlanner(body(), GOAL, BOUNDS))
    while controller.phase != "push":
        controller.skip_way()
        world.go(controller.advance(world.seen()))
    near = replace(world.seen(), pose=GOAL, force=60.0)
    controller.advance(near)
    assert "bears 60.0 N" in controller.outcome.why
    assert controller.outcome.error_m < 1e-6
    assert not controller.outcome.reached


def test_where_no_push_helps_none_is_made_and_the_object_is_looked_at_again():
    planner = PushPlanner(body(), GOAL, BOUNDS)
    assert planner.plan(GOAL + [1e-4, 0.0, 0.0]).length == 0.0
    world = World(GOAL + [0.004, 0.0, 0.0])
    planner.plan = lambda pose: Push(pose[:2], np.ones(2), 0.0, np.ones(2), 0.0, np.zeros((3, 5)))
    outcome = world.run(PushController(planner))
    assert outcome.pushes == 0
    assert "4 tries" in outcome.why
    assert world.time > 5 * 5 / 30  # five looks of five poses
    assert outcome.reached


def test_a_clock_of_motion_waits_where_poses_come_late():
    clock = Clock()
    times = [clock.advance(now) for now in (5.0, 5.01, 6.0, 6.01)]
    np.testing.assert_allclose(times, [0.0, 0.01, 0.05, 0.06])


NEIGHBOUR = np.array([[0.052, -0.03], [0.132, -0.03], [0.132, 0.03], [0.052, 0.03]])


def of_two():
    return PushedBody.from_footprint(BOX, None, 0.006, 0.35).beside(NEIGHBOUR)


def test_a_second_part_that_no_joint_holds_is_only_in_the_way():
    body = of_two()
    np.testing.assert_allclose(body.com, [0.0, 0.0], atol=1e-9)
    assert body.at(np.linspace(0.0, 1.0, 200, endpoint=False))[0][:, 0].max() < 0.0501
    planner = PushPlanner(body, GOAL, BOUNDS)
    pose = np.array([0.4, 0.1, 0.5])
    for x, strikes in ((0.1, True), (-0.06, False)):
        tip = pose[:2] + turned(np.array([[x, 0.036]]), pose[2:])[0]
        assert planner.strikes(pose, tip) == strikes
    tips = np.array([[0.051, 0.0], [0.08, 0.037], [-0.06, 0.0]])
    struck = body.struck(tips, np.zeros((3, 3)))
    assert np.all(struck[:2] > 0.0)
    assert struck[2] == 0.0


def test_no_push_is_planned_where_the_tip_would_come_down_on_another_part():
    body = of_two()
    goal = np.array([0.38, 0.0, 0.0])  # straight away from where the parts meet
    planner = PushPlanner(body, goal, Bounds(np.array([0.0, -0.5]), np.array([1.0, 0.5])))
    for turn in (0.0, 1.5, 3.0):
        pose = np.array([0.5, 0.0, turn])
        push = planner.plan(pose)
        assert body.crowded(push.start[None], pose[None])[0] == pytest.approx(0.0, abs=1e-4)


def test_exploring_ends_where_pushes_to_the_goal_would_end_near_enough_without_it():
    known = Belief(np.array([-1.0, 0.0, 0.0, 0.0]), np.diag([0.5, 0.5, 4e-3, 4e-3]) ** 2)
    task = Task(GOAL, body((0.0, 0.0)), BOUNDS, np.array([0.4, -0.2, 0.3, 0.0]), 0.01)
    explorer = Explorer(PredictedObject(BOX, points=16), ExploreConfig(places=3, speeds=(0.2,)))
    pose = np.array([0.45, 0.08, 0.1])
    _, said = next_for(task, explorer, known, pose)
    assert said.startswith("the goal needs no more: with the centre of mass known to 5.7 mm")
    errors = list(task.errors(known, pose))
    assert len(set(errors)) == 4
    assert f"within {1e3 * max(errors):.1f} mm" in said
    _, choice = next_for(replace(task, largest=0.5 * max(errors)), explorer, known, pose)
    assert isinstance(choice, Choice)
