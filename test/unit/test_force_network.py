"""The force network: better than the analytic estimator, honest, fast and retrainable."""

from __future__ import annotations

import dataclasses
import signal
import time

import numpy as np
import pytest

from benchmarks.peers.voxel import (
    VoxelConfig,
    VoxelNetwork,
    alignment_weight,
    fill_voxels,
    predict_voxel,
    train_voxel_network,
)
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.tactile.analytic_force import (
    FORCE_MODELS,
    create_force_estimator,
    estimate_sequence,
    fit_unit_gain,
)
from tactile_dynamics_ros.core.tactile.calibration import (
    MIRROR_AXES,
    LabelledPresses,
    fit_calibration,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.electrodes import CHANNELS, PDC, TDC
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig, TactileEstimate
from tactile_dynamics_ros.core.tactile.network.training import TrainingConfig, train_network
from tactile_dynamics_ros.core.tactile.network.weights import (
    INPUTS,
    MIRROR_INPUTS,
    SHIPPED_NETWORK,
    Memory,
    NetworkForceEstimator,
    NetworkWeights,
    face_left,
    lagged,
    network_inputs,
    predict_presses,
    predict_sequence,
    shipped_network,
)
from tactile_dynamics_ros.core.tactile.signal_change import MIRROR
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray
from tactile_dynamics_ros.sim.sensors.biotac import presses as protocols_of
from tactile_dynamics_ros.sim.sensors.biotac.presses import (
    PressConfig,
    label_batches,
    label_presses,
    label_protocols,
    record_presses,
)
from tactile_dynamics_ros.sim.sensors.biotac.sensor import OUTER_RADIUS, outward_normal


def presses(units: int, seed: int, frames: int = 500) -> LabelledPresses:
    return label_presses(record_presses(PressConfig(units=units, frames=frames, seed=seed)))


@pytest.fixture(scope="module")
def unseen() -> LabelledPresses:
    return presses(48, seed=90_001)


def median_errors(force: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Median error of magnitude (N) and direction (deg) between 0.2 and 2 N."""
    strength, size = np.linalg.norm(truth, axis=1), np.linalg.norm(force, axis=1)
    useful = (strength > 0.2) & (strength < 2.0)
    cosine = np.sum(force * truth, axis=1)[useful] / (size * strength)[useful]
    angle = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return float(np.median(np.abs(size - strength)[useful])), float(np.median(angle))


def test_shipped_network_beats_the_analytic_estimator_on_unseen_units(unseen):
    truth = unseen.force.reshape(-1, 3)
    network = predict_presses(unseen, shipped_network())
    ours = median_errors(np.concatenate([each.force for each in network]), truth)
    analytic = [estimate_sequence(change, shipped_calibration())[0] for change in unseen.change]
    theirs = median_errors(np.concatenate(analytic), truth)
    assert ours[0] < 0.03
    assert ours[1] < 2.6
    assert ours[0] < 0.85 * theirs[0]
    assert ours[1] < 0.7 * theirs[1]


def test_intervals_and_contact_point_of_the_shipped_network(unseen):
    _, truth, place = unseen.frames()
    found = predict_presses(unseen, shipped_network())
    force, std, point, point_std = (
        np.concatenate([getattr(each, name) for each in found])
        for name in ("force", "std", "point", "point_std")
    )
    strength = np.linalg.norm(truth, axis=1)
    inside = np.abs(force - truth) < 1.645 * std
    for low, high in [(0.2, 0.5), (0.5, 1.0), (1.0, 2.0)]:
        assert 0.8 < inside[(strength > low) & (strength < high)].mean() < 0.97
    gap = np.linalg.norm(point - place, axis=1)[strength > 0.2]
    assert np.median(gap) < 0.6e-3
    assert 0.3 < np.median(gap / point_std[strength > 0.2]) < 3.0


def test_tiny_retraining_beats_the_analytic_estimator_fitted_to_the_same(unseen):
    few, others = presses(192, seed=5, frames=400), presses(24, seed=6, frames=400)
    config = TrainingConfig(epochs=20, every=6, width=64, batch=256, learning_rate=6e-3)
    weights = train_network([few], others, "a test", config)
    fitted = fit_calibration(few, others, "a test", every=8)
    truth = unseen.force.reshape(-1, 3)
    network = [each.force for each in predict_presses(unseen, weights)]
    analytic = [estimate_sequence(change, fitted)[0] for change in unseen.change]
    ours = median_errors(np.concatenate(network), truth)
    theirs = median_errors(np.concatenate(analytic), truth)
    assert ours[0] < theirs[0]
    assert ours[1] < 0.9 * theirs[1]


def test_presses_of_two_processes_are_those_of_their_seeds_in_order(monkeypatch):
    def short(units: int, seed: int) -> dict[str, PressConfig]:
        return {name: PressConfig(units=units, frames=80, seed=seed) for name in "abc"}

    monkeypatch.setattr(protocols_of, "protocols", short)
    found = list(label_batches(3, seed=40, batch=2))
    expected = [*label_protocols(2, 40).values(), *label_protocols(1, 43).values()]
    assert len(found) == len(expected) == 6
    for one, other in zip(found, expected, strict=True):
        assert np.array_equal(one.change, other.change)
        assert np.array_equal(one.force, other.force)


def test_presses_end_where_the_caller_handles_its_own_end(monkeypatch):
    """Nodes in one process set handlers; processes that inherit them would never end."""
    ignored: list[int] = []
    monkeypatch.setattr(
        protocols_of, "protocols", lambda units, seed: {"a": PressConfig(units=units, frames=80)}
    )
    before = signal.signal(signal.SIGTERM, lambda number, _: ignored.append(number))
    try:
        assert len(list(label_batches(2, seed=40, batch=1))) == 2
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_mirrored_sensor_feels_the_mirrored_force(unseen):
    change, rest = unseen.change[0, ::20], unseen.rest[0]
    seen = predict_sequence(change, rest, shipped_network())
    mirrored = predict_sequence(change[:, MIRROR], rest[MIRROR[:19]], shipped_network())
    np.testing.assert_allclose(mirrored.force * MIRROR_AXES, seen.force, atol=1e-5)
    np.testing.assert_allclose(mirrored.point * MIRROR_AXES, seen.point, atol=1e-8)
    np.testing.assert_allclose(mirrored.std, seen.std, rtol=1e-4)


def test_contacts_on_the_right_are_read_as_their_mirror_image_on_the_left(unseen):
    agrees = []
    columns = (unseen.change, unseen.rest, unseen.force, unseen.point)
    for change, rest, force, point in zip(*columns, strict=True):
        aside = (np.linalg.norm(force, axis=1) > 0.3) & (np.abs(point[:, 1]) > 3e-3)
        inputs = network_inputs(change, lagged(change, unseen.period), rest)[0][aside]
        left, mirrored = face_left(inputs)
        assert np.array_equal(left[~mirrored], inputs[~mirrored])
        assert np.array_equal(left[mirrored], inputs[mirrored][:, MIRROR_INPUTS])
        agrees.append(mirrored == (point[aside, 1] < 0.0))
    assert np.mean(np.concatenate(agrees)) > 0.97


def test_live_memory_equals_the_filtered_sequence():
    change = np.random.default_rng(0).normal(size=(200, 20))
    memory = Memory(0.01)
    live = np.array([memory.update(sample).copy() for sample in change])
    assert np.allclose(live, lagged(change, 0.01))


def test_live_estimator_equals_the_offline_prediction():
    recorded = record_presses(PressConfig(units=1, frames=300, seed=31))
    labelled = label_presses(recorded)
    estimator = NetworkForceEstimator()
    estimator.tare(recorded.raw[0, :55])
    live = [estimator.observe(frame) for frame in recorded.raw[0, 60:]]
    offline = predict_sequence(labelled.change[0], labelled.rest[0], shipped_network())
    touching = np.array([each.in_contact for each in live])
    assert touching[60:].mean() > 0.5
    force = np.array([each.force for each in live])
    difference = np.linalg.norm(force - offline.force, axis=1)[touching]
    assert np.median(difference) < 0.02


@pytest.mark.parametrize("model", FORCE_MODELS)
def test_fingers_that_are_read_together_say_what_each_says_alone(model):
    frames = record_presses(PressConfig(units=3, frames=300, seed=33)).raw.astype(float)
    frames[0, :, 4] = 4095.0
    frames[1, 150:160, 7] = 4094.0
    frames[2, 100:] += np.where(np.arange(44) == TDC, 120.0, 0.0)
    swap = (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.2)
    tips = [
        FingertipConfig(gain=(1.3,)),
        FingertipConfig(gain=swap, drift=tuple(np.linspace(27.0, 38.0, 19))),
        FingertipConfig(touch_frames=4, drift_warning=1.0, saturation_margin=0.0),
    ]
    together = create_force_estimator(model, tips)
    alone = [create_force_estimator(model, tip) for tip in tips]
    together.tare(frames.swapaxes(0, 1)[:50])
    for finger, own in zip(alone, frames, strict=True):
        finger.tare(own[:50])
    names = [field.name for field in dataclasses.fields(TactileEstimate)]
    seen: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for k in range(50, 300):
        found = together.observe(frames[:, k])
        each = [finger.observe(own) for finger, own in zip(alone, frames[:, k], strict=True)]
        for name, values in seen.items():
            values.append(np.asarray(getattr(found, name)))
            expected = np.array([getattr(one, name) for one in each])
            np.testing.assert_allclose(values[-1], expected, rtol=1e-5, atol=1e-5)
    touched, saturated, warm = (
        np.array(seen[name]) for name in ("in_contact", "saturated", "drifting")
    )
    assert touched.any(axis=0).all() and not touched.all(axis=0).any()
    assert saturated.any(axis=0).tolist() == [False, True, False]
    assert warm.any(axis=0).tolist() == [False, False, True]


def test_frames_of_another_number_of_fingers_are_refused():
    fingers, frames = create_force_estimator(config=[FingertipConfig()] * 4), np.full((30, 44), 9.0)
    with pytest.raises(BadInputError, match=r"\(30, 44\): expected \(4, 44\)"):
        fingers.tare(frames)
    touched = np.tile(frames[:, None], (1, 4, 1))
    touched[10:, 2, PDC] += 60.0
    with pytest.raises(BadInputError, match="fingertip 3 of 4 moved by 60 counts"):
        fingers.tare(touched)
    assert not fingers.tared
    fingers.tare(touched[:10])
    with pytest.raises(BadInputError, match=r"\(3, 44\): expected \(4, 44\)"):
        fingers.observe(np.tile(frames[0], (3, 1)))
    with pytest.raises(BadInputError, match="period"):
        create_force_estimator(config=[FingertipConfig(), FingertipConfig(period=0.02)])


def test_contact_ends_with_the_force_although_the_skin_creeps_back_slowly():
    place = np.array([3.8e-3, 0.0, -OUTER_RADIUS * np.sqrt(1.0 - (3.8e-3 / OUTER_RADIUS) ** 2)])
    firm, light = 60 + 30, 60 + 30 + 800 + 20
    press = np.zeros(light + 200)
    press[60:firm] = np.linspace(0.0, 3.0, 30)
    press[firm : light - 20] = 3.0
    press[light - 20 : light] = np.linspace(3.0, 0.0, 20)
    press[light + 150 :] = 0.12
    sensor = BioTacArray(1, seed=0)
    raw = [sensor.measure(f * outward_normal(place)[None], place[None])[0] for f in press]
    finger = NetworkForceEstimator()
    finger.tare(raw[:55])
    touching = np.array([finger.observe(frame).in_contact for frame in raw])
    assert touching[firm : light - 20].all()
    assert not touching[light + 5 : light + 150].any()
    assert touching[light + 170 :].mean() > 0.9


def test_a_live_finger_costs_about_a_pass_of_the_voxel_network_and_no_more_as_time_goes_on():
    raw = np.random.default_rng(0).normal(2900.0, 3.0, (450, CHANNELS))
    finger, compared = NetworkForceEstimator(), VoxelNetwork(1)
    finger.tare(raw[:50])
    live, voxel = [], []
    for frame in raw[50:]:
        start = time.process_time()
        finger.observe(frame)
        between = time.process_time()
        predict_voxel(compared, 0.01 * frame[None, :20])
        live.append(between - start)
        voxel.append(time.process_time() - between)
    assert np.median(live) < 2.0 * np.median(voxel)
    assert np.median(live[-100:]) < 2.0 * np.median(live[:100])


def test_shipped_weights_are_small_and_say_where_they_come_from():
    assert SHIPPED_NETWORK.stat().st_size < 2e6
    assert shipped_network().origin.startswith("tactile-dynamics train biotac --seed")


def test_weights_file_round_trip_and_damage(tmp_path):
    path = tmp_path / "weights.npz"
    shipped_network().save(path)
    again = NetworkWeights.load(path)
    inputs, size = np.random.default_rng(1).normal(size=(5, INPUTS)), np.ones((5, 1))
    expected = shipped_network().evaluate(inputs, size)
    assert np.array_equal(again.evaluate(inputs, size).force, expected.force)
    older = dataclasses.replace(shipped_network(), mean=np.zeros(101), scale=np.ones(101))
    older.save(path)
    with pytest.raises(BadInputError, match="train again"):
        NetworkWeights.load(path)
    path.write_bytes(b"nothing")
    with pytest.raises(BadInputError, match=r"weights\.npz"):
        NetworkWeights.load(path)
    with pytest.raises(BadInputError, match="absent"):
        NetworkWeights.load(tmp_path / "absent.npz")


@pytest.mark.parametrize("heads", [1, 10])
def test_compared_voxel_networks_learn(heads):
    few = presses(12, seed=7, frames=300)
    trained = train_voxel_network(few, VoxelConfig(heads=heads, epochs=15, every=6, batch=32))
    change, force, _ = few.frames(every=6)
    found, spread = predict_voxel(trained, change)
    error = np.linalg.norm(found - force, axis=1).mean()
    assert error < 0.75 * np.linalg.norm(force, axis=1).mean()
    assert (spread > 0.0).any() == (heads > 1)


def test_voxels_hold_electrodes_and_contact():
    change = np.zeros((1, 20))
    change[0, 16], change[0, 19] = -2.0, 0.7
    grid = fill_voxels(change).numpy()
    assert grid.shape == (1, 2, 16, 16, 8)
    assert grid[0, 0].sum() == pytest.approx(-2.0)
    assert grid[0, 1].sum() == pytest.approx(0.7)
    every = fill_voxels(np.ones((1, 20))).numpy()
    assert np.count_nonzero(every[0, 0]) == 19


def test_alignment_weight_follows_the_published_formula():
    normal = np.array([[0.0, 0.0, 1.0]] * 2)
    force = np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 0.0]])
    assert alignment_weight(force, normal) == pytest.approx([2.0**10 / 2.0, 2.0**5 / 0.5])


def test_gain_of_a_unit_from_a_known_force():
    rng = np.random.default_rng(3)
    truth = rng.normal(size=(600, 3))
    gain = fit_unit_gain(truth / 1.08 + 0.02 * rng.normal(size=(600, 3)), truth)
    assert gain.scale == pytest.approx(1.08, abs=4 * gain.std)
    assert gain.std < 0.01
    with pytest.raises(NotIdentifiableError, match="press harder"):
        fit_unit_gain(np.zeros((50, 3)), np.zeros((50, 3)))
    with pytest.raises(BadInputError, match=r"\(N, 3\)"):
        fit_unit_gain(np.zeros((50, 3)), np.zeros((49, 3)))
