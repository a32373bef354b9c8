"""Forces on another clock: large offsets are named, small ones may look like a lag."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.support.slow import with_pauses
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import GRAVITY, Scenario, ScenarioOptions


def diagnose_late(seed, magnitude):
    """Diagnose 12 s of forces that are late by 10 ms times the magnitude; return the truth too."""
    recording = generate(seed, {"time_offset": magnitude}, ScenarioOptions(duration=12.0))
    fitted = fit_with_readings(recording.streams, ())
    truth = recording.truth()["effects"]["time_offset"]
    return diagnose(HeldObjectModel.from_fit(fitted)), truth["parameters"]["offset"]["value"], truth


@pytest.mark.parametrize(("seed", "late"), [(320, "sensor"), (322, "forces")])
def test_an_offset_of_many_samples_is_named_and_leaves_noise(seed, late):
    diagnosis, offset, truth = diagnose_late(seed, 6.4)
    assert truth["reading"] == late
    assert diagnosis.effect == "time_offset"
    assert diagnosis.remaining < 1.05
    model = diagnosis.explained_model
    found = model.parameters()["time_offset"]["offset"]["value"]
    assert found == pytest.approx(offset, rel=0.05)
    assert np.sqrt(np.mean(model.residual**2)) < 1.05


def test_a_small_delay_is_named_or_grouped_with_a_lag():
    diagnosis, offset, truth = diagnose_late(327, 0.7)
    assert truth["reading"] == "forces"
    assert offset > 0.0
    assert "time_offset" in (diagnosis.effect, *diagnosis.group)


@pytest.mark.parametrize(("seed", "magnitude"), [(321, 2.0), (322, 10.0)])
def test_an_offset_borrows_nothing_across_pauses(seed, magnitude):
    recording = generate(seed, {"time_offset": magnitude}, ScenarioOptions(duration=16.0))
    paused = with_pauses(recording.streams, [(3.0, 5.0), (7.0, 9.0), (11.0, 13.0)])
    reading = {"sensor": "sensor", "forces": "force", "contacts": "contact"}
    truth = recording.truth()["effects"]["time_offset"]
    effect = create_effect(f"time_offset:{reading[truth['reading']]}")
    fitted = fit_with_readings(paused, [effect])
    std = fitted.to_estimate().to_json()["effects"]["time_offset"]["offset"]["std"]
    assert fitted.theta[0][0] == pytest.approx(truth["parameters"]["offset"]["value"], abs=4 * std)
    assert std < 2e-3
    assert fitted.whitened_rms < 1.05


def late_wrist_sensor(lag, seed=5):
    """A heavy box on a precise force/torque sensor that lags, its poses slow and noisy: 30 s."""
    shape = np.array([0.1, 0.08, 0.12])
    body = HeldObject("box", shape, 1.2, np.array([0.01, 0.0, 0.02]), np.diag([2e-3, 2.5e-3, 2e-3]))
    motion = Scenario.draw(seed, ScenarioOptions(band_hz=(0.2, 1.1))).motion
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, 30.0, 1e-3)
    moved = motion.evaluate(fine)
    wrench = body.inertial_wrench(moved, GRAVITY)
    inside = np.concatenate([moved.to_body(wrench[:, :3]), moved.to_body(wrench[:, 3:])], axis=1)
    decay, ratio = np.exp(-1e-3 / lag), lag / 1e-3
    linear = [1.0 - ratio * (1.0 - decay), ratio * (1.0 - decay) - decay]
    settled = lfilter(linear, [1.0, -decay], inside - inside[0], axis=0) + inside[0]
    read = slice(5, None, 10)
    count, turned = len(fine[read]), moved.rotation[read]
    noise = rng.normal(size=(count, 6)) * np.repeat([1e-3, 0.02], 3)
    shown = np.einsum("nij,nkj->nki", turned, (settled[read] + noise).reshape(-1, 2, 3))
    wrist = ContactStream(
        "wrist",
        fine[read],
        shown[:, 1],
        shown[:, 0],
        np.full((count, 3), 0.02),
        fine[read],
        moved.position[read],
        turned,
        carries_torque=True,
    )
    seen = motion.evaluate(np.arange(0.003, 29.99, 1.0 / 60.0))
    tilt = exp_so3(2.5e-3 * rng.normal(size=(len(seen.time), 3)))
    variance = np.diag(np.repeat([2.5e-3**2, 1e-3**2], 3))
    pose = PoseStream(
        seen.time,
        seen.position + 1e-3 * rng.normal(size=(len(seen.time), 3)),
        tilt @ seen.rotation,
        np.broadcast_to(variance, (len(seen.time), 6, 6)).copy(),
    )
    return Streams(pose, {"wrist": wrist})


def test_a_small_lag_is_measured_although_noise_of_the_motion_exceeds_it():
    """What a lag of 3 ms does is less than what noise of the poses does to its prediction."""
    fitted = fit_with_readings(late_wrist_sensor(0.003), [create_effect("sensor_lag")])
    assert fitted.whitened_rms < 1.05
    assert fitted.theta[-1][0] == pytest.approx(0.003, rel=0.1)
