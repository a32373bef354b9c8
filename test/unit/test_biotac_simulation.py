"""The simulated BioTac behaves as measured sensors do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.biotac_noise import white_noise
from tactile_dynamics_ros.core.tactile.electrodes import (
    ELECTRODE_POSITION,
    ELECTRODES,
    PAC,
    PDC,
    TDC,
)
from tactile_dynamics_ros.core.tactile.signal_change import temperature
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.sensor import thermistor_counts

SILENT = BioTacConfig(
    noise=0.0,
    wander=0.0,
    pressure_noise=0.0,
    vibration_noise=0.0,
    temperature_wander=0.0,
    contact_cooling=0.0,
    unit_variation=0.0,
)
PAD = np.array([[-2.8e-3, 0.0, -7.0e-3]])
UP = np.array([[0.0, 0.0, -1.0]])


LOUDEST, QUIETEST = 3.8, 0.4
"""Counts of white noise that electrodes of real sensors show, rounding included."""


def settle(array: BioTacArray, force: np.ndarray, point: np.ndarray, seconds: float = 0.1):
    for _ in range(round(100 * seconds)):
        raw = array.measure(force, point)
    return raw[0].astype(float)


def pressed_changes(force: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Changes (N, 44) of N noiseless sensors that have been pressed for long."""
    array = BioTacArray(len(points), SILENT, seed=1)
    rest = array.measure(np.zeros((len(points), 3)), points).astype(float)
    for _ in range(40):
        raw = array.measure(np.tile(force, (len(points), 1)), points, dt=0.5)
    return raw - rest


def pressed_change(force: np.ndarray, point: np.ndarray) -> np.ndarray:
    return pressed_changes(force, point)[0]


def test_electrodes_fall_under_the_contact_rise_far_away_and_pressure_rises():
    change = pressed_change(2.0 * UP, PAD)
    assert np.argmin(change[ELECTRODES]) == 16  # E17 lies below the contact
    assert change[16] < -100
    far = np.linalg.norm(ELECTRODE_POSITION - PAD, axis=1) > 9e-3
    assert np.all(change[ELECTRODES][far] > 10)
    assert np.all(change[ELECTRODES][far] < 120)
    assert 100 < change[PDC] < 250


def test_pressure_follows_the_largest_fall_and_rise_as_on_a_real_unit():
    """At 125 PDC counts a real unit shows about -180 and +65 counts, at 250 -290 and +110."""
    places = np.array([[along, 0.0, -7e-3] for along in np.linspace(-13e-3, 0.0, 8)])
    for strength, fall, rise in [(1.45, -180.0, 65.0), (3.4, -290.0, 110.0)]:
        changes = pressed_changes(strength * UP, places)[:, ELECTRODES]
        assert 0.5 < np.median(changes.min(axis=1)) / fall < 2.0
        assert 0.5 < np.median(changes.max(axis=1)) / rise < 2.0


def test_strong_grasp_takes_a_thousand_counts_off():
    change = pressed_change(10.0 * UP, PAD)
    assert -2500 < change[ELECTRODES].min() < -700


def test_shear_changes_electrodes_ahead_and_behind_differently():
    forward = pressed_change(UP + 0.4 * np.array([[1.0, 0.0, 0.0]]), PAD)
    backward = pressed_change(UP - 0.4 * np.array([[1.0, 0.0, 0.0]]), PAD)
    difference = (forward - backward)[ELECTRODES]
    ahead = ELECTRODE_POSITION[:, 0] > PAD[0, 0] + 2e-3
    behind = ELECTRODE_POSITION[:, 0] < PAD[0, 0] - 2e-3
    assert np.mean(difference[behind]) - np.mean(difference[ahead]) > 20


def test_contact_on_the_mount_or_nail_is_not_felt():
    for place in ([-21e-3, 0.0, -7e-3], [-5e-3, 0.0, 7e-3]):
        normal = np.array([[0.0, 0.0, np.sign(place[2])]])
        change = pressed_change(2.0 * normal, np.array([place]))
        assert np.abs(change[:20]).max() < 10


