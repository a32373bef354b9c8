"""Two parts on a joint: where pushes take them, where the joint lies, what rubs, to a goal."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.explore.stage import Stage, planar
from tactile_dynamics_ros.core.planar.control.controller import PushController
from tactile_dynamics_ros.core.planar.control.joint_watch import (
    JointWatch,
    PushRecord,
    body_of_two,
    rubbing,
)
from tactile_dynamics_ros.core.planar.control.jointed import (
    Hinge,
    JointedBody,
    Rubbing,
    Tips,
    hinged_motion,
)
from tactile_dynamics_ros.core.planar.control.performance import Seen
from tactile_dynamics_ros.core.planar.control.plan import Bounds, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.mechanics.limit_surface import pushed_twist
from tactile_dynamics_ros.core.planar.mechanics.linkage import (
    Joint,
    Link,
    Linkage,
    placed,
    turned,
)
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import (
    GRAVITY,
    PlanarSimulation,
    StepConfig,
)
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig

FIRST = np.array([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]])
SECOND = np.array([[-0.04, -0.03], [0.04, -0.03], [0.04, 0.03], [-0.04, 0.03]])
HINGE = Hinge(np.array([0.052, 0.0]), np.array([-0.042, 0.0]))
RADIUS, FRICTION = 0.006, 0.35
BOUNDS = Bounds(np.array([0.0, -0.6]), np.array([1.0, 0.6]))
GOAL = np.array([0.5, 0.1, 0.0])


def parts(second=SECOND):
    return tuple(
        PushedBody.from_footprint(each, None, RADIUS, FRICTION) for each in (FIRST, second)
    )


def jointed(share=0.5, joint=0.0, bend=-0.2):
    presumed = Rubbing.presumed(parts(), HINGE)
    forces = np.array([[share], [1.0 - share]])
    rubs = replace(presumed, forces=forces, joint=np.array([joint]))
    return JointedBody(parts(), HINGE, bend, rubs)


class PointFriction:
    """Coulomb friction of every point, quasi-static; the tip pushes the part that is nearer."""

    def __init__(self, body, pose):
        self.body = body
        one = np.ones(1)
        links = [
            Link(
                SupportPatch(p.outline),
                one * f / 0.3,
                0.3 * one,
                p.com[None],
                1e-6 * one,
                1e-3 * one,
                one,
            )
            for p, f in zip(body.parts, body.rubbing.forces[:, 0], strict=True)
        ]
        torque = body.rubbing.joint * GRAVITY  # the parts' friction force is that of 1 kg
        hinge = body.hinge
        joint = Joint(hinge.first[None], hinge.second[None], torque, hinge.locked)
        linkage = Linkage(tuple(links), joint)
        start = np.stack([each[0] for each in body.poses(body.states(pose, 1))])[None]
        config = StepConfig(quasi_static=True)
        self.tables = [
            PlanarSimulation(
                linkage, Tip(p.outline, 1e-6 * one, FRICTION * one, link=k), start, config
            )
            for k, p in enumerate(body.parts)
        ]

    @property
    def poses(self):
        table = self.tables[0]
        return table.linkage.frames(table.coordinates)[0]

    def move(self, tip, way):
        """Move a tip (2,) by a way (2,); its surface is a point that lies a radius ahead."""
        first, second = self.poses
        found = [
            part.touch(tip[None], pose[None])
            for part, pose in zip(self.body.parts, (first, second), strict=True)
        ]
        k = int(found[1][0][0] < found[0][0][0])
        ahead = RADIUS * found[k][1][0]
        before, after = (np.append(at, 0.0)[None] for at in (tip + ahead, tip + way + ahead))
        self.tables[k].step(before, after)
        self.tables[1 - k].coordinates = self.tables[k].coordinates.copy()


PUSHES = {
    "first, at its end": (0, (-0.05, 0.02), (1.0, 0.0), (0.04, 0.0)),
    "first, from the side": (0, (0.02, -0.04), (0.0, 1.0), (0.0, 0.04)),
    "second, from the side": (1, (0.0, -0.03), (0.0, 1.0), (-0.005, 0.04)),
}


@pytest.mark.parametrize("joint", [0.0, 0.01])
@pytest.mark.parametrize("push", PUSHES)
def test_a_jointed_pair_goes_where_friction_of_every_point_takes_it(push, joint):
    part, point, normal, way = PUSHES[push]
    body, pose = jointed(0.6, joint), np.array([0.4, 0.0, 0.5])
    state = body.states(pose, 1)
    place = body.poses(state)[part]
    inward, way = (turned(np.array([v]), place[:, 2])[0] for v in (normal, way))
    tip = placed(np.array([point]), place)[0] - RADIUS * inward
    table, steps = PointFriction(body, pose), 80
    for k in range(steps):
        table.move(tip + k / steps * way, way / steps)
    after, _ = body.pushed_along(state, tip[None], [way[None] / 9] * 9)
    first, second = table.poses
    np.testing.assert_allclose(after[0, :2], first[:2], atol=4e-3)
    np.testing.assert_allclose(after[0, 2:], [first[2], second[2]], atol=0.15)
    assert max(abs(first[2] - pose[2]), abs(second[2] - state[0, 3])) > 0.09  # it turned at all


def test_two_parts_as_one_body_go_where_friction_of_every_point_takes_it():
    """Forces of both parts differ, so that the centre lies far from the middle of the areas."""
    hinge = Hinge(np.array([0.02, 0.0]), np.array([-0.074, 0.0]), locked=True)
    presumed = Rubbing.presumed(parts(), hinge)
    body = JointedBody(parts(), hinge, 0.0, replace(presumed, forces=np.array([[0.2], [0.8]])))
    table, pose = PointFriction(body, np.zeros(3)), np.zeros(3)
    state = body.states(pose, 1)
    tip, way, steps = np.array([0.03, -0.046]), np.array([0.0, 0.04]), 80
    for k in range(steps):
        table.move(tip + k / steps * way, way / steps)
    after, _ = body.pushed_along(state, tip[None], [way[None] / 9] * 9)
    np.testing.assert_allclose(after[0, :2], table.poses[0][:2], atol=3e-3)
    np.testing.assert_allclose(after[0, 2], table.poses[0][2], atol=0.08)
    assert abs(after[0, 2]) > 0.3  # it turned at all
    assert abs(after[0, 3] - after[0, 2]) < 0.02  # and not the joint


def random_tips(count=200, seed=3):
    rng = np.random.default_rng(seed)
    normal = np.exp(1j * rng.uniform(-np.pi, np.pi, count))
    way = normal * np.exp(1j * rng.uniform(-0.2, 0.2, count)) * 1e-3
    point = rng.normal(size=count) * 0.04 + 1j * rng.normal(size=count) * 0.04
    return Tips(point, normal, way, rng.integers(0, 2, count), FRICTION)


def test_a_second_part_without_friction_leaves_the_motion_of_one_body_alone():
    tips = random_tips()
    tips = replace(tips, part=np.zeros_like(tips.part))
    body = jointed(1.0 - 1e-9)
    slip = hinged_motion(body.rubbing, np.ones((2, 200), complex), tips)

    def plane(z):
        return np.stack([z.real, z.imag], axis=1)

    arm = body.rubbing.arms[0]
    one = pushed_twist(
        plane(tips.point - arm),
        plane(tips.normal),
        plane(tips.way),
        np.full(200, body.parts[0].radius),
        np.full(200, FRICTION),
    )
    centre = slip.joint + 1j * slip.turns[0] * arm
    np.testing.assert_allclose(plane(centre), one[:, :2], atol=1e-8)
    np.testing.assert_allclose(slip.turns[0], one[:, 2], atol=1e-7)


def test_only_the_ratio_of_friction_forces_counts():
    tips, rubs = random_tips(), jointed(0.3, 0.01).rubbing
    axes = np.exp(1j * np.array([[0.2], [0.9]])) * np.ones((1, 200))
    one = hinged_motion(rubs, axes, tips)
    ten = hinged_motion(
        replace(rubs, forces=10.0 * rubs.forces, joint=10.0 * rubs.joint), axes, tips
    )
    np.testing.assert_allclose(ten.turns, one.turns, atol=1e-12)
    other = hinged_motion(replace(rubs, forces=rubs.forces[::-1]), axes, tips)
    assert np.abs(other.turns - one.turns).max() > 1e-3


def test_no_motion_that_follows_a_sticking_tip_costs_less():
    """Dissipation of other motions with the same point at the tip, by its own definition."""
    rubs = jointed(0.4, 0.005).rubbing
    tips = replace(random_tips(), friction=1e9)
    axes = np.exp(1j * np.array([[0.2], [0.9]])) * np.ones((1, 200))
    slip = hinged_motion(rubs, axes, tips)
    for _ in range(15):
        slip = hinged_motion(rubs, axes, tips, slip)

    def cost(joint, turns):
        centres = joint + 1j * turns * axes * rubs.arms
        speed = np.sqrt(np.abs(centres) ** 2 + (rubs.radii * turns) ** 2)
        return (rubs.forces * speed).sum(axis=0) + rubs.joint * np.abs(turns[0] - turns[1])

    def at_tip(joint, turns):
        return joint + 1j * np.where(tips.part == 0, *turns) * tips.point

    np.testing.assert_allclose(at_tip(slip.joint, slip.turns), tips.way, atol=1e-9)
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 1e-1):
        turns = slip.turns + size * 0.02 * rng.normal(size=slip.turns.shape)
        joint = tips.way - 1j * np.where(tips.part == 0, *turns) * tips.point
        assert np.all(cost(joint, turns) > cost(slip.joint, slip.turns) * (1.0 - 2e-3))


def test_the_joint_stays_where_it_is_in_both_parts_and_the_tip_outside():
    body, pose = jointed(0.6, 0.003), np.array([0.4, 0.0, 0.5])
    state = body.states(pose, 50)
    point, inward = body.place(np.linspace(0.0, 1.0, 50, endpoint=False), state)
    tip = point - RADIUS * inward
    after, at = body.pushed_along(state, tip, [0.004 * inward] * 8)
    first, second = body.poses(after)
    joints = placed(HINGE.first[None], first), placed(HINGE.second[None], second)
    np.testing.assert_allclose(*joints, atol=1e-12)
    assert np.abs(after - state).max() > 0.02
    free = body.struck(tip, state) == 0.0
    assert np.all(body.touch(at, after)[0][free] > RADIUS - 2e-3)


def test_what_folds_parts_into_each_other_is_told_by_how_much():
    body = jointed(bend=0.0)  # faces of 6 and 8 cm that are 4 mm apart
    state = body.states(np.zeros(3), 5)
    state[:, 3] = [0.1, 0.6, -0.6, 0.6 + 2.0 * np.pi, 0.9]
    grid = np.deg2rad(6.0)
    ends = np.arcsin((0.003 + 0.002 + 0.002) / 0.03)  # a corner of the second is 3 mm inside
    turn = body.folded(state) / body.rubbing.radii.max()
    assert turn[0] == 0.0
    np.testing.assert_allclose(turn[1:4], turn[1], rtol=1e-6)
    assert 0.6 - ends - 1e-3 <= turn[1] <= 0.6 - ends + grid
    np.testing.assert_allclose(turn[4] - turn[1], 0.3, atol=1e-6)


def test_parts_that_reach_into_each_other_are_unfolded_first():
    body = jointed(0.5, 0.002, bend=0.9)
    pose = np.array([0.5, 0.1, 0.2])
    planner = PushPlanner(body, GOAL, BOUNDS)
    push = planner.plan(pose)
    state, ways = body.states(pose, 1), [push.length / 9 * push.direction[None]] * 9
    after, _ = body.pushed_along(state, push.start[None], ways)
    assert body.folded(after)[0] < 0.5 * body.folded(state)[0]
    assert planner.left(pose) > planner.error(pose[None])[0] + 0.03


def watched(turns, hinge=HINGE, noise=(4e-4, 3e-3), play=None, seed=0):
    """A watch that saw a pair with its second part at some turns for half a second each."""
    rng, watch, time = np.random.default_rng(seed), JointWatch(), 0.0
    for k, turn in enumerate(turns):
        pose = np.array([0.4 + 0.01 * k, 0.1, 0.7 + 0.2 * k])
        body = JointedBody(parts(), hinge, turn, Rubbing.presumed(parts(), hinge))
        second = body.poses(body.states(pose, 1))[1][0]
        second[:2] += np.zeros(2) if play is None else play[k]
        for _ in range(32):
            std = np.array([noise[0], noise[0], noise[1]])
            seen = [each + std * rng.normal(size=3) for each in (pose, second)]
            time += 1 / 30
            watch.add((time, seen[0]), (time, seen[1]), None)
    return watch


def test_a_joint_is_found_where_parts_turn_about():
    hinge = Hinge(np.array([0.05, 0.012]), np.array([-0.044, -0.003]))
    watch = watched(np.linspace(0.0, 0.5, 6), hinge)
    found = watch.hinge(FIRST, SECOND)
    np.testing.assert_allclose(found.first, hinge.first, atol=1.5e-3)
    np.testing.assert_allclose(found.second, hinge.second, atol=1.5e-3)
    assert watch.turned


def test_parts_that_hardly_turn_are_one_body_and_no_joint_is_claimed():
    for seed in range(8):
        watch = watched(0.012 * np.array([0.0, 1.0, -1.0, 1.0, 0.0, -1.0]), seed=seed)
        assert not watch.turned
        assert watch.hinge(FIRST, SECOND) is None


def test_parts_that_slide_about_where_they_meet_have_no_joint():
    slide = 0.005 * np.array([[0.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    watch = watched(np.linspace(0.0, 0.5, 5), play=slide)
    assert watch.turned
    assert watch.hinge(FIRST, SECOND) is None
    assert watched(np.linspace(0.0, 0.5, 5), play=0.1 * slide).hinge(FIRST, SECOND) is not None


def test_parts_that_turn_about_a_place_where_they_do_not_meet_have_no_joint():
    watch = watched(np.linspace(0.0, 0.3, 5), Hinge(HINGE.first + 0.04, HINGE.second + 0.04))
    assert watch.turned
    assert watch.hinge(FIRST, SECOND) is None


def test_poses_of_two_images_tell_nothing_of_a_joint():
    for late in (0, 1):
        watch = JointWatch()
        yaws = np.concatenate([np.zeros(32), 0.07 * np.arange(32)])
        for k in range(1, 64):
            first, second = (np.array([0.4, 0.1, yaw]) for yaw in (yaws[k], yaws[k - 1]))
            watch.add((k / 30, first), ((k - late) / 30, second), None)
        assert watch.turned == (late == 0)  # what is taken for one image would turn by 4 degrees


def test_two_parts_are_taken_for_what_was_seen_of_them():
    poses = np.array([0.4, 0.1, 0.0]), np.array([0.494, 0.1, 0.0])
    still, turning = watched(np.zeros(4)), watched(np.linspace(0.0, 0.4, 5))
    slide = np.outer(np.arange(5), [0.003, 0.01])
    apart = watched(np.linspace(0.0, 0.3, 5), play=slide)
    one, two, beside = (body_of_two(parts(), poses, watch) for watch in (still, turning, apart))
    assert one.hinge.locked
    assert "hardly turned" in one.words
    assert not two.hinge.locked
    assert "joint at 52, 0 mm" in two.words
    assert beside.second is not None
    assert "in the way" in beside.words


def recorded(body, count=6, seed=2):
    """Pushes at either part by friction of every point, with noisy poses, as a watch keeps them."""
    rng, record = np.random.default_rng(seed), PushRecord()
    pose = np.array([0.4, 0.0, 0.2])
    table = PointFriction(body, pose)
    for _ in range(count):
        first, second = table.poses
        body = replace(body, bend=float(second[2] - first[2]))
        state = body.states(first, 1)
        point, inward = body.place(rng.uniform(size=1), state)
        tip = (point - RADIUS * inward)[0]
        for _ in range(60):
            first, second = (
                each + np.array([3e-4, 3e-4, 2e-3]) * rng.normal(size=3) for each in table.poses
            )
            record.add(tip, first, second)
            table.move(tip, 1e-3 * inward[0])
            tip = tip + 1e-3 * inward[0]
        record.add(None, first, second)
    return record


@pytest.mark.parametrize(("share", "joint"), [(0.3, 0.02), (0.7, 0.005)])
def test_pushes_tell_how_friction_is_shared_and_how_hard_the_joint_turns(share, joint):
    found = rubbing(parts(), HINGE, recorded(jointed(share, joint)).fitted(parts(), HINGE))
    assert found.forces[0, 0] == pytest.approx(share, abs=0.1)
    assert 0.6 < found.joint[0] / joint < 1.6


def test_without_pushes_friction_is_as_presumed():
    found = rubbing(parts(), HINGE, PushRecord().fitted(parts(), HINGE))
    np.testing.assert_allclose(found.forces[:, 0], [0.625, 0.375], rtol=1e-6)


class World:
    """A pair under friction of every point, seen with noise; the watch knows nothing at first."""

    def __init__(self):
        self.rng, self.watch = np.random.default_rng(0), JointWatch()
        body = jointed(0.35, 0.008, bend=0.5)
        self.table = PointFriction(body, np.array([0.46, 0.08, 0.3]))
        self.tip, self.time = np.array([0.3, -0.2, 0.3, 0.0]), 0.0
        self.look()

    def look(self):
        std = np.array([5e-4, 5e-4, 3e-3])
        self.seen = [each + std * self.rng.normal(size=3) for each in self.table.poses]
        tip = self.tip[:2].copy() if self.tip[2] < 0.03 else None
        self.watch.add((self.time, self.seen[0]), (self.time, self.seen[1]), tip)

    def run(self, controller):
        while controller.outcome is None:
            controller.skip_way()
            if controller.phase in ("look", "push"):
                controller.planner.body = body_of_two(parts(), self.seen, self.watch)
            target = controller.advance(Seen(self.time, self.tip, self.seen[0], self.time))
            if self.tip[2] < 0.05 and target[2] < 0.05:
                self.table.move(self.tip[:2], (target - self.tip)[:2])
            self.tip, self.time = target, self.time + 1 / 30
            self.look()
        return controller.outcome


def test_a_jointed_pair_comes_to_its_goal_though_nothing_is_known_of_its_joint():
    world = World()
    body = body_of_two(parts(), world.seen, world.watch)
    controller = PushController(PushPlanner(body, GOAL, BOUNDS))
    outcome = world.run(controller)
    away = world.table.poses[0] - GOAL
    assert outcome.reached, outcome
    assert np.hypot(*away[:2]) < 3e-3
    assert abs(away[2]) < np.deg2rad(2.5)
    found = controller.planner.body
    assert not found.hinge.locked  # the joint was found on the way
    assert found.rubbing.forces[0, 0] < 0.57  # 0.35 in truth, presumed as the areas: 0.625


def test_a_tip_keeps_off_the_part_that_it_does_not_push():
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    disc = 0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1)  # that turns beside the face
    body = replace(jointed(0.5), parts=parts(disc), bend=0.3)
    state = body.states(np.zeros(3), 1)
    assert body.struck(np.array([[-0.056, 0.0]]), state)[0] == 0.0
    notch = HINGE.first + np.array([[0.003, -0.016]])  # 5 mm from the face
    middle = HINGE.first + 0.042 * np.array([np.cos(0.3), np.sin(0.3)])
    far = np.linalg.norm(notch[0] - middle) - 0.04
    assert body.struck(notch, state)[0] == pytest.approx(RADIUS + 0.003 - far, abs=5e-4)
    assert body.away(notch, state)[0, 1] < -0.7
    folded = body.states(np.zeros(3), 1) + [0.0, 0.0, 0.0, 1.5]
    assert body.struck(notch, folded)[0] == 0.0


@pytest.mark.parametrize("place", [0.7, 0.9])  # of both outlines: on the second part
def test_one_straight_push_on_the_simulated_table_ends_where_it_was_predicted(place):
    """PyBullet, even friction; masses, friction and centres are given, as no fit is tested here."""
    still = SimulatedTableConfig(seed=5, object_number=84, noise=False, friction_spread=0.0)
    stage = Stage(still)
    try:
        thing, links = stage.table.world.bodies[0].thing, stage.table.outlines
        forces = np.array([[part.mass * part.friction * GRAVITY] for part in thing.parts])
        pair = tuple(
            PushedBody.from_footprint(link.corners, link.part.com - link.middle, RADIUS, FRICTION)
            for link in links
        )
        hinge = Hinge(*(thing.joint - link.middle for link in links))
        rubs = replace(
            Rubbing.presumed(pair, hinge),
            forces=forces / forces.sum(),
            joint=np.array([thing.joint_friction / forces.sum()]),
        )
        pose, second = (planar(link.pose()) for link in links)
        body = JointedBody(pair, hinge, second[2] - pose[2], rubs)
        state = body.states(pose, 1)
        point, inward = body.place(np.array([place]), state)
        tip, way = (point - (RADIUS + 1e-3) * inward)[0], 0.04 * inward[0]
        frame = np.array([*tip, 0.012, 0.0])
        stage.table.pusher.place(frame)
        for k in range(100):
            target = np.eye(4)
            target[:3, 3] = [*(tip + (k + 1) / 100 * way), 0.012]
            stage.table.pusher.go_to(target)
            stage.table.advance(looking=False)
        after, _ = body.pushed_along(state, tip[None], [way[None] / 9] * 9)
        first, second = (planar(link.pose()) for link in links)
    finally:
        stage.close()
    assert np.hypot(*(second[:2] - body.poses(state)[1][0, :2])) > 0.02  # it moved at all
    np.testing.assert_allclose(after[0, :2], first[:2], atol=6e-3)
    np.testing.assert_allclose(after[0, 2:], [first[2], second[2]], atol=0.15)
