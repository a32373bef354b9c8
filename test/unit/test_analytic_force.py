"""Force, contact point and uncertainty from raw counts of units the calibration never saw."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.tactile.analytic_force import (
    AnalyticForceEstimator,
    classic_force,
    electrode_centroid,
    estimate_force,
    estimate_point,
    estimate_sequence,
    fit_unit_gain,
)
from tactile_dynamics_ros.core.tactile.calibration import (
    ForceCalibration,
    LabelledPresses,
    fit_calibration,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES, PDC, TDC
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.core.tactile.signal_change import RestState, temperature
from tactile_dynamics_ros.sim.sensors.biotac.presses import (
    PressConfig,
    Presses,
    label_presses,
    record_presses,
)


@pytest.fixture(scope="module")
def presses() -> Presses:
    return record_presses(PressConfig(units=64, frames=500, seed=4242))


@pytest.fixture(scope="module")
def labelled(presses) -> LabelledPresses:
    return label_presses(presses)


@pytest.fixture(scope="module")
def errors(labelled):
    found = [estimate_sequence(change, shipped_calibration()) for change in labelled.change]
    force, std = (np.concatenate(part) for part in zip(*found, strict=True))
    truth = labelled.force.reshape(-1, 3)
    strength = np.linalg.norm(truth, axis=1)
    useful = (strength > 0.2) & (strength < 3.0)
    return (force - truth)[useful], std[useful], truth[useful]


def test_force_error_on_unseen_units(errors):
    error, _, force = errors
    strength = np.linalg.norm(force, axis=1)
    magnitude = np.abs(np.linalg.norm(force + error, axis=1) - strength)
    assert np.median(magnitude) < 0.06
    assert np.median(np.linalg.norm(error, axis=1) / strength) < 0.15


def test_stated_std_covers_the_errors(errors):
    error, std, force = errors
    strength = np.linalg.norm(force, axis=1)
    inside = np.abs(error) < 1.645 * std
    assert 0.84 < inside.mean() < 0.96
    for low, high in [(0.2, 0.5), (0.5, 1.0), (1.0, 3.0)]:
        band = (strength >= low) & (strength < high)
        assert 0.78 < inside[band].mean() < 0.98


def test_contact_point_beats_the_centroid(labelled):
    change, force, truth = labelled.frames(every=2)
    pressed = np.linalg.norm(force, axis=1) > 0.5
    change, truth = change[pressed], truth[pressed]
    point, std = estimate_point(change, force[pressed], shipped_calibration())
    distance = np.linalg.norm(point - truth, axis=1)
    centroid = np.linalg.norm(electrode_centroid(change) - truth, axis=1)
    assert np.median(distance) < 1.1e-3
    assert np.median(distance) < 0.8 * np.median(centroid)
    assert 0.3e-3 < np.median(std) < 1.5e-3


def test_classic_formula_has_the_sign_of_the_force_and_is_worse(labelled, errors):
    scale = np.full(3, 0.1)
    change = np.zeros(20)
    change[16] = -3.0  # the electrode in the pad's middle falls: pushed from below
    assert classic_force(change, scale)[2] < 0.0
    error, _, force = errors
    assert np.median(np.linalg.norm(error, axis=1)) < 0.3 * np.median(np.linalg.norm(force, axis=1))


def test_live_estimator_agrees_with_truth_and_debounces(presses):
    estimator = AnalyticForceEstimator()
    raw, force = presses.raw[0], presses.force[0]
    estimator.tare(raw[:50])
    found = [estimator.estimate(frame) for frame in raw]
    touching = np.array([contact for _, _, contact in found])
    strength = np.linalg.norm(force, axis=1)
    assert not touching[:60].any()
    assert touching[strength > 0.2].mean() > 0.95
    estimated = np.array([estimate for estimate, _, _ in found])
    strong = touching & (strength > 0.3)
    relative = np.linalg.norm(estimated - force, axis=1)[strong] / strength[strong]
    assert np.median(relative) < 0.25
    assert np.all(estimated[~touching] == 0.0)
    assert estimator.last is not None
    assert estimator.last.torque == pytest.approx(np.cross(estimator.last.point, estimated[-1]))


def test_warming_of_the_core_is_not_taken_for_force(presses):
    raw = presses.raw[0, :50].astype(float)
    rest = RestState.from_frames(raw)
    warm = raw.mean(axis=0)
    kelvin = float(temperature(warm[TDC] + 60.0) - temperature(warm[TDC]))
    warm[TDC] += 60.0
    warm[ELECTRODES] += 31.7 * kelvin
    assert kelvin > 1.0
    assert np.abs(rest.change(warm, rest.warming(warm))).max() < 0.03


def test_rest_state_follows_temperature_drift_without_contact(presses):
    estimator = AnalyticForceEstimator()
    raw = presses.raw[0, :50].astype(float)
    estimator.tare(raw)
    drifting = raw[0].copy()
    for _ in range(600):
        drifting[PDC] += 0.02
        drifting[:19] += 0.05
        _, _, contact = estimator.estimate(drifting)
        assert not contact


def test_gain_of_a_unit_scales_and_turns_force(presses):
    swap = (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    once, twice, turned = (
        AnalyticForceEstimator(FingertipConfig(gain=gain)) for gain in ((1.0,), (2.0,), swap)
    )
    forces = []
    for estimator in (once, twice, turned):
        estimator.tare(presses.raw[1, :50])
        forces.append(np.array([estimator.estimate(frame)[0] for frame in presses.raw[1]]))
    assert np.abs(forces[0]).max(axis=0).min() > 0.1
    assert np.allclose(forces[1], 2.0 * forces[0])
    assert np.allclose(forces[2], forces[0][:, [1, 0, 2]])
    for bad in ((1.0, 2.0), (0.0,), (np.nan,)):
        with pytest.raises(BadInputError, match="gain"):
            FingertipConfig(gain=bad)


def test_presses_on_a_known_force_tell_gain_and_turn_of_a_unit():
    rng = np.random.default_rng(4)
    known = rng.normal(size=(2000, 3)) * [0.4, 0.4, 0.8] - [0.0, 0.0, 1.0]
    matrix = np.array([[1.05, 0.03, 0.0], [-0.02, 0.97, 0.04], [0.0, 0.01, 1.02]])
    seen = known @ np.linalg.inv(matrix).T + 0.02 * rng.normal(size=known.shape)
    gain = fit_unit_gain(seen, known)
    assert np.allclose(gain.matrix, matrix, atol=0.01)
    assert (gain.matrix_std < 0.01).all()
    assert gain.scale == pytest.approx(1.02, abs=0.02)


def test_saturated_electrode_raises_std(presses):
    estimator = AnalyticForceEstimator()
    estimator.tare(presses.raw[0, :50])
    frame = presses.raw[0, 200].copy()
    _, std, _ = estimator.estimate(frame)
    frame[5] = 2
    _, wider, _ = estimator.estimate(frame)
    assert estimator.last.saturated
    assert np.all(wider > 2.0 * std)


def test_misuse_is_refused_with_a_clear_message(presses):
    estimator = AnalyticForceEstimator()
    with pytest.raises(NotIdentifiableError, match="tare"):
        estimator.estimate(presses.raw[0, 0])
    with pytest.raises(BadInputError, match="44"):
        estimator.tare(np.zeros((3, 19)))
    with pytest.raises(BadInputError, match="12-bit"):
        estimator.tare(np.full((3, 44), 70000))
    with pytest.raises(BadInputError, match="lift the finger"):
        strongest = np.argmax(np.linalg.norm(presses.force, axis=2).max(axis=1))
        estimator.tare(presses.raw[strongest])


def test_calibration_file_round_trip_and_damage(tmp_path, labelled):
    fitted = fit_calibration(labelled, labelled, "a test", every=10)
    path = tmp_path / "calibration.json"
    fitted.save(path)
    loaded = ForceCalibration.load(path)
    force = estimate_force(labelled.change[0], fitted)
    again = estimate_force(labelled.change[0], loaded)
    assert np.allclose(force, again, atol=1e-3)
    assert loaded.origin == "a test"
    path.write_text("{}")
    with pytest.raises(BadInputError, match=r"calibration\.json"):
        ForceCalibration.load(path)
