"""Friction in the simulator, surfaces that give way, and how detectors of slip are scored."""

from dataclasses import replace

import numpy as np
import pybullet
import pytest

from benchmarks.friction.accuracy import GRASP_STD, calibrate, summarise_study
from benchmarks.friction.detection import score_detectors, split_attempts
from benchmarks.friction.probe_trial import _Chain, run_probe_trial
from benchmarks.friction.subjects import REFERENCES, SUBJECTS, draw_friction
from benchmarks.friction.trials import Case, build_trial
from tactile_dynamics_ros.cli.probe import finger_gain
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.sim.skin_friction import SkinFriction, SurfaceFriction
from tactile_dynamics_ros.sim.warping import PANEL_INERTIA
from tactile_dynamics_ros.sim.world import HandWorld, WorldConfig

ROBOT = load_robot()

ACROSS = np.array([1.0, 0.0, 0.0])


def test_friction_is_static_at_rest_and_kinetic_when_fast():
    surface = SurfaceFriction(0.8, 0.6)
    assert surface.coefficient(1.0, 0.0, ACROSS) == pytest.approx(0.8)
    assert surface.coefficient(1.0, 0.02, ACROSS) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("changes", "press", "speed", "pull", "ratio"),
    [
        ({"adhesion": 0.2}, 0.5, 0.0, ACROSS, 1.4),
        ({"load_exponent": -1 / 3}, 8.0, 0.0, ACROSS, 0.5),
        ({"weakening": 0.3}, 1.0, 0.02, ACROSS, 0.75 * 0.7),
        ({"anisotropy": 0.1}, 1.0, 0.0, np.array([0.0, 0.0, 1.0]), 1.1),
        ({"anisotropy": 0.1}, 1.0, 0.0, ACROSS, 0.9),
    ],
)
def test_odd_frictions_by_their_closed_forms(changes, press, speed, pull, ratio):
    surface = SurfaceFriction(0.8, 0.6, **changes)
    assert surface.coefficient(press, speed, pull) == pytest.approx(0.8 * ratio, rel=1e-3)


def test_regions_have_their_own_friction():
    config = WorldConfig(object_name=SUBJECTS[3].path)
    regions = SUBJECTS[4].regions()
    surfaces = {"body": SurfaceFriction(0.8, 0.7), "label": SurfaceFriction(0.5, 0.4)}
    with HandWorld(config) as world:
        friction = SkinFriction(world, regions, surfaces)
        assert friction.region(np.array([0.03, 0.0, 0.0])) == "label"
        assert friction.region(np.array([0.03, 0.0, 0.1])) == "body"


@pytest.mark.timeout(240)
def test_an_object_in_the_air_is_probed_without_being_rocked():
    """Were the measured force fed to the holding fingers, the brick would swing by 10 degrees."""
    duplo = next(subject for subject in SUBJECTS if subject.name == "lego duplo")
    trial = build_trial(Case(duplo, 301, in_air=True))
    trial = replace(trial, probe=replace(trial.probe, most_slips=8))
    result = run_probe_trial(trial)
    assert result.outcome == "" and not result.dropped
    found, truth = result.estimates[duplo.region], trial.surfaces[duplo.region].static
    assert found.interval[0] < truth < found.interval[1]
    assert found.static == pytest.approx(truth, rel=0.1)


def test_a_face_that_gives_way_swings_as_its_spring_says():
    config = WorldConfig(object_name=SUBJECTS[5].path, warp_stiffness=0.3)
    with HandWorld(config) as world:
        world.reset(ROBOT.start)
        body, client = world.object_id, world.client
        friction = {pybullet.getDynamicsInfo(body, k, client)[1] for k in (-1, 0, 1)}
        assert len(friction) == 1
        pybullet.resetJointState(body, 0, 0.1, 0.0, client)
        angles = []
        for _ in range(300):
            world.step()
            angles.append(pybullet.getJointState(body, 0, client)[0])
        crossings = np.flatnonzero(np.diff(np.sign(angles)))
        half_period = 1e-3 * float(np.diff(crossings)[0])
        assert half_period == pytest.approx(np.pi * np.sqrt(PANEL_INERTIA / 0.3), rel=0.15)
        assert abs(angles[-1]) < 0.01
        assert world.object_pose()[2, 3] == pytest.approx(world.start_pose()[2, 3], abs=2e-3)


def test_friction_is_drawn_within_what_is_known_of_silicone():
    rng = np.random.default_rng(0)
    for subject in (*SUBJECTS, *REFERENCES):
        for surface in draw_friction(subject, rng).values():
            assert 0.35 <= surface.static <= 1.2
            assert 0.74 <= surface.kinetic / surface.static <= 0.96


