"""The simulated arm that pushes: forces, stick and slip, grip, what it refuses, its recordings."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.support.pushing_robot import PushOptions, simulate_pushes
from tactile_dynamics_ros.core.planar.actions.straight import (
    StraightConfig,
    Travel,
    straight_action,
)
from tactile_dynamics_ros.recording.pushed import PushedRecording, recorded_model
from tactile_dynamics_ros.sim.objects import PlanarObject, PlanarPart
from tactile_dynamics_ros.sim.planar.bed import GRAVITY, Surface, uneven_friction
from tactile_dynamics_ros.sim.planar.pusher import Pusher, PusherConfig
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig
from tactile_dynamics_ros.sim.planar.table import TableWorld

LENGTH, WIDTH, MASS, FRICTION = 0.12, 0.06, 0.8, 0.3
CORNERS = 0.5 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * [LENGTH, WIDTH]
WEIGHT = MASS * GRAVITY
PERIOD = 0.01
HEIGHT = 0.02


class Rig:
    """A block alone on an even table, and the arm."""

    def __init__(self, **options):
        block = PlanarPart("box", CORNERS, 0.04, MASS, FRICTION, np.zeros(2))
        thing = PlanarObject(0, "homogeneous", (block,), None, 0.0)
        place = np.array([[0.5, 0.0, 0.0]])
        self.world = TableWorld([thing], place, 0.0, Surface(uneven_friction(0.0, 0)), 1e-3)
        self.pusher = Pusher(self.world, PusherConfig(**options), PERIOD)

    @property
    def block(self):
        """Pose (4, 4) of the block."""
        return self.world.bodies[0].pose()

    def perform(self, action):
        """Carry out an action; return (name of the leg, readings, pose of the block) by period."""
        found = []
        for k in range(int(action.duration / PERIOD) + 10):
            moment = action.at(k * PERIOD)
            found.append((moment.leg, self.tick(moment.pose, moment.width), self.block))
        return found

    def tick(self, target, width=0.0):
        """Let one period pass."""
        self.pusher.go_to(target)
        self.pusher.open_to(width)
        self.pusher.plan()
        self.world.step(10)
        return self.pusher.read(self.world.time)


@pytest.fixture
def rig():
    """A rig that is closed in the end."""
    made = []

    def make(**options):
        made.append(Rig(**options))
        return made[-1]

    yield make
    for each in made:
        each.world.close()


def push(rig, start, end, speed=0.05, pull=False):
    """Put the tip beside the block and push."""
    now = np.array([*start, HEIGHT, 0.0])
    config = StraightConfig(height=HEIGHT, clearance=HEIGHT, hold=0.2, grip_time=0.7)
    action = straight_action(
        now, np.array(start), np.array(end), Travel(speed, config.acceleration), config, pull=pull
    )
    rig.pusher.place(now, action.legs[0].width)
    return rig.perform(action)


def test_a_block_that_slides_steadily_resists_with_friction_times_weight(rig):
    told = push(rig(), (0.43, 0.0), (0.48, 0.0))
    steady = [tip.force for leg, (tip, *_), _ in told if leg == "push"][40:90]
    assert_allclose(np.mean(steady, axis=0), [FRICTION * WEIGHT, 0.0, 0.0], atol=0.01)


@pytest.mark.parametrize(("angle_deg", "slides"), [(8.0, False), (60.0, True)])
def test_the_tip_sticks_within_its_cone_and_slips_at_its_edge(rig, angle_deg, slides):
    way = 0.04 * np.array([np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))])
    start = np.array([0.433, 0.0])
    made = rig(friction=0.35)
    told = push(made, start, start + way)
    forces, points = [], []
    for leg, (tip, *_), pose in told:
        if leg == "push" and tip.in_contact:
            across = np.array([-tip.normal[1], tip.normal[0], 0.0])
            forces.append((tip.force @ across) / (tip.force @ tip.normal))
            points.append((pose[:3, :3].T @ (tip.point - pose[:3, 3]))[1])
    ratio, slid = np.array(forces[40:]), abs(points[-1] - points[40])
    if slides:
        assert_allclose(np.abs(ratio[:40]), 0.35, atol=0.01)
        assert slid > 3e-3
    else:
        assert np.abs(ratio).max() < 0.34
        assert slid < 2e-3  # it rolls on the face by its radius times the turn


def test_a_block_that_is_leaned_on_does_not_creep(rig):
    made = rig(stiffness=1e4)
    target = np.eye(4)
    lean = 0.5 * FRICTION * WEIGHT / 1e4
    target[:3, 3] = [0.5 - 0.5 * LENGTH - 0.006 + lean, 0.0, HEIGHT]
    made.pusher.place(np.array([*target[:3, 3], 0.0]))
    for _ in range(30):
        read = made.tick(target)
    before = made.block
    for _ in range(300):
        read = made.tick(target)
    assert read[0].force[0] == pytest.approx(0.5 * FRICTION * WEIGHT, rel=0.2)
    assert_allclose(made.block, before, atol=2e-7)


def test_two_pads_grip_a_block_and_pull_it(rig):
    made = rig()
    told = push(made, (0.5, 0.004), (0.53, 0.004), pull=True)
    steady = [sum(pad.force for pad in pads) for leg, (_, *pads), _ in told if leg == "pull"]
    assert_allclose(np.mean(steady[30:60], axis=0), [FRICTION * WEIGHT, 0.0, 0.0], atol=0.03)
    squeeze = [pads[0].force[1] for leg, (_, *pads), _ in told if leg == "pull"][40]
    assert -17.0 < squeeze < -11.5
    assert made.block[0, 3] == pytest.approx(0.53, abs=1e-3)
    assert not told[-1][1][1].in_contact  # it let go


@pytest.mark.parametrize(("depth", "why"), [(0.003, "15 N"), (0.03, "came down on an object")])
def test_an_arm_that_is_stopped_stays_until_it_is_sent_up(rig, depth, why):
    made = rig(most_force=15.0)
    x = 0.5 - 0.5 * LENGTH - 0.006 + depth
    target = np.eye(4)
    target[:3, 3] = [x, 0.0, HEIGHT]
    made.pusher.place(np.array([x, 0.0, HEIGHT, 0.0]))
    for _ in range(3):
        made.tick(target)
    assert why in made.pusher.fault
    assert np.linalg.norm(made.block[:2, 3] - [0.5, 0.0]) < 0.01
    target[0, 3] = 0.6
    made.tick(target)
    assert made.pusher.fault
    target[[0, 2], 3] = x, 0.2
    for _ in range(50):
        made.tick(target)
        assert not made.pusher.fault
    assert made.pusher.frame[2] > 0.19


def test_a_target_out_of_reach_is_not_followed(rig):
    made = rig()
    far = np.eye(4)
    far[:3, 3] = [1.5, 0.0, 0.3]
    for _ in range(400):
        made.tick(far)
        if made.pusher.fault:
            break
    assert "reach" in made.pusher.fault
    assert made.pusher.frame[0] < 0.9


def test_pushes_become_streams_and_a_recording_of_a_pushed_object(tmp_path):
    told = simulate_pushes(
        SimulatedTableConfig(object_number=85, seed=3), PushOptions(count=1, speed=(0.15, 0.15))
    )
    assert not told.faults
    links, joint = told.truth["links"], told.truth["joint"]
    for link in links:
        force = link["mass"] * link["friction"] * GRAVITY
        assert link["friction_force_n"] == pytest.approx(force)
    first, second = (stream.pose[:, :2] for stream in told.streams.links)
    arm = np.linalg.norm(second - first, axis=1)
    assert np.linalg.norm(joint["position"]) < arm.min()  # between the middles of the parts
    assert joint["friction_torque_nm"] > 0.0
    bag = told.streams
    path = PushedRecording(bag, "simulated").to_bag(tmp_path / "bag")
    assert recorded_model(path) == "pushed"
    again = PushedRecording.from_bag(path)
    assert again.problems == {}
    assert len(again.streams.links) == 2
    offset = bag.links[0].time[0]
    assert_allclose(again.streams.links[1].pose, bag.links[1].pose, atol=1e-9)
    assert_allclose(again.streams.contacts["pusher"].time, bag.contacts["pusher"].time - offset)
    assert_allclose(again.streams.contacts["pusher"].force, bag.contacts["pusher"].force)


def even_face(corners, count=24):
    """Return points (K, 2) that fill a convex outline."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes = [np.linspace(a, b, 2 * count + 1)[1::2] for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    edge = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    return points[np.all(edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0] > 0.0, axis=1)]


