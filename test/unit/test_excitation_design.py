"""Designed motions: exact kinematics, within every limit, and better than what they replace."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.excitation import (
    ArmLimits,
    DesignConfig,
    FourierOffsets,
    Grip,
    HeldPose,
    InertiaCriterion,
    MotionLimits,
    design_motion,
)
from tactile_dynamics_ros.core.inertia.excitation.plan import plan_excitation
from tactile_dynamics_ros.core.manipulation.excitation import OffsetTable
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.synthetic.recordings import generate, write_bag
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

ROBOT = load_robot()

BODY = InertialParameters(0.5, np.array([0.005, -0.004, 0.01]), np.diag([8e-4, 7e-4, 4e-4]))
PHI = BODY.dynamic_parameters
START = HeldPose(
    exp_so3(np.array([0.3, -0.2, 0.5])), np.array([0.5, 0.0, 0.6]), np.array([0.5, 0.02, 0.58])
)


def grip(force: float = 14.0, friction: float = 0.9) -> Grip:
    point = np.array([[0.03, 0.02, 0.02], [0.03, 0, 0], [0.03, -0.02, -0.02], [-0.03, 0, 0]])
    normal = np.array([[-1.0, 0, 0], [-1, 0, 0], [-1, 0, 0], [1, 0, 0]])
    share = np.array([0.25, 0.5, 0.25, 1.0])[:, None]
    return Grip(
        ("index", "middle", "ring", "thumb"), point, normal, force * share * normal, friction
    )


def random_motion(seed: int = 0, duration: float = 6.0) -> FourierOffsets:
    rng = np.random.default_rng(seed)
    scale = np.repeat([0.2, 0.02], 3)[:, None]
    sine, cosine = scale * rng.normal(size=(6, 3)), scale * rng.normal(size=(6, 3))
    return FourierOffsets(duration, np.array([0.2, 0.5, 1.1]), sine, cosine)


def test_motion_begins_and_ends_at_rest():
    motion = random_motion()
    assert_allclose(motion.evaluate(np.array([0.0, 6.0, 7.0])), 0.0, atol=1e-12)
    followed = START.follow(motion, np.array([0.0, 6.0]))
    assert_allclose(followed.rotation[0], START.rotation, atol=1e-9)
    assert_allclose(followed.velocity, 0.0, atol=1e-5)
    assert_allclose(followed.angular_acceleration, 0.0, atol=0.05)


def test_kinematics_integrate_to_the_pose():
    """Trapezoids of the derivatives give back positions and rotations."""
    time = np.linspace(0.0, 6.0, 6001)
    motion = START.follow(random_motion(), time)
    step = time[1]
    position = np.cumsum(motion.velocity, axis=0) * step
    assert_allclose(
        position[-1] - position[2000], motion.position[-1] - motion.position[2000], atol=2e-4
    )
    velocity = np.cumsum(motion.acceleration, axis=0) * step
    assert_allclose(
        velocity[3000] - velocity[1000], motion.velocity[3000] - motion.velocity[1000], atol=2e-3
    )
    turned = motion.rotation[3000] @ exp_so3(motion.angular_velocity[3000] * step)
    assert_allclose(turned, motion.rotation[3001], atol=2e-5)
    rate = motion.angular_velocity[3001] - motion.angular_velocity[2999]
    assert_allclose(rate / (2 * step), motion.angular_acceleration[3000], atol=1e-3)


def test_grip_forces_apply_the_wrench_that_the_motion_needs():
    samples = grip().load(START.follow(random_motion(), np.linspace(1.0, 5.0, 50)), PHI)
    total = samples.contact_force.sum(axis=1)
    squeeze = grip().squeeze.sum(axis=0)
    com_acceleration = (
        samples.specific_acceleration
        + np.cross(samples.angular_acceleration, BODY.com)
        + np.cross(samples.angular_velocity, np.cross(samples.angular_velocity, BODY.com))
    )
    assert_allclose(total - squeeze, BODY.mass * com_acceleration, atol=1e-5)


def test_designed_motion_respects_every_limit_and_beats_random_ones():
    kinematics = HandKinematics()
    joints = np.concatenate([ROBOT.carry, ROBOT.hand_seed])
    arm = ArmLimits.of_robot(kinematics, joints, kinematics.locate(joints).palm[:3, 3])
    limits = MotionLimits(rotation=0.4, translation=0.04)
    criterion = InertiaCriterion(PHI, 1e-3 * np.eye(10), 0.03, 5.0)
    config = DesignConfig(duration=6.0, evaluations=80, seed=3)
    designed = design_motion(criterion, START, grip(), PHI, limits, arm, config)
    time = np.arange(0.0, 6.0, 0.05)
    offsets = designed.offsets.evaluate(time)
    assert np.all(np.abs(offsets).max(axis=0) <= limits.amplitude + 1e-9)
    assert designed.grip_usage <= limits.grip_share + 1e-6
    rates = np.gradient(offsets, time, axis=0)
    assert arm.share(offsets, rates, 1.0) >= 1.0
    assert designed.value < 0.6 * designed.reference
    again = design_motion(criterion, START, grip(), PHI, limits, arm, config)
    assert_allclose(again.offsets.coefficients, designed.offsets.coefficients)


def test_any_function_of_the_samples_can_be_minimised():
    """As a diagnosis does that wants to tell two effects apart."""

    def spin(samples):
        return -float(np.sum(samples.angular_velocity[:, 2] ** 2))

    config = DesignConfig(duration=4.0, evaluations=120, seed=1)
    designed = design_motion(spin, START, grip(), PHI, config=config)
    assert designed.value < 1.2 * designed.reference < 0.0


def test_a_grip_that_slips_at_rest_leaves_no_motion():
    with pytest.raises(NotIdentifiableError, match="squeeze harder"):
        design_motion(
            lambda samples: 0.0, START, grip(0.5), PHI, config=DesignConfig(evaluations=8)
        )


def test_criterion_does_not_depend_on_units_of_mass_or_length():
    samples = grip().load(START.follow(random_motion(), np.linspace(0.5, 5.5, 40)), PHI)
    values = []
    for scale in (1.0, 10.0):
        criterion = InertiaCriterion(scale * PHI, np.zeros((10, 10)), 0.03 * scale)
        values.append(criterion(samples))
    assert values[0] == pytest.approx(values[1], rel=1e-6)


def test_frequencies_out_of_order_are_refused():
    with pytest.raises(BadInputError, match="lowest_hz"):
        DesignConfig(lowest_hz=2.0, highest_hz=1.0)


@pytest.fixture(scope="module")
def short_recording():
    return generate(3, scenario=ScenarioOptions(duration=3.0))


def test_plan_from_a_recording_promises_smaller_deviations(short_recording):
    model = fit_recording(short_recording.streams)
    plan = plan_excitation(model, DesignConfig(duration=8.0, evaluations=40))
    assert np.all(plan.std_after < plan.std_before)
    assert plan.expected_after < 0.9 * plan.expected_before


def test_command_writes_the_motion(short_recording, tmp_path, capsys):
    bag = tmp_path / "bag"
    write_bag(short_recording.streams, bag)
    out = tmp_path / "motion.json"
    assert main(["excite", str(bag), "--duration", "5", "--json", "--out", str(out)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["grip_usage"] < 1.1
    table = json.loads(out.read_text())
    assert len(table["time"]) == len(table["offsets"]) == 501
    assert_allclose(table["offsets"][-1], 0.0, atol=1e-6)
    assert main(["excite", str(bag), "--arm", "1,2"]) == 2
    motion = OffsetTable.from_file(out)
    assert motion.duration == pytest.approx(5.0)
    assert_allclose(motion(2.0), table["offsets"][200])


def test_a_file_that_is_no_motion_is_refused(tmp_path):
    path = tmp_path / "motion.json"
    path.write_text('{"time": [0, 1]}')
    with pytest.raises(BadInputError, match="excite --out"):
        OffsetTable.from_file(path)


def test_before_the_first_grasp_a_motion_is_designed_for_the_site(tmp_path, capsys):
    out = tmp_path / "motion.json"
    words = ["excite", "--object", "box_0", "--duration", "4", "--json", "--out", str(out)]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["grip_usage"] < 0.81
    assert document["expected_distance"]["after"] < 1.0 < document["expected_distance"]["before"]
    assert OffsetTable.from_file(out).duration == pytest.approx(4.0)
    assert main(["excite", "--object", "box_0", "--friction", "0.2"]) == 3
    assert main(["excite"]) == 2 and main(["excite", "BAG", "--object", "box_0"]) == 2
