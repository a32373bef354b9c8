"""Every hidden effect of the simulated world does to a free Bullet body what its formula says."""

import subprocess
import sys

import numpy as np
import pybullet
import pytest
from free_body import OMEGA, POSE, STEP, VELOCITY, FreeBody, attached, value, wrench_in_one_step
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.sim.bodies import ObjectBody
from tactile_dynamics_ros.sim.hidden_effects import (
    CATALOGUED,
    OUTSIDE,
    create_hidden_effect,
)
from tactile_dynamics_ros.sim.objects import load_object

TYPICAL = float(np.clip(0.3 * 9.81 * load_object("box_0").inertia.mass, 0.2, 0.6))

PULL = 0.5 * TYPICAL


def at_point(point, force):
    return np.concatenate([np.cross(POSE[:3, :3] @ point, force), force])


def expect_viscous_drag(effect):
    return np.concatenate([np.zeros(3), -value(effect, "c") * VELOCITY])


def expect_quadratic_drag(effect):
    speed = np.sqrt(VELOCITY @ VELOCITY)
    return np.concatenate([np.zeros(3), -value(effect, "c") * speed * VELOCITY])


def expect_rotational_drag(effect):
    return np.concatenate([-value(effect, "c") * OMEGA, np.zeros(3)])


def expect_tether_spring(effect):
    point = value(effect, "point")
    tip = POSE[:3, 3] + POSE[:3, :3] @ point
    return at_point(point, value(effect, "stiffness") * (value(effect, "anchor") - tip))


def expect_hanging_cable(effect):
    return at_point(value(effect, "point"), value(effect, "force"))


def expect_unsensed_contact(effect):
    return at_point(value(effect, "point"), POSE[:3, :3] @ value(effect, "force"))


def expect_spinning_rotor(effect):
    momentum = POSE[:3, :3] @ value(effect, "angular_momentum")
    return np.concatenate([np.cross(momentum, OMEGA), np.zeros(3)])


def expect_magnetic_pull(effect):
    point = value(effect, "point")
    gap = value(effect, "magnet") - POSE[:3, 3] - POSE[:3, :3] @ point
    distance = np.sqrt(gap @ gap + 9e-4)
    return at_point(point, PULL * (0.1 / distance) ** 4 * gap / distance)


def expect_dry_rubbing(effect):
    speed = np.sqrt(VELOCITY @ VELOCITY + 0.005**2)
    return np.concatenate([np.zeros(3), -0.5 * TYPICAL * VELOCITY / speed])


@pytest.mark.parametrize(
    "name",
    [
        "viscous_drag",
        "quadratic_drag",
        "rotational_drag",
        "tether_spring",
        "hanging_cable",
        "unsensed_contact",
        "spinning_rotor",
        "magnetic_pull",
        "dry_rubbing",
    ],
)
def test_force_on_the_body(name):
    effect = create_hidden_effect(name, 1.0, seed=4)
    found = wrench_in_one_step(effect)
    expected = globals()[f"expect_{name}"](effect)
    assert found == pytest.approx(expected, rel=6e-3, abs=6e-4 * np.abs(expected).max() + 1e-9)


def test_motor_vibrates_at_its_frequency():
    frequency = float(value(attached("motor_vibration", seed=4), "frequency"))
    peak, zero = (
        wrench_in_one_step(create_hidden_effect("motor_vibration", 1.0, seed=4), share / frequency)
        for share in (0.25, 0.5)
    )
    assert np.linalg.norm(peak[3:]) == pytest.approx(PULL, rel=1e-3)
    assert np.linalg.norm(zero[3:]) < 1e-3


def test_pull_waits_until_the_object_is_lifted():
    effect = create_hidden_effect("unsensed_contact", 1.0, seed=4)
    sizes = []
    with FreeBody() as body:
        body.table = 5
        body.apply_force = lambda force, point: sizes.append(np.linalg.norm(force))
        effect.attach(body)
        for height in (0.0, 0.005, 0.015, 0.03):
            lifted = POSE.copy()
            lifted[2, 3] += height
            body.body.set_pose(lifted)
            effect.act(body)
    assert sizes == pytest.approx([0.5 * PULL, PULL], rel=1e-3)


