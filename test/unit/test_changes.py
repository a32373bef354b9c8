"""What begins at one time is told with its time, what follows a law of its own as unexplained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_sentence
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Misfit
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.synthetic.recordings import generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

DURATION = 24.0


def diagnose_altered(seed, alter, duration=DURATION):
    """Diagnose a clean recording after one finger's stream was altered."""
    streams = generate(seed, {}, ScenarioOptions(duration=duration, finger_roll=False)).streams
    altered = alter(streams.contacts["index"])
    contacts = {**streams.contacts, "index": altered}
    fitted = fit_with_readings(replace(streams, contacts=contacts))
    return diagnose(HeldObjectModel.from_fit(fitted))


def late(time):
    return time - time[0] > 0.55 * DURATION


def jump_of_contact_point(contact, size=0.004):
    jump = late(contact.pose_time)[:, None] * np.array([0.0, 0.0, size])
    moved = contact.position + np.einsum("nij,nj->ni", contact.rotation, jump[:, [2, 0, 1]])
    return replace(contact, position=moved)


def jump_of_reading(contact, size=0.15):
    return replace(contact, force=contact.force + late(contact.time)[:, None] * [size, 0.0, 0.0])


@pytest.mark.parametrize(("seed", "alter"), [(901, jump_of_contact_point), (903, jump_of_reading)])
def test_what_begins_at_one_time_is_told_with_its_time(seed, alter):
    diagnosis = diagnose_altered(seed, alter)
    regime = diagnosis.regime
    assert regime.condition.symbol == "t"
    assert regime.gate.low == pytest.approx(0.55 * DURATION, abs=0.2)
    assert np.isinf(regime.gate.high)
    assert f"Above t = {regime.gate.low:.3f} ± " in diagnosis_sentence(diagnosis)
    if alter is jump_of_contact_point:
        assert diagnosis.steps[0].choice.best.label == f"contact_offset[{regime.gate}]:index"


def test_a_sensor_that_saturates_is_no_known_effect():
    def saturating(contact):
        size = np.linalg.norm(contact.force, axis=1, keepdims=True)
        bound = 2.0 * np.median(size)
        return replace(contact, force=contact.force * np.tanh(size / bound) / (size / bound))

    diagnosis = diagnose_altered(904, saturating, duration=16.0)
    assert diagnosis.verdict == "unexplained"
    assert diagnosis.signature.correlates_with == "force"
    assert diagnosis.signature.change is None
    assert diagnosis.regime is None


def test_an_effect_is_drowned_if_louder_noise_takes_back_what_it_explains() -> None:
    before = Misfit(rms=2.0, noise_level=-3.5)
    assert before.is_drowned(Misfit(rms=1.4, noise_level=-2.5))
    assert not before.is_drowned(Misfit(rms=1.0, noise_level=-3.2))
    assert not before.is_drowned(Misfit(rms=1.9, noise_level=-3.4))
