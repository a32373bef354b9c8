"""Forces on another clock: large offsets are named, small ones may look like a lag."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.hidden.recordings import generate
from benchmarks.hidden.scenario import ScenarioOptions
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.inertia.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.readings import fit_with_readings


def diagnose_late(seed, magnitude):
    """Diagnose 12 s of forces that are late by 10 ms times the magnitude; return the truth too."""
    recording = generate(seed, {"time_offset": magnitude}, ScenarioOptions(duration=12.0))
    fitted = fit_with_readings(recording.streams, ())
    truth = recording.truth()["effects"]["time_offset"]
    return diagnose(HeldObjectModel.from_fit(fitted)), truth["parameters"]["offset"]["value"], truth


@pytest.mark.parametrize(("seed", "late"), [(320, "sensor"), (322, "forces")])
def test_an_offset_of_many_samples_is_named_and_leaves_noise(seed, late):
    diagnosis, offset, truth = diagnose_late(seed, 6.4)
    assert truth["variant"] == late
    assert diagnosis.effect == "time_offset"
    assert diagnosis.remaining < 1.05
    model = diagnosis.explained_model
    found = model.parameters()["time_offset"]["offset"]["value"]
    assert found == pytest.approx(offset, rel=0.05)
    assert np.sqrt(np.mean(model.residual**2)) < 1.05


def test_a_small_delay_is_named_or_grouped_with_a_lag():
    diagnosis, offset, truth = diagnose_late(327, 0.7)
    assert truth["variant"] == "forces"
    assert offset > 0.0
    assert "time_offset" in (diagnosis.effect, *diagnosis.group)