def test_stuck_cable_pulls_like_a_spring_and_then_slips():
    effect = create_hidden_effect("cable_stick_slip", 1.0, seed=2)
    with FreeBody() as body:
        effect.attach(body)
        forces = []
        body.apply_force = lambda force, point: forces.append(np.linalg.norm(force))
        for shift in np.arange(0.001, 0.0501, 0.001):
            moved = POSE.copy()
            moved[0, 3] += shift
            body.body.set_pose(moved)
            effect.act(body)
    assert forces[9] == pytest.approx(PULL / 2, rel=1e-6)
    assert max(forces) <= PULL + 1e-9
    assert min(forces[19:22]) == pytest.approx(PULL / 3, rel=1e-6)


def test_taps_are_short_and_rare():
    effect = create_hidden_effect("external_taps", 1.0, seed=3)
    with FreeBody() as body:
        sizes = []
        body.apply_force = lambda force, point: sizes.append(np.linalg.norm(force))
        effect.attach(body)
        body.step(20000)
    assert 0.01 < np.mean(np.array(sizes) > 0) < 0.1
    assert max(sizes) == pytest.approx(3 * PULL, rel=0.02)


def test_sloshing_ball_and_object_swing_at_the_two_body_frequency():
    effect = create_hidden_effect("sloshing_mass", 1.0, seed=1)
    with FreeBody() as body:
        effect.attach(body)
        total = body.model.inertia.mass
        pybullet.resetBaseVelocity(effect.ball, [0.1, 0, 0], [0, 0, 0], body.client)
        gap, momentum = [], []
        for _ in range(3000):
            body.step()
            ball = np.array(pybullet.getBasePositionAndOrientation(effect.ball, body.client)[0])
            com = np.array(pybullet.getBasePositionAndOrientation(body.object_id, body.client)[0])
            gap.append((ball - com)[0])
            ball_speed = pybullet.getBaseVelocity(effect.ball, body.client)[0][0]
            speed = pybullet.getBaseVelocity(body.object_id, body.client)[0][0]
            momentum.append(effect.mass * ball_speed + (total - effect.mass) * speed)
    gap = np.array(gap)
    crossings = np.flatnonzero(np.diff(np.signbit(gap)))
    period = 2 * STEP * np.diff(crossings[:7]).mean()
    stiffer = np.sqrt(total / (total - effect.mass))
    damping = effect.damping_ratio * stiffer
    expected = effect.frequency_hz * stiffer * np.sqrt(1 - damping**2)
    assert 1 / period == pytest.approx(expected, rel=0.01)
    assert np.ptp(momentum) < 1e-4 * abs(momentum[0])


def test_sloshing_object_weighs_as_much_as_before():
    effect = create_hidden_effect("sloshing_mass", 1.0, seed=1)
    with FreeBody(gravity=(0.0, 0.0, -9.81)) as body:
        effect.attach(body)
        weight = body.model.inertia.mass * 9.81
        com = POSE[:3, 3] + POSE[:3, :3] @ body.model.inertia.com
        body.add_pre_step(lambda b: b.apply_force([0, 0, weight], com))
        body.step(50)
        speed = np.array(pybullet.getBaseVelocity(body.object_id, body.client)[0])
    assert np.linalg.norm(speed) < 1e-3


def test_added_mass_falls_slower():
    effect = create_hidden_effect("added_mass", 1.0, seed=1)
    with FreeBody(gravity=(0.0, 0.0, -9.81)) as body:
        effect.attach(body)
        body.step(100)
        speed = pybullet.getBaseVelocity(body.object_id, body.client)[0][2]
    assert speed == pytest.approx(-0.981 / 2.0, rel=1e-3)


def test_changing_mass_answers_a_push_with_its_mass_of_the_moment():
    effect = create_hidden_effect("mass_change", 5.0, seed=1)
    with FreeBody() as body:
        effect.attach(body)
        mass, rate = body.model.inertia.mass, float(value(effect, "rate"))
        body.step(4000)
        com, _ = pybullet.getBasePositionAndOrientation(body.object_id, body.client)
        body.add_pre_step(lambda b: b.apply_force([0.0, 1.0, 0.0], com))
        body.step()
        speed = pybullet.getBaseVelocity(body.object_id, body.client)[0][1]
    assert abs(rate) == pytest.approx(0.05 * mass)
    assert STEP / speed == pytest.approx(mass + 4.0 * rate, rel=1e-3)


