"""What only some motions of an arm tell: regimes, groups, and the motions that part groups."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.arm import Arm
from tactile_dynamics_ros.core.joints.estimate import fit
from tactile_dynamics_ros.core.joints.excitation import JointLimits, _Design
from tactile_dynamics_ros.core.joints.live import KnownArm
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.core.weighing.arm import SerialArm
from tactile_dynamics_ros.synthetic.joints import JointOptions, generate

ROBOT = load_robot("allegro_iiwa")
IIWA = ROBOT.urdf
REST = np.array([0.2, 0.6, -0.3, -1.2, 0.4, 0.8, 0.1])


def small(seed, joints, size, seconds):
    """Position, speed and acceleration of some joints that hardly move, at 500 Hz."""
    random, time = np.random.default_rng(seed), np.arange(round(500 * seconds)) / 500
    path = np.zeros((3, len(time), 7))
    path[0] = REST
    rate = 2.0 * np.pi * np.array([0.1, 0.23, 0.4])
    for j in joints:
        phase, part = random.uniform(0.0, 2.0 * np.pi, 3), size * random.uniform(0.4, 1.0, 3)
        wave = np.outer(time, rate) + phase
        path[0, :, j] += np.sin(wave) @ part
        path[1, :, j] = np.cos(wave) @ (part * rate)
        path[2, :, j] = -np.sin(wave) @ (part * rate**2)
    return path


def path_of(trajectory, seconds):
    """The same of the points of a JointTrajectory."""
    stamps = [p["time_from_start"] for p in trajectory["points"]]
    time = [one["sec"] + 1e-9 * one["nanosec"] for one in stamps]
    curve = CubicSpline(time, [p["positions"] for p in trajectory["points"]])
    at = np.arange(round(500 * seconds)) / 500
    return np.stack([curve(at), curve(at, 1), curve(at, 2)])


def test_the_proposed_motion_leaves_one_name_of_a_group():
    hidden = {"base_tilt": 0.5}
    poor = JointOptions(duration=15.0, path=small(1, (1, 3, 5), 0.05, 15.0))
    first = generate(IIWA, 1, hidden, poor).streams
    found = diagnose(fit(first))
    assert set(found.group) == {"link_cable", "base_tilt"}
    plan = found.separating_motion
    assert plan is not None and len(plan["separates_from"]) == 1
    json.dumps(plan)
    arm = Arm.from_urdf(IIWA, first.names, "test")
    path = path_of(plan["trajectory"], plan["duration_s"])
    lower, upper = (np.array([getattr(j, end) for j in arm.joints]) for end in ("lower", "upper"))
    assert np.all(path[0] >= lower) and np.all(path[0] <= upper)
    more = generate(IIWA, 1, hidden, JointOptions(duration=plan["duration_s"], path=path)).streams
    both = diagnose(fit(JointStreams.join([first, more])))
    assert (both.effect, both.group) == ("base_tilt", ())


@pytest.fixture(scope="module")
def half_cable():
    """A cable that pulls only while the first joint is turned one way, and where that is."""
    options = JointOptions(duration=20.0)
    bare = generate(IIWA, 9410, {}, options).streams
    pulled = generate(IIWA, 9410, {"link_cable": 1.0}, options).streams
    border = float(np.quantile(bare.position[:, 0], 0.6))
    inside = bare.position[:, :1] > border
    return replace(bare, effort=np.where(inside, pulled.effort, bare.effort)), border


def test_an_effect_that_acts_only_at_places_of_a_joint_is_named_with_them(half_cable):
    streams, border = half_cable
    found = diagnose(fit(streams))
    assert found.effect.startswith("link_cable[position_lbr_iiwa_joint_1>")
    assert abs(found.regime.gate.low - border) < max(4.0 * found.regime.std, 0.05)
    assert found.after.rms < 1.1 * found.floor


def test_a_regime_by_name_is_estimated_kept_and_read_again(half_cable):
    streams, border = half_cable
    label = f"link_cable[position_lbr_iiwa_joint_1>{border:.4f}]"
    model = fit(streams, [label])
    assert model.effects[0].name == label
    known = model.known
    again = KnownArm.from_document(json.loads(json.dumps(known.to_document())), "test")
    np.testing.assert_allclose(again.predict(model.samples), known.predict(model.samples))
    plain = replace(known, effects=())
    acts = np.any(np.abs(known.predict(model.samples) - plain.predict(model.samples)) > 0.0, axis=1)
    np.testing.assert_array_equal(acts, model.samples.middle[0][:, 0] > float(f"{border:.4f}"))
    timed = fit(streams, ["link_cable[t>5]"]).known
    assert timed.left_out == ("link_cable[t>5]",), "a live model has no beginning"
    for wrong, match in (("torque_delay[t>5]", "acts everywhere"), ("link_cable[z>1]", "unknown")):
        with pytest.raises(BadInputError, match=match):
            fit(streams, [wrong])


def test_links_are_kept_apart_by_their_shapes():
    names = [f"lbr_iiwa_joint_{k}" for k in range(1, 8)]
    arm = Arm.from_urdf(IIWA, names, "test")
    shape = SerialArm.of_urdf(IIWA, "", arm.flange, str(ROBOT.folder), drawn=True)
    design = _Design(arm, JointLimits(), None, shape)
    assert design.shape is not None
    upright, folded = np.zeros((1, 7)), np.array([[0.0, 0.0, 0.0, 2.05, 0.0, 2.0, 0.0]])
    assert design.too_near(upright) == 0.0
    assert design.too_near(folded) > 0.02
    hidden = replace(shape, unknown=("a link (gone.stl)",))
    blind = _Design(arm, JointLimits(), None, hidden)
    assert blind.shape is None and blind.too_near(folded) == 0.0, "distances of joints instead"
