"""An arm that weighs what it carries: its links, their clearance, the motion, and what it tells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.weighing.arm import Plane, SerialArm, nearest
from tactile_dynamics_ros.core.weighing.excitation import WeighingConfig, plan_weighing

pybullet = pytest.importorskip("pybullet")
QUICK = {"evaluations": 60}
LINKS = """<robot name="two">
<link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<link name="upper"><collision><origin xyz="0.25 0 0"/><geometry><box size="0.5 0.05 0.05"/>
</geometry></collision></link>
<link name="fore"><collision><origin xyz="0.35 0 0"/><geometry>
<cylinder radius="0.03" length="0.06"/></geometry></collision></link>
<link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.3"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="end" type="fixed"><parent link="fore"/><child link="tip"/>
<origin xyz="0.3 0 0"/></joint>
</robot>"""


def two_links(urdf=LINKS):
    return SerialArm.of_urdf(urdf, "base", "tip")


@pytest.fixture(scope="module")
def simulated():
    from tactile_dynamics_ros.sim.carrying_arm import CarryingArm, CarryingArmConfig

    with CarryingArm(CarryingArmConfig(seed=21)) as arm:
        yield arm


@pytest.fixture(scope="module")
def iiwa(simulated):
    return SerialArm.of_urdf(simulated.urdf, "lbr_iiwa_link_0", "wrist_sensor")


def test_the_tip_is_where_bullet_has_it(simulated, iiwa):
    rng = np.random.default_rng(3)
    body, link = simulated._body, simulated._links["wrist_sensor"]
    positions = rng.uniform(-1.5, 1.5, (5, 7))
    for row, pose in zip(positions, iiwa.tip_poses(positions), strict=True):
        for joint, value in zip(simulated._joints, row, strict=True):
            pybullet.resetJointState(body, joint, value, physicsClientId=simulated.client)
        found = pybullet.getLinkState(body, link, 0, 1, physicsClientId=simulated.client)
        np.testing.assert_allclose(pose[:3, 3], found[4], atol=1e-6)
        turn = np.reshape(pybullet.getMatrixFromQuaternion(found[5]), (3, 3))
        np.testing.assert_allclose(pose[:3, :3], turn, atol=1e-6)


def test_links_that_meet_have_no_room_and_links_apart_have_some():
    arm = two_links()
    start = np.array([-0.5, 0.5])
    apart = nearest(arm, (), np.array([[-0.5, 0.4]]), start, 0.02)
    folded = nearest(arm, (), np.array([[0.6, 2.4]]), start, 0.02)
    assert apart.room > 0.1
    assert folded.room < 0.0 and folded.what == "base and fore"


def test_a_plane_is_kept_to():
    arm, floor = two_links(), Plane(np.array([0.0, 0.0, 1.0]), 0.0)
    low = nearest(arm, (floor,), np.array([[0.9, 0.0]]), np.array([-0.5, 0.0]), 0.02)
    assert low.room < 0.0 and "plane" in low.what


def test_a_motion_starts_and_ends_at_rest_within_all_limits(iiwa):
    config = WeighingConfig(seed=5, **QUICK)
    start = np.array([0.0, 0.5, 0.0, -1.4, 0.0, 0.9, 0.0])
    motion = plan_weighing(iiwa, start, config)
    time, positions, velocities = motion.table(100.0)
    np.testing.assert_allclose(positions[[0, -1]], [start, start], atol=1e-12)
    slopes = np.gradient(positions, time, axis=0)
    np.testing.assert_allclose(slopes[1:-1], velocities[1:-1], atol=2e-2)
    assert np.abs(positions - start).max() <= config.amplitude + 1e-9
    assert np.all(np.abs(velocities) <= 1.02 * config.speed_share * iiwa.limits("velocity"))
    place = iiwa.tip_poses(positions)[:, :3, 3]
    speed = np.linalg.norm(np.diff(place, axis=0), axis=1) * 100.0
    assert speed.max() < 1.05 * config.tip_speed
    loaded = iiwa.carrying(config.reach, config.radius)
    assert nearest(loaded, config.plane_list(), positions[::5], start, config.margin).room > -1e-3


def test_a_motion_tells_more_than_a_random_one_of_the_same_size(iiwa):
    start = np.array([0.0, 0.5, 0.0, -1.4, 0.0, 0.9, 0.0])
    searched = plan_weighing(iiwa, start, WeighingConfig(seed=5, evaluations=150))
    first = plan_weighing(iiwa, start, WeighingConfig(seed=5, evaluations=8))
    assert np.all(searched.expected[4:] < first.expected[4:])


def test_an_arm_in_a_corner_says_what_is_in_its_way(iiwa):
    start = np.array([0.0, 0.5, 0.0, -1.4, 0.0, 0.9, 0.0])
    height = float(iiwa.tip_poses(start[None])[0, 2, 3])
    table = WeighingConfig(planes=(0.0, 0.0, 1.0, height - 0.17), margin=0.1, **QUICK)
    with pytest.raises(NotIdentifiableError, match=r"plane .*come too near"):
        plan_weighing(iiwa, start, table)


def test_a_link_whose_mesh_is_missing_is_named(iiwa):
    text = LINKS.replace('<cylinder radius="0.03" length="0.06"/>', '<mesh filename="gone.stl"/>')
    arm, start = two_links(text), np.array([-0.5, 0.5])
    with pytest.raises(BadInputError, match=r"fore \(gone.stl\)"):
        plan_weighing(arm, start, WeighingConfig(**QUICK))
    plan_weighing(arm, start, WeighingConfig(ignored_links=("fore",), reach=0.0, **QUICK))


@pytest.mark.parametrize("planes", [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)])
def test_planes_are_four_numbers_each_with_a_normal(planes):
    with pytest.raises(BadInputError, match="four for each plane"):
        WeighingConfig(planes=planes)


def carried_by(arm, attached):
    """Return mass and first moment of what hangs on the simulated sensor."""
    bodies = [arm.tool, *([arm.load] if attached else [])]
    return sum(b.mass for b in bodies), sum(b.mass * b.com for b in bodies)


def test_the_simulated_sensor_reads_what_a_rigid_body_does():
    """Independent of the estimator: places of every millisecond, differenced twice."""
    from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
    from tactile_dynamics_ros.sim.carrying_arm import CarryingArm, CarryingArmConfig
    from tactile_dynamics_ros.sim.sensors.fingertips import WristSensorConfig

    silent = {f.name: 0.0 for f in WristSensorConfig.__dataclass_fields__.values()}
    wrist = WristSensorConfig(**silent | {"filter_hz": 1000.0})
    config = CarryingArmConfig(seed=4, encoder_noise=0.0, wrist=wrist)
    step = 1e-3
    with CarryingArm(config, period=step) as arm:
        arm.set_load(True)
        time = np.linspace(0.05, 1.5, 30)
        waves = 0.3 * np.sin(np.outer(time, np.linspace(2.0, 5.0, 7)))
        arm.follow(list(arm.names), time, np.array(arm._target) + waves, np.zeros_like(waves))
        rows = [arm.advance() for _ in range(1200)]
        model = SerialArm.of_urdf(arm.urdf, "lbr_iiwa_link_0", "wrist_sensor")
        mass, moment = carried_by(arm, True)
    pose = model.tip_poses(np.array([row.position for row in rows]))
    turn, place = pose[:, :3, :3], pose[:, :3, 3]
    acceleration = np.diff(place, 2, axis=0) / step**2
    spin = log_so3(np.swapaxes(turn[:-1], 1, 2) @ turn[1:]) / step
    specific = np.einsum("nji,nj->ni", turn[1:-1], acceleration + [0.0, 0.0, 9.81])
    columns = regressor(specific, 0.5 * (spin[1:] + spin[:-1]), np.diff(spin, axis=0) / step)
    force = columns[:, 3:, :4] @ np.array([mass, *moment])
    read = -np.array([row.wrist for row in rows])[1:-1, 3:]
    assert np.sqrt(np.mean((read - force) ** 2)) < 2e-3 * np.sqrt(np.mean(force**2))


def test_the_arm_sags_until_its_controller_knows_the_payload(simulated):
    simulated.set_load(True)
    for _ in range(150):
        simulated.advance()
    unknown = simulated.sag()
    mass, moment = carried_by(simulated, True)
    simulated.set_payload(mass, moment / mass, np.zeros((3, 3)))
    for _ in range(150):
        simulated.advance()
    assert unknown > 1e-3
    assert simulated.sag() < 0.01 * unknown


def test_each_payload_is_the_one_that_the_controller_counts_with(simulated):
    """Bullet keeps inverse dynamics by a body's address, which the next body may get."""
    masses, torques = np.linspace(0.1, 3.0, 40), []
    for mass in masses:
        simulated.set_payload(mass, np.zeros(3), np.zeros((3, 3)))
        torques.append(
            pybullet.calculateInverseDynamics(
                simulated._known, [0.0, 0.5, 0.0, -1.4, 0.0, 0.9, 0.0], [0.0] * 7, [0.0] * 7,
                physicsClientId=simulated._known_client.client,
            )
        )  # fmt: skip
    steps = np.diff(torques, axis=0)
    assert np.abs(steps[0]).max() > 0.1
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-3)


