"""Drift of a unit's electrodes with temperature: found while warming up, taken out of forces."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.biotac_press_rig import WARM_UP_PERIOD, calibrate_units, warm_up, write_frames
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator
from tactile_dynamics_ros.core.tactile.calibration import fit_thermal_drift
from tactile_dynamics_ros.core.tactile.electrodes import ELECTRODES, PDC, TDC
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig

PAD = np.array([4e-3, 0.0, -5.7e-3])
UNITS = 4


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    return warm_up(unit_seed=3, seed=3)


@pytest.fixture(scope="module")
def slopes() -> np.ndarray:
    return BioTacArray(UNITS, unit_seed=3).units.temperature_slope


def test_drift_is_found_to_within_what_it_states(frames, slopes):
    found = [fit_thermal_drift(frames[:, k]) for k in range(UNITS)]
    error = np.array([drift.slope for drift in found]) - slopes
    stated = np.array([drift.std for drift in found])
    assert np.abs(error).max() < 0.3
    assert 0.6 < np.sqrt(np.mean((error / stated) ** 2)) < 1.4
    assert found[0].span > 5.0


def test_frames_with_contact_are_left_out(frames, slopes):
    touched = frames[:, 0].copy()
    touched[::9, PDC] += 80
    touched[::9, ELECTRODES] -= 150
    assert np.abs(fit_thermal_drift(touched).slope - slopes[0]).max() < 0.3


def test_a_temperature_that_stays_teaches_nothing(frames):
    steady = frames[:, 0].copy()
    steady[:, TDC] = steady[0, TDC]
    with pytest.raises(NotIdentifiableError, match="ten minutes"):
        fit_thermal_drift(steady)
    with pytest.raises(NotIdentifiableError, match="frames without contact"):
        fit_thermal_drift(frames[:100, 0])


def test_command_prints_the_parameter(frames, slopes, tmp_path, capsys):
    write_frames(tmp_path / "warm", frames, WARM_UP_PERIOD)
    assert main(["calibrate", str(tmp_path / "warm"), "--drift", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert np.abs(np.array(found["thumb"]["drift"]) - slopes[3]).max() < 0.3
    assert main(["calibrate", str(tmp_path / "warm"), "--drift"]) == 0
    assert "`drift`" in capsys.readouterr().out
    write_frames(tmp_path / "steady", np.repeat(frames[:1], 700, axis=0), WARM_UP_PERIOD)
    assert main(["calibrate", str(tmp_path / "steady"), "--drift"]) == 3
    assert "switching the sensors on" in capsys.readouterr().err
    assert main(["calibrate", str(tmp_path / "warm"), "--finger", "index"]) == 2
    assert "--reference" in capsys.readouterr().err


def held_force_change(tips: list[FingertipConfig]) -> np.ndarray:
    """Change (4, 3) of the published force while a steadily held object cools the cores."""
    config = BioTacConfig(contact_cooling=0.1, creep_fast=0.0, creep_slow=0.0)
    sensors = BioTacArray(UNITS, config, seed=8, unit_seed=3)
    force = np.tile(1.2 * PAD / np.linalg.norm(PAD) + [0.3, 0.0, 0.2], (UNITS, 1))
    estimator = create_force_estimator(config=tips)
    free = [sensors.measure(0.0 * force, np.tile(PAD, (UNITS, 1))) for _ in range(60)]
    estimator.tare(free)
    held = []
    for _ in range(6000):
        counts = sensors.measure(force, np.tile(PAD, (UNITS, 1)))
        held.append(estimator.observe(counts).force)
    path = np.array(held)
    return path[-500:].mean(axis=0) - path[500:1000].mean(axis=0)


def test_a_calibrated_hand_drifts_less_while_it_holds(frames):
    plain = [FingertipConfig()] * UNITS
    own = [
        FingertipConfig(drift=tuple(fit_thermal_drift(frames[:, k]).slope)) for k in range(UNITS)
    ]
    before, after = (np.sqrt(np.mean(held_force_change(tips) ** 2)) for tips in (plain, own))
    assert after < 0.6 * before


def test_the_rig_gives_drift_and_gain():
    tip = calibrate_units(0)[0]
    assert len(tip.drift) == 19
    assert len(tip.gain) == 9


def test_odd_numbers_are_refused():
    with pytest.raises(BadInputError, match="19"):
        FingertipConfig(drift=(31.7, 31.7))
