"""The live comparison answers as the commands do on a recording of the same measurements."""

import json
import pickle
from dataclasses import dataclass, field, replace
from functools import partial
from operator import itemgetter
from types import SimpleNamespace

import numpy as np
import pytest
from synthetic_recording import held_box

from benchmarks.friction.generator import draw_surface, generate_events
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.discrepancy import live_check
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.live_check import (
    LiveCheckConfig,
    LiveComparison,
    LiveModelCheck,
    live_document,
)
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Misfit
from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding
from tactile_dynamics_ros.core.friction.discrepancy_model import FrictionModel
from tactile_dynamics_ros.core.friction.slip_log import tabulate_slips
from tactile_dynamics_ros.core.inertia.diagnosis.live_check import compare_streams, diagnose_streams
from tactile_dynamics_ros.core.numerics.regime import Gate
from tactile_dynamics_ros.core.streams.measurement_window import MeasurementWindow
from tactile_dynamics_ros.core.streams.streams import ContactSample, Streams
from tactile_dynamics_ros.recording.probe_slips import write_slips

SEED = 501
HIDDEN = "load_dependent_friction"


@pytest.fixture(scope="module")
def streams():
    return held_box(seconds=12.0).streams


def fed_with(streams: Streams) -> LiveModelCheck:
    """A check that has got all measurements, in the order of their stamps."""
    window, pose = MeasurementWindow(40.0), streams.pose
    readings = []
    for k, time in enumerate(pose.time):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation[k], pose.position[k]
        covariance = None if pose.covariance is None else pose.covariance[k]
        readings.append((time, partial(window.add_pose, time, matrix, covariance)))
    for name, contact in streams.contacts.items():
        for k, time in enumerate(contact.time):
            std = None if contact.force_std is None else contact.force_std[k]
            place = np.searchsorted(contact.pose_time, time).clip(0, len(contact.pose_time) - 1)
            where = contact.position[place], contact.rotation[place]
            sample = ContactSample(time, name, *where, contact.force[k], contact.torque[k], std)
            readings.append((time, partial(window.add_contact, sample)))
    for _, add in sorted(readings, key=itemgetter(0)):
        add()
    return LiveModelCheck(window, compare_streams, diagnose_streams)


def computed(job):
    """What another process would answer."""
    return pickle.loads(pickle.dumps(job))()


def test_clean_measurements_are_adequate(streams):
    check = fed_with(streams)
    found = computed(check.comparison())
    assert found.whitened_rms == pytest.approx(1.0, abs=0.1)
    assert found.residual.shape == (len(found.time), 6)
    assert streams.pose.time[-1] - 10.0 <= found.time[0] < found.time[-1] <= streams.pose.time[-1]
    assert computed(check.diagnosis())["verdict"] == "adequate"


def test_a_live_document_says_by_stamps_when_the_effect_acts_and_the_model_fails(monkeypatch):
    monkeypatch.setattr(live_check, "diagnosis_document", lambda found: {"verdict": found.verdict})
    time = np.arange(0.0, 10.0, 0.1)
    z = Condition("height", "m", 0.1 * time, symbol="z")
    white = np.where((time >= 6.0) & (time < 8.0), 4.0, 1.0)[:, None]
    found = SimpleNamespace(
        verdict="missing_effect",
        regime=RegimeFinding(z, Gate("z", 0.595, np.inf), 0.01, 0.4),
        model=SimpleNamespace(residuals=lambda: SimpleNamespace(time=time, white=white)),
    )
    spans = live_document(found, 1000.0)["spans"]
    np.testing.assert_allclose(spans["regime"], [[1006.0, 1009.9]])
    np.testing.assert_allclose(spans["failing"], [[1006.0, 1008.0]])
    found.verdict, found.regime = "adequate", None
    assert live_document(found, 0.0)["spans"] == {"regime": [], "failing": []}


def test_noise_that_is_twice_what_is_stated_is_no_missing_effect(streams):
    contacts = {
        name: replace(contact, force_std=0.5 * contact.force_std)
        for name, contact in streams.contacts.items()
    }
    found = computed(fed_with(replace(streams, contacts=contacts)).diagnosis())
    assert found["verdict"] == "adequate"
    assert found["error"]["before"] == pytest.approx(1.0, abs=0.1)


@dataclass
class SlipWindow:
    """Slips of a probe while they come."""

    slips: list = field(default_factory=list)

    def streams(self, window=np.inf):
        return [slip for slip in self.slips if slip.time >= self.slips[-1].time - window]


def fit_slips(slips, effects):
    return FrictionModel.fit(tabulate_slips(slips), effects)


def compare_slips(slips, effects):
    model = fit_slips(slips, effects)
    shown = model.residuals()
    return LiveComparison(shown.time, shown.physical, Misfit.of(model).rms)


def diagnose_slips(slips, effects):
    return diagnosis_document(diagnose(fit_slips(slips, effects)))


@pytest.fixture(scope="module")
def slips():
    """Slips within 150 s on a surface whose friction depends on the load."""
    events = generate_events(draw_surface(HIDDEN, SEED), SEED)
    return [replace(event, time=event.time / 3.0) for event in events]


@pytest.fixture
def probe(slips):
    """A check of Coulomb friction that has got all slips."""
    spans = LiveCheckConfig(error_window=60.0, diagnosis_window=300.0)
    return LiveModelCheck(SlipWindow(slips), compare_slips, diagnose_slips, spans)


def test_slips_of_a_probe_get_the_document_of_their_recording(probe, slips, tmp_path, capsys):
    found = computed(probe.diagnosis())
    recording = write_slips(slips, tmp_path / "slips")
    assert main(["diagnose", str(recording), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(found))
    assert found["effect"] == HIDDEN


def test_comparison_is_of_the_last_slips_with_the_effects_of_the_model(probe, slips):
    alone = computed(probe.comparison())
    probe.effects = (HIDDEN,)
    together = computed(probe.comparison())
    assert alone.residual.shape == (len(alone.time), 2)
    assert len(alone.time) < len(tabulate_slips(slips))
    assert together.whitened_rms < alone.whitened_rms
