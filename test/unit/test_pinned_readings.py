"""Readings of an effect of a held object say among how many they were sought."""

from __future__ import annotations

from collections import Counter

import pytest

from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

NAMES = ("force_bias", "force_scale", "tether_spring", "quadratic_drag")


@pytest.fixture(scope="module")
def model() -> HeldObjectModel:
    recording = generate(3, scenario=ScenarioOptions(duration=2.0))
    return HeldObjectModel.from_fit(fit_recording(recording.streams))


def test_each_reading_counts_all_of_its_effect(model):
    families = model.families(NAMES)
    counts = Counter(family.name for family in families)
    assert set(counts) == set(NAMES)
    assert counts["force_bias"] > 10  # frames, times subsets of fingers
    assert counts["quadratic_drag"] == 1
    assert {f.name: f.choices for f in families} == counts
    assert all(f.choices == counts[f.name] for f in families)
