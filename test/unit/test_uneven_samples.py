"""Samples at uneven times, lost ones among them: filters along time and windows of poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tactile_dynamics_ros.core.effects.check import example_inertia, example_samples
from tactile_dynamics_ros.core.effects.filters import evenly_filled, first_order_lag
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.numerics.local_polynomial import Window, local_polynomial
from tactile_dynamics_ros.core.numerics.noise import expected_noise

PERIOD = 0.01
WAVES = 2.0 * np.pi * np.array([0.7, 1.3])


def uneven_times(count, seed=0, lost=0.05):
    """Times that jitter by 30 % of their period, some of them lost."""
    rng = np.random.default_rng(seed)
    time = PERIOD * (np.arange(count) + 0.3 * rng.uniform(-1.0, 1.0, count))
    kept = rng.random(count) > lost
    kept[0] = True
    return time[kept]


@pytest.mark.parametrize("tau", [0.0025, 0.03, 0.4])
def test_a_lag_of_uneven_samples_is_that_of_the_signal(tau):
    """The response to cos(w t) is Re[exp(i w t) / (1 + i w tau)] once the start has faded."""
    time = uneven_times(1500)
    found, change = first_order_lag(time, np.cos(np.outer(time, WAVES)), tau)
    turning = np.exp(1j * np.outer(time, WAVES))
    late = 1.0 + 1j * WAVES * tau
    settled = time > 8.0 * tau + 0.05
    error = (found - (turning / late).real)[settled]
    effect = (np.cos(np.outer(time, WAVES)) - found)[settled]
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.sqrt(np.mean(effect**2))
    slope = (-1j * WAVES * turning / late**2).real[settled]
    assert np.abs(change[settled] - slope).max() < 0.05 * np.abs(slope).max()


def test_a_lag_starts_settled_after_a_long_silence():
    time = np.concatenate([PERIOD * np.arange(100), 3.0 + PERIOD * np.arange(100)])
    values = np.where(time < 2.0, 1.0, 5.0)
    found, _ = first_order_lag(time, values, 0.3)
    np.testing.assert_allclose(found, values)


def test_long_steps_are_filled():
    time = PERIOD * np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    filled, places = evenly_filled(time)
    np.testing.assert_allclose(filled, PERIOD * np.arange(7))
    np.testing.assert_allclose(filled[places], time)


def shaken_samples(time):
    """Samples of a body that is shaken without turning."""
    samples = example_samples(len(time))
    zero = np.zeros((len(time), 3))
    acceleration = np.stack([2.0 * np.sin(w * time) for w in (*WAVES, 3.0)], axis=1)
    return replace(
        samples,
        time=time,
        rotation=np.tile(np.eye(3), (len(time), 1, 1)),
        acceleration=acceleration,
        angular_velocity=zero,
        angular_acceleration=zero,
    )


@pytest.mark.parametrize("hz", [2.0, 12.0])
def test_a_mass_swings_on_through_lost_samples(hz):
    """Against an integration of its equation of motion with a small step."""
    damping, rate = 0.05, 2.0 * np.pi * hz
    time = uneven_times(600, seed=1, lost=0.1)
    time = time[(time < 3.0) | (time > 3.1)]
    samples = shaken_samples(time)

    def drive(t):
        return samples.gravity - np.array([2.0 * np.sin(w * t) for w in (*WAVES, 3.0)])

    def moves(t, state):
        pulled = drive(t) - rate**2 * state[:3] - 2.0 * damping * rate * state[3:]
        return np.concatenate([state[3:], pulled])

    start = np.concatenate([drive(time[0]) / rate**2, np.zeros(3)])
    span = (time[0], time[-1])
    truth = solve_ivp(moves, span, start, t_eval=time, rtol=1e-9, atol=1e-12).y.T
    expected = -0.1 * np.array([moves(t, state)[3:] for t, state in zip(time, truth, strict=True)])
    theta = np.array([0.1, hz, damping, 0.0, 0.0, 0.0])
    found = create_effect("sloshing_mass").wrench(samples, example_inertia(), theta)[:, 3:]
    assert np.std(found - expected) < 0.02 * np.std(expected)


def test_two_lost_poses_of_fifteen_leave_a_window_valid():
    whole = PERIOD * np.arange(200)
    time = np.delete(whole, [100, 104])
    grid = whole[90:115] + 0.3 * PERIOD
    read = local_polynomial(time, grid, Window(0.07, 6, tapered=True))
    assert read.valid.all()
    rate = 2.0 * np.pi * 2.0
    second = read.apply(np.sin(rate * time)[:, None], 2)[:, 0]
    np.testing.assert_allclose(second, -(rate**2) * np.sin(rate * grid), atol=0.01 * rate**2)


def test_windows_over_a_gap_and_at_the_ends_are_not_valid():
    whole = PERIOD * np.arange(200)
    time = whole[(whole < 0.9) | (whole > 1.0)]
    read = local_polynomial(time, whole, Window(0.07, 6, tapered=True))
    assert not read.valid[95]
    assert not read.valid[[0, -1]].any()
    assert read.valid[10:80].all()


def test_noise_is_told_from_a_slow_misfit_by_its_frequency():
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(3000, 6))
    assert np.std(expected_noise(noise.ravel()) - noise.ravel()) < 0.1
    misfit = 3.0 * np.sin(2.0 * np.pi * 0.5 * PERIOD * np.arange(3000))[:, None] * np.ones(6)
    found = expected_noise((noise + misfit).ravel()).reshape(-1, 6)
    assert np.std(found - noise) < 0.3


@pytest.mark.parametrize("count", [10, 127, 129, 192, 193, 1000])
def test_expected_noise_is_that_of_a_short_time_transform(count):
    """The same by scipy's class, whose import takes longer than all the filtering."""
    from scipy import signal
    from scipy.ndimage import uniform_filter
    from scipy.signal.windows import hann

    if not hasattr(signal, "ShortTimeFFT"):
        pytest.skip("scipy has it since 1.12")

    rows = np.random.default_rng(8).normal(size=(count, 6)) * np.linspace(1.0, 3.0, count)[:, None]
    length = min(128, 2 * (count // 2))
    window = hann(length, sym=False)
    transform = signal.ShortTimeFFT(window, length // 2, fs=1.0)
    spectra = transform.stft(rows, axis=0)
    power = np.mean(np.abs(spectra) ** 2, axis=1, keepdims=True) / np.sum(window**2)
    power = uniform_filter(power, (3, 1, 3), mode="nearest")
    share = np.where(power > 1.7, 1.0 / np.maximum(power, 1.0), 1.0)
    expected = transform.istft(spectra * share, k1=count, f_axis=0)
    np.testing.assert_allclose(expected_noise(rows.ravel()), expected.ravel(), atol=1e-12)


@pytest.mark.parametrize("tapered", [False, True])
def test_windows_across_a_long_pause_are_not_valid_and_harm_nothing(tapered):
    before, after = PERIOD * np.arange(100), 5000.0 + PERIOD * np.arange(100)
    time, grid = np.concatenate([before, after]), np.linspace(-10.0, 6000.0, 50_001)
    found = local_polynomial(time, grid, Window(0.12, 4, tapered=tapered))
    assert not found.valid[(grid > 1.1) & (grid < 4999.9)].any()
    assert np.isfinite(found.weights).all()
    near = local_polynomial(time, before[20:80], Window(0.12, 4, tapered=tapered))
    assert near.valid.all()
    np.testing.assert_allclose(near.apply(time[:, None] ** 2, 1)[:, 0], 2.0 * before[20:80])
