"""A long recording is fitted in stretches; nothing that goes wrong in between escapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import assess
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch import stretches
from tactile_dynamics_ros.core.inertia.batch.stretches import fit_representative
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

LENGTH = 2.0


@pytest.fixture(scope="module")
def recording() -> HiddenRecording:
    return generate(11, scenario=ScenarioOptions(duration=30.0))


@pytest.fixture(autouse=True)
def short_stretches(monkeypatch):
    monkeypatch.setattr(stretches, "STRETCH", LENGTH)
    monkeypatch.setattr(stretches, "FEWEST", 10)


def disturbed(streams: Streams, start: float, stop: float) -> Streams:
    """The same, with half a newton more along x on one finger for a while."""
    contact = streams.contacts["thumb"]
    force = contact.force.copy()
    first = contact.time[0]
    force[(contact.time >= first + start) & (contact.time < first + stop), 0] += 0.5
    return replace(streams, contacts=streams.contacts | {"thumb": replace(contact, force=force)})


def test_a_clean_long_recording_is_adequate_on_evenly_spread_stretches(recording):
    model = fit_representative(recording.streams)
    assert model.survey.fitted.sum() == stretches.EVEN
    assert model.survey.fitted[0] and model.survey.fitted[-1]
    assert np.all(np.abs(model.survey.rms - 1.0) < 0.15)
    assert len(model.white_residual) == pytest.approx(6 * 100 * LENGTH * stretches.EVEN, rel=0.1)
    assert assess(HeldObjectModel.from_fit(model)).adequate
    body = recording.scenario.body
    assert model.phi[0] == pytest.approx(body.mass, rel=0.01)


def test_a_disturbance_between_the_chosen_stretches_is_found(recording):
    clean = fit_representative(recording.streams).survey
    between = int(np.flatnonzero(~clean.fitted)[3])
    start, stop = clean.edges[between : between + 2] - clean.edges[0]
    model = fit_representative(disturbed(recording.streams, start + 0.3, stop - 0.3))
    assert model.survey.fitted[between]
    assert int(np.argmax(model.survey.rms)) == between
    assert not assess(HeldObjectModel.from_fit(model)).adequate
    assert "largest error" in model.survey.remark


def test_stretches_are_chosen_where_something_is_held(recording):
    contacts = {}
    for name, contact in recording.streams.contacts.items():
        late = contact.time > contact.time[0] + 20.0
        contacts[name] = replace(contact, force=np.where(late[:, None], contact.force, 0.0))
    survey = fit_representative(replace(recording.streams, contacts=contacts)).survey
    assert np.flatnonzero(survey.fitted).min() >= 9
    assert np.isnan(survey.rms[:9]).all()


def test_a_recording_in_which_nothing_is_held_is_refused(recording):
    contacts = {
        name: replace(contact, force=np.zeros_like(contact.force))
        for name, contact in recording.streams.contacts.items()
    }
    with pytest.raises(BadInputError, match="hardly held"):
        fit_representative(replace(recording.streams, contacts=contacts))


def test_short_recordings_are_fitted_whole(recording, monkeypatch):
    monkeypatch.setattr(stretches, "STRETCH", 30.0)
    assert fit_representative(recording.streams).survey is None
