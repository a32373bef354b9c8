"""Noise nets: alike in numpy and torch, wide where an object is hidden or a touch is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_dynamics_ros.cli import train_noise
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter.observation import MeasuredWrench, relative_std
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce, PushTracker, TrackerConfig
from tactile_dynamics_ros.core.planar.network.noise import (
    CROP,
    NoiseWeights,
    TouchNoise,
    depth_crop,
    shipped_noise,
    shipped_noise_file,
)
from tactile_dynamics_ros.core.planar.network.noise_features import (
    LOOK,
    TOUCH,
    Looked,
    Touched,
    TouchHistory,
    lasting,
)
from tactile_dynamics_ros.core.planar.network.noise_training import (
    NoiseExamples,
    NoiseNetwork,
    NoiseTrainingConfig,
    noise_loss,
)
from tactile_dynamics_ros.core.planar.network.noise_training import (
    train_noise as train,
)
from tactile_dynamics_ros.sim.planar.looking import looked_at, told_of

STEP = 1.0 / 15.0


@pytest.mark.parametrize(("features", "factors", "crop"), [(TOUCH, 1, False), (2, 2, True)])
def test_numpy_and_torch_agree(features, factors, crop):
    torch.manual_seed(1)
    network, rng = NoiseNetwork(features, factors, 16, crop).double(), np.random.default_rng(2)
    middle, scale = rng.normal(size=features), rng.uniform(0.5, 2.0, features)
    values, crops = rng.normal(size=(5, features)), rng.uniform(-2.0, 2.0, (5, CROP, CROP))
    net = network.plain(middle, scale)
    with torch.no_grad():
        other = network(
            torch.tensor((values - middle) / scale), torch.tensor(crops) if crop else None
        )
    mine = net.log_factor(values, crops if crop else None)
    assert np.ptp(mine) > 1e-3
    np.testing.assert_allclose(mine, other.numpy(), rtol=0.0, atol=1e-6)


def test_what_a_filter_grants_is_not_the_sensors():
    errors, log_factor = torch.full((1, 1, 1), 3.0), torch.zeros(1, 1, requires_grad=True)
    for granted, sign in ((0.0, -1.0), (100.0, 1.0)):
        loss = noise_loss(log_factor, errors, torch.full((1, 1, 1), granted))
        (slope,) = torch.autograd.grad(loss, log_factor)
        assert np.sign(float(slope)) == sign


def test_a_small_training_beats_a_constant_std():
    rng = np.random.default_rng(3)
    features = rng.uniform(-1.0, 1.0, (1200, 2))
    errors = rng.normal(size=(1200, 1, 2)) * np.exp(features[:, :1])[:, None]
    nothing = np.zeros_like(errors)
    config = NoiseTrainingConfig(width=8, epochs=30)
    net = train(NoiseExamples(features[:800], None, errors[:800], nothing[:800]), config)
    held_out = torch.tensor(errors[800:]), torch.tensor(nothing[800:])
    mine = noise_loss(torch.tensor(net.log_factor(features[800:])), *held_out)
    level = np.log(np.sqrt(np.mean(np.square(errors[:800]))))
    constant = noise_loss(torch.full((400, 1), level, dtype=torch.float64), *held_out)
    assert float(mine) < float(constant) - 0.1
    np.testing.assert_allclose(net.log_factor(np.array([[0.8, 0.0]])), 0.8, atol=0.3)


def moved(way: float) -> PusherMotion:
    at = np.array([-0.05, 0.0, 0.0])
    return PusherMotion(at, at + [way, 0.0, 0.0], STEP, touching=True, normal=np.array([1.0, 0.0]))


def told_of_touch(ways: list[float], forces: list[float], shares: list[float]) -> list[Touched]:
    """What is known of steps of a tip that pushes along x."""
    history, found = TouchHistory(), []
    for way, force, share in zip(ways, forces, shares, strict=True):
        state = np.array([0.0, 0.0, 0.0, way / STEP, 0.0, 0.0])
        measured = MeasuredWrench(np.array([force, 0.0]), np.full(2, 0.03))
        touched = history.next(moved(way), measured, share, state)
        assert touched is not None
        found.append(touched)
    return found


def test_a_history_tells_how_a_touch_began_and_changed():
    first, second, third = told_of_touch([2e-3, 2e-3, 1e-3], [1.0, 3.0, 2.0], [0.6, 1.0, 1.0])
    assert [float(each.since[0]) for each in (first, second, third)] == pytest.approx(
        [0.0, STEP, 2.0 * STEP]
    )
    np.testing.assert_allclose(first.last, 0.0)
    np.testing.assert_allclose(second.last, [[1.0, 0.0]])
    np.testing.assert_allclose(third.before - third.velocity, [[1e-3 / STEP, 0.0]])
    np.testing.assert_allclose(third.slip, 0.0, atol=1e-12)
    assert third.stated[0] == pytest.approx(np.hypot(0.03, relative_std(np.array([2.0, 0.0]))))


def test_the_std_of_forces_follows_a_touch_that_begins_and_one_that_is_lost():
    ways, forces = [2.5e-3] * 8 + [3e-4], [2.0] * 8 + [0.4]
    noise = shipped_noise()
    factors = [
        float(noise.touch_factor(each)[0])
        for each in told_of_touch(ways, forces, [0.6, *[1.0] * 7, 0.6])
    ]
    steady = max(factors[3:8])
    assert factors[0] > 2.0 * steady
    assert factors[8] > 2.0 * steady


def box_seen(passing: bool):
    half = np.array([0.05, 0.035])
    corners = half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    frames = np.tile([0.0, 0.0, 0.3], (24, 1)) + np.linspace(0.0, 0.02, 24)[:, None] * [1, 0, 0]
    looks = looked_at(corners, 0.05, np.arange(24) / 8.0, frames, 5, passing)
    return told_of(looks, frames[:, 2]), frames


def test_the_std_of_poses_follows_what_hides_the_object():
    told, frames = box_seen(True)
    looked = told.looked
    hidden = looked.visible < 0.6
    assert 2 <= hidden.sum() < len(hidden) - 4
    error = np.abs(told.poses - frames[told.rows])
    assert np.all(error[:, :2] < 5e-3)
    std = shipped_noise().look_std(looked)
    assert std[hidden].mean(axis=0)[0] > 1.2 * std[~hidden].mean(axis=0)[0]
    assert looked.points[hidden].mean() < 0.8 * looked.points[~hidden].mean()
    crops = told.crops[~hidden].mean(axis=0)
    assert np.abs(crops[28:36, 28:36]).mean() < 1.0


def looked_like(std: list[float]) -> Looked:
    one = np.ones(1)
    return Looked(0.9 * one, one, 900.0 * one, 1.1 * one, np.array([std]))


def test_a_tracker_that_says_that_it_does_not_know_is_believed():
    noise = shipped_noise()
    np.testing.assert_array_equal(noise.look_factor(looked_like([0.02, 0.02, 1.0])), 1.0)
    partly = noise.look_factor(looked_like([1e-3, 1e-3, 1.0]))[0]
    assert partly[0] != 1.0
    assert partly[1] == 1.0


class Threefold(NoiseWeights):
    """Nets of which the effect is known."""

    def touch_factor(self, touched: Touched) -> np.ndarray:
        return np.full(len(touched.std), 3.0)


def test_a_force_gets_the_whole_std_less_what_mechanics_miss():
    measured = MeasuredWrench(np.array([2.0, 0.0]), np.full(2, 0.03))
    state, noise = np.zeros(6), TouchNoise(Threefold({}, "test"))
    wider = noise.measured(moved(2e-3), measured, 1.0, state)
    floor = relative_std(measured.value)
    np.testing.assert_allclose(np.hypot(wider.std, floor), 3.0 * np.hypot(0.03, floor))
    gripped = noise.measured(replace(moved(2e-3), grip=True), measured, 1.0, state)
    assert gripped is measured


def tracked(noise) -> list:
    """What a filter is shown of a push with 2 N at 25 mm/s."""
    half = np.array([0.05, 0.04])
    outline = half * [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    tracker = PushTracker(PatchProcess(outline), TrackerConfig(), noise=noise)
    for k in range(12):
        time = 0.01 * k
        x = 0.025 * time
        tracker.add_pose(
            time, np.array([x, 0.0, 0.0]), np.array([5e-4, 5e-4, 3e-3]),
        )  # fmt: skip
        tracker.add_pusher(time, np.array([x - 0.056, 0.0, 0.02, 0.0]))
        tracker.add_contact(
            ContactForce(
                "pusher", time + 0.005, np.array([2.0, 0.0, 0.0]), np.full(3, 0.03),
                np.array([x - 0.05, 0.0, 0.02]), np.array([1.0, 0.0, 0.0]),
            )
        )  # fmt: skip
    shown = []
    tracker.advance(0.025)
    step = tracker.filter.step
    tracker.filter.step = lambda motion, seen: (shown.append(seen), step(motion, seen))
    tracker.advance(0.1)
    return [seen for seen in shown if seen.wrench is not None]


def test_the_tracker_shows_its_filter_what_a_noise_net_says_of_forces():
    threefold = TouchNoise(Threefold({}, "test"))
    plain, corrected = (tracked(noise)[-1] for noise in (None, threefold))
    np.testing.assert_allclose(corrected.poses[0].std, plain.poses[0].std)
    floor = relative_std(plain.wrench.value[:2])
    whole = np.hypot(plain.wrench.std[0], floor)
    np.testing.assert_allclose(np.hypot(corrected.wrench.std, floor), 3.0 * whole)


def test_a_crop_is_in_units_of_the_object_and_what_has_no_depth_is_far():
    depth = np.full((240, 320), 0.8)
    depth[100:140, 140:180] = 0.75
    depth[118:122, 158:162] = np.nan
    lens = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
    crop = depth_crop(depth, lens, np.array([0.0, 0.0, 0.76]), 0.1)
    assert crop.shape == (CROP, CROP)
    assert crop[20, 20] == pytest.approx(-0.1)
    assert crop[2, 2] == pytest.approx(0.4)
    assert crop[31, 31] == 2.0


def test_weights_come_back_from_their_file_and_others_are_refused(tmp_path):
    weights, path = shipped_noise(), tmp_path / "noise.npz"
    assert "train pushing --noise --seed" in weights.origin
    assert shipped_noise_file().stat().st_size < 1e6
    weights.save(path)
    again, features = NoiseWeights.load(path), np.random.default_rng(4).normal(size=(3, LOOK))
    np.testing.assert_array_equal(
        again.nets["look"].log_factor(features), weights.nets["look"].log_factor(features)
    )
    narrow = replace(weights.nets["look"], middle=np.zeros(3))
    NoiseWeights(weights.nets | {"look": narrow}, "test").save(path)
    with pytest.raises(BadInputError, match=r"noise\.npz: look has 3 features"):
        NoiseWeights.load(path)


def test_the_command_simulates_looks_trains_and_writes(tmp_path, monkeypatch, capsys):
    short = {
        name: replace(each, actions=replace(each.actions, count=1, duration=0.4, pauses=0))
        for name, each in train_noise.SETTINGS.items()
    }
    monkeypatch.setattr(train_noise, "SETTINGS", short)
    out, kept = tmp_path / "noise.npz", tmp_path / "kept"
    arguments = ["train", "pushing", "--noise", "--objects", "1", "--epochs", "2", "--json"]
    assert main([*arguments, "--out", str(out), "--keep", str(kept)]) == 0
    assert set(NoiseWeights.load(out).nets) == {"touch", "look", "crop"}
    assert len(list(kept.glob("noise_*.npz"))) == 2


def test_errors_that_last_add_up_and_others_do_not():
    rng = np.random.default_rng(6)
    independent = rng.normal(size=(4000, 1))
    assert np.mean(lasting(independent) ** 2) == pytest.approx(1.0, rel=0.15)
    kept = lasting(np.ones((100, 1)))
    np.testing.assert_allclose(kept[10:-10], np.sqrt(8.0))
    gap = np.ones((20, 1))
    gap[9:11] = np.nan
    assert np.all(np.isnan(lasting(gap)) == np.isnan(gap))
    np.testing.assert_allclose(lasting(gap)[8], np.sqrt(6.0))