def test_a_hands_gain_is_that_of_the_blocks_as_wide_as_what_is_held():
    def row(block, static):
        estimate = {"static": static, "repeatable": 0.005}
        truth = {"hand": 5, "trial": 0, "true_static": 0.8}
        return truth | {"subject": block, "estimate": estimate}

    read = {"block 42 mm": 0.79, "block 60 mm": 0.80, "block 80 mm": 0.81}
    blocks = [row(block, static) for block, static in read.items()]
    widths = (0.042, 0.051, 0.06, 0.08)
    narrow, between, middle, wide = (calibrate(blocks, w, exactly=True)[0] for w in widths)
    assert middle == pytest.approx(0.8 / 0.80, rel=0.003)
    assert 1.01 < narrow / wide < 0.81 / 0.79
    assert narrow > between > middle > wide
    one, unsure = calibrate(blocks[:1], 0.08, exactly=True)
    assert one > wide
    _, sure = calibrate(blocks, 0.042, exactly=True)
    assert calibrate(2 * blocks, 0.042, exactly=True)[1] < sure < unsure < 0.03
    nothing = {"hand": 5, "subject": "block 60 mm", "outcome": "nothing held"}
    assert calibrate([nothing], 0.06) == (1.0, 0.1)


def test_the_error_of_the_slope_method_is_stated_and_shrinks_to_what_is_common():
    def errors(blocks):
        rows = [
            {"subject": "block 60 mm", "trial": trial, "true_static": 0.8}
            | {"estimate": {"static": 0.8, "repeatable": 1e-4}}
            for trial in range(blocks)
        ]
        found = [calibrate([row | {"hand": h} for row in rows], 0.06) for h in range(400)]
        said = np.sqrt(found[0][1] ** 2 - GRASP_STD**2)
        return float(np.std([gain for gain, _ in found])), float(said)

    (one, said_one), (many, said_many) = errors(1), errors(60)
    assert many < 0.6 * one < 0.6 * said_one
    assert many == pytest.approx(said_many, rel=0.15)


def slip_row(onset=1.0, seen=1.05, rng=None):
    """Time series of one attempt whose fingertip slips at ``onset`` and shakes from ``seen``."""
    rng = rng or np.random.default_rng(1)
    time = np.arange(0.0, 1.5, 0.01)
    slides = time >= onset
    shows = time >= seen
    return {
        "events": [],
        "slip": {
            "time": time.tolist(),
            "speed": (0.005 * slides).tolist(),
            "vibration": (1.0 + 4.0 * shows).tolist(),
            "electrodes": (2.0 * shows + 0.1 * rng.standard_normal(len(time))).tolist(),
            "path": (0.005 * np.maximum(time - onset, 0.0)).tolist(),
            "measured": np.column_stack([np.ones_like(time), 0.6 - 0.2 * shows, 0 * time]).tolist(),
            "phase": ["press"] * 3 + ["unload"] * (len(time) - 6) + ["press"] * 3,
        },
    }


def test_detectors_are_told_only_of_slips_before_the_attempt():
    past, later = ({"tangential": t, "normal": 1.0, "time": at} for t, at in ((0.7, -1.0), (9, 2)))
    (attempt,) = split_attempts(slip_row() | {"events": [past, later]})
    assert attempt.expected == pytest.approx(0.7)
    (first,) = split_attempts(slip_row() | {"events": [later]})
    assert first.expected is None


def test_a_probe_uses_the_calibration_of_its_fingertips():
    tips = [FingertipConfig(gain=(1.0 + 0.1 * k,)) for k in range(4)]
    chain = _Chain(build_trial(Case(SUBJECTS[0], 301), tips))
    chain.robot.world.close()
    assert chain._tips.config == tips


def test_detectors_are_scored_by_delay_and_false_alarms():
    scores = score_detectors([slip_row(), slip_row(onset=0.9, seen=0.95)])
    for found in scores.values():
        assert found["slips"] == 2
        assert found["missed_share"] == 0.0
        assert 0.0 <= found["median_delay_s"] <= 0.1
    assert scores["vibration_only"]["false_alarms_per_minute"] == 0.0
    early = score_detectors([slip_row(onset=1.2, seen=0.5)])["vibration_only"]
    assert early["false_alarms_per_minute"] > 10.0


def test_the_study_is_summarised_with_what_went_wrong():
    estimate = {"static": 0.7, "interval": [0.66, 0.74], "kinetic": 0.6, "normal_moves": False}
    row = {"subject": "mustard", "hand": 1, "estimate": estimate, "true_static": 0.71}
    row |= {"true_kinetic": 0.61, "gain": 1.0, "exact_gain": 1.02}
    row |= {"strongest": 2.0, "duration": 15.0}
    lost = {"subject": "bleach", "dropped": True, "strongest": 9.0, "gain": 1.0}
    found = summarise_study([row, lost])
    assert found["median_abs_error"] == pytest.approx(0.01)
    assert found["median_abs_error_blocks_known_exactly"] == pytest.approx(0.004)
    assert found["interval_coverage"] == 1.0
    assert (found["drops"], found["force_limit_violations"]) == (1, 1)


def test_gain_of_a_finger_comes_from_the_region_with_most_slips():
    regions = {
        "body": {"static": 0.72, "std": 0.02, "slips": 9},
        "label": {"static": 0.4, "std": 0.1, "slips": 2},
    }
    gain = finger_gain(regions, 0.78)
    assert gain["value"] == pytest.approx(0.78 / 0.72)
    assert gain["std"] == pytest.approx(gain["value"] * 0.02 / 0.72)