def test_creep_and_hysteresis():
    array = BioTacArray(1, SILENT)
    settle(array, np.zeros((1, 3)), PAD)
    early = settle(array, UP, PAD, 0.02)[16]
    late = settle(array, UP, PAD, 12.0)[16]
    rest = settle(BioTacArray(1, SILENT), np.zeros((1, 3)), PAD)[16]
    assert 0.05 < (early - late) / (rest - late) < 0.25
    settle(array, 3.0 * UP, PAD, 0.5)
    unloading = settle(array, UP, PAD, 12.0)[16]
    assert abs(unloading - late) > 0.01 * (rest - late)


def test_slip_and_touch_vibrate_in_pac_only_while_they_last():
    array = BioTacArray(1, seed=3)
    rest = settle(array, np.zeros((1, 3)), PAD)
    quiet, slipping = [], []
    for _ in range(100):
        quiet.append(array.measure(UP, PAD)[0, PAC] - rest[PAC].mean())
    for _ in range(100):
        slipping.append(array.measure(UP, PAD, slip_speed=0.03)[0, PAC] - rest[PAC].mean())
    assert np.std(quiet[20:]) < 60 < 150 < np.std(slipping) < 700
    spectrum = np.abs(np.fft.rfft(np.ravel(slipping))) ** 2
    hertz = np.fft.rfftfreq(np.size(slipping), 1 / 2200)
    inside = spectrum[(hertz > 40) & (hertz < 500)].sum()
    assert inside > 0.8 * spectrum[1:].sum()


def test_temperature_moves_electrodes_and_tdc():
    cold = BioTacArray(1, SILENT).measure(np.zeros((1, 3)), PAD)[0].astype(float)
    config = BioTacConfig(**{**SILENT.__dict__, "core_temperature": SILENT.core_temperature + 2.0})
    warm = BioTacArray(1, config).measure(np.zeros((1, 3)), PAD)[0].astype(float)
    assert_allclose((warm - cold)[ELECTRODES].mean(), 2 * 31.7, rtol=0.05)
    assert_allclose(temperature(warm[TDC]) - temperature(cold[TDC]), 2.0, atol=0.05)
    assert_allclose(temperature(np.array([844.0, 1008, 1243])), [25.7, 30.0, 35.3], atol=0.1)
    assert_allclose(thermistor_counts(np.array([30.0])), 1008, atol=2)


def test_noise_units_seeds_and_range():
    loud = BioTacConfig(noise=3.4, wander=1.0, loudest=1.0)
    first, same, other = (BioTacArray(4, loud, seed=s) for s in (5, 5, 6))
    zero, places = np.zeros((4, 3)), np.tile(PAD, (4, 1))
    frames = np.array([first.measure(zero, places) for _ in range(300)], dtype=float)
    assert_allclose(frames[:, :, ELECTRODES].std(axis=0).mean(), 3.5, atol=0.5)
    assert_allclose(np.diff(frames[:, :, ELECTRODES], axis=0).std() / np.sqrt(2), 3.4, atol=0.15)
    assert np.std(frames.mean(axis=0)[:, ELECTRODES], axis=0).mean() > 30
    repeated = np.array([same.measure(zero, places) for _ in range(300)])
    assert np.array_equal(frames, repeated)
    assert not np.array_equal(frames[0], other.measure(zero, places))
    crushed = np.array([first.measure(np.tile(200.0 * UP, (4, 1)), places) for _ in range(5)])
    assert crushed.dtype == np.uint16
    assert crushed.max() <= 4095


@pytest.mark.parametrize("count", [4])
def test_four_sensors_are_read_in_less_than_a_millisecond(count):
    import time

    array = BioTacArray(count)
    force, places = np.tile(UP, (count, 1)), np.tile(PAD, (count, 1))
    spent = []
    for _ in range(100):
        start = time.perf_counter()
        array.measure(force, places)
        spent.append(time.perf_counter() - start)
    assert np.median(spent) < 2e-3


def test_some_units_are_as_quiet_and_some_as_loud_as_real_ones():
    array = BioTacArray(200, BioTacConfig(temperature_wander=0.0), seed=3)
    free = np.zeros((200, 3))
    raw = np.array([array.measure(free, free) for _ in range(150)], dtype=float)
    noise = white_noise(raw[:, :, ELECTRODES].reshape(150, -1)).reshape(200, -1)
    electrodes = np.median(noise, axis=1)
    assert np.all((electrodes > QUIETEST) & (electrodes < LOUDEST))
    assert np.quantile(electrodes, 0.1) < 0.7
    assert np.quantile(electrodes, 0.9) > 2.4
    assert 0.9 < np.median(electrodes) < 1.6
