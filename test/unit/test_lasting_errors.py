"""What the diagnosis says where sensors state more than their white noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from synthetic_recording import COM, INERTIA_COM, MASS, held_box
from test_diagnosis_engine import NOISE, Block, SlidingBlock, slide

from tactile_dynamics_ros.core.discrepancy.comparison import compare
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.trials import dispersion
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import assess
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings

QUIET = 0.4
"""Share of the stated noise that is white."""


def slide_with_lasting_error(seed: int, size: float, **hidden: float) -> Block:
    """A slide with little white noise and an error that wanders over seconds."""
    block = slide(seed, **hidden)
    silent = slide(seed)
    white = silent.force - 0.4 * silent.regressor
    rng = np.random.default_rng([seed, 1])
    knots = np.arange(0.0, 36.0, 5.0)
    wander = np.interp(block.time, knots, rng.normal(0.0, NOISE * size, len(knots)))
    force = block.force - (1.0 - QUIET) * white + wander
    return dataclasses.replace(block, force=force)


def test_errors_that_sensors_state_are_no_finding() -> None:
    for seed in range(10):
        model = SlidingBlock(slide_with_lasting_error(seed, 0.6))
        diagnosis = diagnose(model)
        assert not assess(model).white
        assert diagnosis.verdict == "adequate"
        document = diagnosis_document(diagnosis)
        assert "within the uncertainty that the sensors report" in document["sentence"]
        first = document["candidates"][0]
        if first["p_value"] < 0.01:
            assert first["remark"] in document["sentence"]
            assert "does not count: errors of this size" in first["remark"]
        assert all(c["remark"] == "" for c in document["candidates"] if c["p_value"] >= 0.01)
        assert compare(model).to_json()["adequate"]


def test_an_effect_beyond_what_sensors_state_is_named() -> None:
    for seed in range(6):
        model = SlidingBlock(slide_with_lasting_error(seed, 0.6, viscous_friction=0.1))
        assert diagnose(model).effect == "viscous_friction"


def test_a_law_of_the_same_size_that_nobody_knows_is_not_excused() -> None:
    fast = SlidingBlock(slide_with_lasting_error(3, 0.1, hum=0.9 * NOISE))
    assert assess(fast).rms < 1.0
    assert diagnose(fast).verdict == "unexplained"


def test_stated_noise_that_is_white_leaves_no_excuse() -> None:
    exact = SlidingBlock(slide(4, cubic_drag=0.004))
    assert not assess(exact).within_stated


def test_dispersion_is_one_for_white_noise_and_large_for_errors_that_last() -> None:
    assert dispersion(SlidingBlock(slide(5)), 1.0) < 2.0
    assert dispersion(SlidingBlock(slide_with_lasting_error(5, 0.6)), QUIET) > 20.0


@pytest.mark.parametrize("late", [0.1, -0.06])
def test_forces_that_come_a_tenth_of_a_second_late_are_timed(late: float) -> None:
    streams = held_box(seconds=12.0, seed=1).streams
    contacts = {
        name: dataclasses.replace(c, time=c.time + late, pose_time=c.pose_time + late)
        for name, c in streams.contacts.items()
    }
    moved = dataclasses.replace(streams, contacts=contacts)
    fit = fit_with_readings(moved, [create_effect("time_offset")])
    assert [effect.label for effect in fit.effects] == ["time_offset:contact"]
    assert float(fit.theta[0][0]) == pytest.approx(late, abs=2e-3)
    assert fit.whitened_rms < 1.3


def test_intervals_of_the_diagnosis_are_those_of_the_estimate() -> None:
    """Where the model does not fit, both widen alike."""
    streams = held_box(seconds=8.0, seed=2).streams
    index = streams.contacts["index"]
    swing = 0.2 * np.sin(0.9 * index.time)[:, None] * np.array([0.0, 0.0, 1.0])
    contacts = {**streams.contacts, "index": dataclasses.replace(index, force=index.force + swing)}
    disturbed = dataclasses.replace(streams, contacts=contacts)
    fit = fit_with_readings(disturbed, [create_effect("viscous_drag")])
    said = HeldObjectModel.from_fit(fit).parameters()["viscous_drag"]["c"]["std"]
    assert said == pytest.approx(fit.to_estimate().effects["viscous_drag"].std["c"], rel=0.3)


def test_errors_that_follow_a_quick_motion_are_no_finding() -> None:
    """Fingertips that give way and creep err at up to a dozen hertz where the motion is quick."""
    for seed in range(4):
        block = slide_with_lasting_error(seed, 0.5)
        noise = np.fft.rfft(np.random.default_rng([seed, 2]).normal(size=len(block.time)))
        hz = np.fft.rfftfreq(len(block.time), float(block.time[1] - block.time[0]))
        follows = np.fft.irfft(np.where(hz < 14.0, noise, 0.0), len(block.time))
        force = block.force + NOISE * follows
        assert diagnose(SlidingBlock(dataclasses.replace(block, force=force))).verdict == "adequate"


def test_a_drift_is_not_given_to_sensors_that_only_err_as_they_state() -> None:
    """Evidence as of white noise gave it to three, and moved the inertia by 4.4 std."""
    streams, random = held_box(seconds=30.0, seed=1).streams, np.random.default_rng([1, 1])
    contacts, knots = {}, np.arange(0.0, 31.0, 1.5)
    for name, contact in streams.contacts.items():
        std = float(contact.force_std.mean())
        errors = random.normal(0.0, 2.0 * std, (3, len(knots)))
        force = contact.force + np.stack([np.interp(contact.time, knots, e) for e in errors], 1)
        if name == "index":
            force = force + np.multiply.outer(contact.time, [0.02, -0.02, 0.01])
        stated = 3.0 * contact.force_std
        contacts[name] = dataclasses.replace(contact, force=force, force_std=stated)
    moved = dataclasses.replace(streams, contacts=contacts)
    fit = fit_with_readings(moved, [create_effect("force_drift")])
    assert [effect.label for effect in fit.effects] == ["force_drift:index@sensor"]
    about = INERTIA_COM + MASS * (COM @ COM * np.eye(3) - np.outer(COM, COM))
    truth = [MASS, *(MASS * COM), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    assert np.all(np.abs(fit.phi - truth) < 3.0 * np.sqrt(np.diag(fit.covariance)[:10]))