def test_a_trajectory_of_other_joints_is_refused(simulated):
    with pytest.raises(BadInputError, match="expected all of"):
        simulated.follow(["elbow"], np.array([1.0]), np.zeros((1, 1)), np.zeros((1, 1)))


def test_what_is_kept_of_a_motion_is_read_as_the_load(tmp_path, simulated, iiwa):
    """The file that a weighing leaves tells what hung on the sensor."""
    pytest.importorskip("rclpy")
    from tactile_dynamics_ros.core.inertia.estimate import estimate
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.ros.arm_motion import Taken
    from tactile_dynamics_ros.ros.handover import keep

    simulated.set_load(True)
    for _ in range(100):
        row = simulated.advance()
    motion = plan_weighing(iiwa, row.position, WeighingConfig(duration=8.0, seed=2, **QUICK))
    simulated.follow(list(iiwa.names), *motion.table(50.0))
    taken = Taken()
    for _ in range(820):
        row = simulated.advance()
        taken.joint_time.append(row.time)
        taken.wrench_time.append(row.time)
        taken.positions.append(row.position)
        taken.wrenches.append(np.concatenate([row.wrist[3:], row.wrist[:3]]))
    path = keep(taken, iiwa, -1.0, Path(tmp_path) / "load.mcap")
    found = estimate(Recording.from_bag(path)).to_estimate()
    mass, moment = carried_by(simulated, True)
    assert abs(found.inertia.mass - mass) < 4.0 * found.parameter_std[0] + 1e-3
    np.testing.assert_allclose(found.inertia.com, moment / mass, atol=1e-3)
