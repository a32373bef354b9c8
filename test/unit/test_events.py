"""What changes at one time is named with it, both bodies are estimated, clean data have none."""

import numpy as np
import pytest

from benchmarks.support.tables import WristOptions, wrist_scenario, wrist_table
from tactile_dynamics_ros import synthetic
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.effects import create_effect, create_effects
from tactile_dynamics_ros.core.effects.check import check_effect
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.diagnosis.live_check import compare_streams
from tactile_dynamics_ros.core.inertia.diagnosis.misreading import question
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.synthetic.effects import create_hidden_effect

BIAS = {"duration": 15.0, "bias_n": 4.0, "bias_nm": 0.1}


def wrist(seed, **options):
    """A load on a wrist sensor whose zero is off."""
    table, body = wrist_table(seed, WristOptions(**(BIAS | options)))
    return table.streams(), body


def hidden(seed, name):
    """The event as it was hidden in a recording of `wrist`."""
    return create_hidden_effect(name, 1.0, seed, wrist_scenario(seed, WristOptions(**BIAS)))


def told(streams, effects=()):
    return diagnosis_document(diagnose(question(streams, create_effects(effects))))


@pytest.fixture(scope="module", params=["payload_change", "grasp_shift"])
def change(request):
    streams, body = wrist(3, effects=((request.param, 1.0),))
    return request.param, streams, body, hidden(3, request.param)


def test_an_event_is_named_with_its_time(change):
    name, streams, _, truth = change
    document = told(streams)
    assert document["verdict"] in ("missing_effect", "ambiguous")
    assert document["event"]["name"] == name
    assert document["event"]["t"] == pytest.approx(truth.at, abs=0.1)
    assert document["effect"].startswith(f"{name}[t>")
    assert document["sentence"].startswith(f"At t = {document['event']['t']:.3f} ± ")
    assert document["error"]["after"] < 1.05 < document["error"]["before"]


def test_both_bodies_are_estimated(change):
    name, streams, body, truth = change
    found = estimate(streams, create_effects([name])).to_estimate()
    event = found.event
    assert event.name == name
    assert event.time == pytest.approx(truth.at, abs=0.1)
    if name == "payload_change":
        mass = body.mass + truth.added
        com = (body.mass * body.com + truth.added * truth.place) / mass
    else:
        mass, com = body.mass, truth.after.com
    before = (np.append(found.inertia.mass, found.inertia.com), found.parameter_std[:4])
    after = (np.append(event.body.mass, event.body.com), event.parameter_std[:4])
    for (value, std), true in ((before, [body.mass, *body.com]), (after, [mass, *com])):
        assert np.all(np.abs(value - true) < 4.0 * std)
        assert std[0] < 0.01 and np.all(std[1:] < 2e-3)
    document = found.to_json()["event"]
    assert document["after"]["mass"]["value"] == pytest.approx(event.body.mass)


def test_a_sensor_that_is_zeroed_while_it_carries_is_named():
    streams, body = wrist(4, zeroed_at=8.0)
    document = told(streams)
    assert document["verdict"] == "missing_effect"
    assert document["event"]["name"] == "sensor_zeroed"
    assert document["event"]["t"] == pytest.approx(8.0, abs=0.1)
    found = estimate(streams, create_effects(["sensor_zeroed"])).to_estimate()
    assert abs(found.inertia.mass - body.mass) < 4.0 * found.parameter_std[0]
    assert found.event.body is None
    assert found.to_json()["event"]["after"] is None


@pytest.mark.parametrize("seed", [5, 6])
def test_a_zero_is_no_event_and_is_said(seed):
    streams, body = wrist(seed)
    document = told(streams)
    assert document["verdict"] == "adequate"
    assert document["event"] is None
    assert "zero of the sensor is part of the model" in document["sentence"]
    found = estimate(streams).to_estimate()
    assert abs(found.inertia.mass - body.mass) < 4.0 * found.parameter_std[0]
    assert np.linalg.norm(list(found.effects["force_bias"].value.values())[:3]) == pytest.approx(
        4.0, abs=0.1
    )


def test_a_load_that_was_zeroed_away_is_no_cable():
    streams, body = wrist(7, bias_n=0.0, bias_nm=0.0, zeroed_at=0.0)
    document = told(streams)
    assert document["verdict"] == "adequate"
    assert document["event"] == {"name": "sensor_zeroed", "t": 0.0, "std": None}
    assert "zeroed with the load on it" in document["sentence"]
    found = estimate(streams).to_estimate()
    assert abs(found.inertia.mass - body.mass) < 4.0 * found.parameter_std[0]


def test_a_touch_that_begins_is_not_called_an_event_alone():
    """It is a constant wrench in the sensor's axes, as a zero is."""
    streams, _ = wrist(8, effects=(("unsensed_contact[6<t<16]", 4.0),))
    document = told(streams)
    assert document["verdict"] == "ambiguous"
    touch, zero = sorted(document["group"], reverse=True)
    assert touch.startswith("unsensed_contact[t")
    assert zero.startswith("sensor_zeroed[t>6.0")


def test_something_put_on_an_object_in_a_hand_is_named():
    recording = synthetic.generate(
        11, {"payload_change": 1.0}, synthetic.ScenarioOptions(duration=12.0)
    )
    document = told(recording.streams)
    assert document["event"]["name"] == "payload_change"
    (truth,) = recording.effects
    assert document["event"]["t"] == pytest.approx(truth.at, abs=0.1)


@pytest.mark.parametrize("name", ["sensor_zeroed", "grasp_shift"])
def test_fingers_tell_for_themselves_what_shifts(name):
    recording = synthetic.generate(12)
    with pytest.raises(BadInputError, match=name):
        estimate(recording.streams, create_effects([name]))


def test_a_grasp_shift_is_consistent_with_turned_axes():
    assert check_effect(create_effect("grasp_shift[t>0.5]")).failures == ()


def test_an_effect_that_fits_only_with_what_cannot_be_is_refused():
    """Something that pushes ahead is no drag of negative coefficient."""
    streams, _ = wrist(9, effects=(("viscous_drag", -1.0),))
    with pytest.raises(NotIdentifiableError, match="viscous_drag.* c = -.*cannot be"):
        estimate(streams, create_effects(["viscous_drag"]))


def test_the_live_error_falls_when_the_event_is_added(change):
    name, streams, _, _ = change
    before, after = (compare_streams(streams, effects).whitened_rms for effects in ([], [name]))
    assert after < 1.1 < before