def test_tilted_gravity_falls_aside():
    effect = create_hidden_effect("gravity_tilt", 1.0, seed=1)
    with FreeBody(gravity=(0.0, 0.0, -9.81)) as body:
        effect.attach(body)
        body.step(10)
        fall = np.array(pybullet.getBaseVelocity(body.object_id, body.client)[0])
    fall /= np.linalg.norm(fall)
    assert np.degrees(np.arccos(-fall[2])) == pytest.approx(5.0, rel=1e-3)
    tilt = np.array([*value(effect, "tilt"), 0.0])
    assert fall == pytest.approx(Rotation.from_rotvec(tilt).apply([0.0, 0.0, -1.0]), abs=1e-6)


def test_torsion_brakes_a_spinning_object_on_a_skin(tmp_path):
    effect = create_hidden_effect("contact_torsion", 1.0, seed=1)
    floor = tmp_path / "skin.urdf"
    floor.write_text(
        '<robot name="r"><link name="base"><inertial><mass value="1"/><inertia ixx="1" ixy="0" '
        'ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><link name="biotac_index"><inertial>'
        '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        '<collision><origin xyz="0 0 -0.1"/><geometry><box size="1 1 0.2"/></geometry></collision>'
        '</link><joint name="j" type="fixed"><parent link="base"/><child link="biotac_index"/>'
        "</joint></robot>"
    )
    spins = []
    for attach in (False, True):
        with FreeBody(gravity=(0.0, 0.0, -9.81)) as body:
            body.robot = pybullet.loadURDF(
                str(floor), useFixedBase=True, physicsClientId=body.client
            )
            ball = pybullet.createCollisionShape(
                pybullet.GEOM_SPHERE, radius=0.05, physicsClientId=body.client
            )
            top = pybullet.createMultiBody(
                1.0, ball, basePosition=[0, 0, 0.0499], physicsClientId=body.client
            )
            options = {"rollingFriction": 0.0, "angularDamping": 0.0, "linearDamping": 0.0}
            options |= {"lateralFriction": body.model.friction, "localInertiaDiagonal": [1e-3] * 3}
            pybullet.changeDynamics(top, -1, physicsClientId=body.client, **options)
            pybullet.changeDynamics(body.robot, 0, lateralFriction=1.0, physicsClientId=body.client)
            body.body = ObjectBody(body.client, top, np.eye(4))
            if attach:
                effect.attach(body)
            body.step(50)
            pybullet.resetBaseVelocity(top, [0, 0, 0], [0, 0, 5.0], body.client)
            body.step(100)
            spins.append(pybullet.getBaseVelocity(top, body.client)[1][2])
    assert spins[0] == pytest.approx(5.0, abs=1e-3)
    assert spins[0] - spins[1] == pytest.approx(0.002 * 9.81 / 1e-3 * 0.1, rel=0.03)


def test_registry_covers_the_catalogue_and_more():
    assert len(CATALOGUED) == 19
    assert len(OUTSIDE) >= 6
    assert create_hidden_effect("none").describe()["name"] == "none"
    chosen = {create_hidden_effect("random", 1.0, seed).name for seed in range(200)}
    assert chosen == set(CATALOGUED)
    assert (
        create_hidden_effect("random", 1.0, 7).name == create_hidden_effect("random", 1.0, 7).name
    )
    assert create_hidden_effect("outside", 1.0, 7).name in OUTSIDE


def test_unknown_names_and_sizes_are_refused():
    with pytest.raises(BadInputError, match="viscous_drag"):
        create_hidden_effect("syrup")
    with pytest.raises(BadInputError, match="zero or more"):
        create_hidden_effect("viscous_drag", float("nan"))


def test_hidden_effects_never_load_the_catalogue():
    code = (
        "import sys, tactile_dynamics_ros.sim.hidden_effects, tactile_dynamics_ros.synthetic; "
        "print([m for m in sys.modules if 'core.effects' in m or 'core.discrepancy' in m])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