def balance(streams, link, k):
    """Return force measured and force that an even face with tipping pressure needs, (2,) N each.

    Args:
        streams: without noise.
        link: truth of its only link.
        k: number of a pose; the force is the mean between it and the one before.
    """
    pose, push, step = streams.links[0].pose, streams.contacts["pusher"], 0.01
    n = int(np.abs(push.time - streams.links[0].time[k] + 0.0045).argmin())
    x, y, yaw = 0.5 * (pose[k] + pose[k - 1])
    rate = (pose[k] - pose[k - 1]) / step
    change = (pose[k + 1] - pose[k] - pose[k - 1] + pose[k - 2]) / (2.0 * step**2)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    feet, com = even_face(streams.links[0].footprint) @ turn.T, turn @ link["com"]
    velocity = rate[:2] + rate[2] * np.column_stack([-feet[:, 1], feet[:, 0]])
    acceleration = change[:2] + change[2] * np.array([-com[1], com[0]]) - rate[2] ** 2 * com
    weight, inert = link["mass"] * GRAVITY, link["mass"] * acceleration
    tipping = weight * com - link["com_height"] * inert + push.point[n, 2] * push.force[n, :2]
    columns = np.column_stack([np.ones(len(feet)), feet])
    pressure = columns @ np.linalg.solve(columns.T @ columns, np.array([weight, *tipping]))
    slip = velocity / np.linalg.norm(velocity, axis=1)[:, None]
    return push.force[n, :2], inert + link["friction"] * pressure @ slip


def test_turning_pushes_balance_an_even_face_under_tipping_pressure():
    told = simulate_pushes(
        SimulatedTableConfig(object_number=129, seed=129, friction_spread=0.0, noise=False),
        PushOptions(count=1),
    )
    (link,), streams = told.truth["links"], told.streams
    pose, times = streams.links[0].pose, streams.contacts["pusher"].time
    sliding = np.abs(np.diff(pose, axis=0))[:, :2].max(axis=1) > 2e-4
    touched = (streams.links[0].time > times[0] + 0.1) & (streams.links[0].time < times[-1])
    ks = [k for k in range(2, len(pose) - 1) if sliding[k - 2 : k + 1].all() and touched[k]]
    assert len(ks) > 20
    pairs = [balance(streams, link, k) for k in ks]
    gaps = [np.linalg.norm(measured - needed) for measured, needed in pairs]
    assert np.median(gaps) < 0.01 * link["friction_force_n"]
    assert abs(pose[-1, 2] - pose[0, 2]) > 0.1  # it turned
