"""What is said of a pushed object, live: before a push, by the filter, after fits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.filter import record as record_module
from tactile_dynamics_ros.core.planar.filter.change import Change
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties, PropertyConfig
from tactile_dynamics_ros.core.planar.filter.record import PushRecord
from tactile_dynamics_ros.core.planar.filter.summary import of_filter, of_fit
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.network.models import pushing_model
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
STD = np.array([5e-4, 5e-4, 3e-3])
PATCH = SupportPatch(BLOCK)


def measured(time, newtons, name="pusher"):
    return ContactForce(
        name,
        time,
        np.array([newtons, 0.0, 0.0]),
        np.full(3, 0.03),
        np.array([-0.05, 0.0, 0.02]),
        np.array([1.0, 0.0, 0.0]),
    )


def fitted(force=3.0, std=0.03, error=1.0, undetermined=("mass",)):
    values = {
        "mass": (1.2, 0.4),
        "friction": (force / 1.2 / 9.81, 0.1),
        "friction_force_n": (force, std),
        "com_x": (0.004, 1e-3),
        "com_y": (-0.002, 1e-3),
        "friction_radius_m": (0.04, 1e-3),
        "inertia_zz": (1e-3, 4e-4),
    }
    covariance = np.diag(np.square([std / force, 0.3, 1e-3, 1e-3]))
    return PushedEstimate(100, 2.0, values, undetermined, covariance, error)


def seen():
    """An object that was seen, and nothing else."""
    live = LiveProperties()
    live.set_outline(BLOCK)
    for k in range(10):
        live.add_pose(0.01 * k, np.array([0.5, 0.0, 0.3]), STD)
    live.advance(0.08)
    return live


def test_a_record_keeps_what_lies_around_the_latest_touches():
    record = PushRecord(longest=1.0)
    for k in range(2000):
        time = 0.01 * k
        record.add_pose(time, np.zeros(3), STD)
        touched = 2.0 <= time < 4.0 or 10.0 <= time < 10.5
        record.add_contact(measured(time, 3.0 if touched else 0.0))
        record.add_contact(measured(time, 0.0, "pad_left"))
        over = 4.995 < time < 9.995 or time > 11.495
        assert record.has_ended(time) == over, time
    streams = record.streams(BLOCK, gravity=np.array([0.0, 0.0, -9.81]))
    assert not record.has_ended(20.0)
    assert list(streams.contacts) == ["pusher"]
    contact, link = streams.contacts["pusher"], streams.links[0]
    assert link.time[0] == pytest.approx(2.5)  # half a second of the first push, one before it
    assert link.time[-1] == pytest.approx(11.49, abs=0.011)
    assert not np.any((link.time > 5.0) & (link.time < 8.99))
    assert len(contact.pose_time) == 100  # what is measured before a touch tells nothing
    assert_allclose(contact.force_std, 0.03)


def test_a_long_rest_does_not_push_the_pushes_out(monkeypatch):
    for name in ("_MOST", "_MOST_TURNS"):
        monkeypatch.setattr(record_module, name, 1000)
    record = PushRecord(longest=5.0)
    for k in range(6000):
        time = 0.01 * k
        record.add_pose(time, np.zeros(3), STD)
        record.add_pusher(time, 0.1)
        record.add_contact(measured(time, 3.0 if 2.0 <= time < 4.0 else 0.0))
    streams = record.streams(BLOCK, gravity=np.array([0.0, 0.0, -9.81]))
    assert len(streams.contacts["pusher"].pose_time) == 200
    times = streams.links[0].time
    assert np.count_nonzero((times > 1.5) & (times < 4.5)) == pytest.approx(300, abs=1)
    assert np.count_nonzero((streams.pusher_time > 1.5) & (streams.pusher_time < 4.5)) > 298


def test_fits_know_how_the_sensor_was_turned():
    live = seen()
    for k in range(10):
        live.add_pusher(0.01 * k, np.array([0.4, 0.0, 0.02, 0.3 * k]))
    live.add_contact(measured(0.05, 3.0))
    streams = live.due(2.0)
    assert_allclose(streams.pusher_yaw, 0.3 * np.arange(10))
    assert_allclose(streams.pusher_time, 0.01 * np.arange(10))


def test_before_a_push_everything_is_said_to_be_undetermined():
    known = seen().properties()
    assert known.source == "nothing"
    assert known.doubtful
    assert {"mass", "friction_force_n", "com"} <= {*known.undetermined}
    assert "nothing was pushed yet" in known.text


def test_nothing_is_said_of_an_object_that_was_not_seen():
    live = LiveProperties()
    assert live.properties() is None
    live.set_outline(BLOCK)
    assert live.properties() is None


def test_a_filter_never_calls_a_mass_determined():
    mean = np.array([np.log(0.3), 0.0, 0.0, 0.0])
    known = of_filter(mean, np.diag([1e-4, 1e-6, 1e-8, 1e-8]), PATCH, steps=100)
    assert {"mass", "friction"} <= {*known.undetermined}
    assert "friction_force_n" not in known.undetermined
    force, std = known.values["friction_force_n"]
    assert force == pytest.approx(0.3 * 9.81)
    assert std == pytest.approx(0.01 * force)
    assert known.values["mass"][1] == pytest.approx(0.25, rel=1e-3)
    assert "known only as a product (2.94 ± 0.03 N)" in known.text


@pytest.mark.parametrize("name", ["graph", "graph_residual"])
def test_a_learnt_model_filters_at_the_steps_of_its_training_and_has_no_fits(name):
    live = LiveProperties(PropertyConfig(name), pushing_model(name))
    live.set_outline(BLOCK)
    assert live.tracker.config.step == pytest.approx(1.0 / 15.0)
    with pytest.raises(BadInputError, match=f"model '{name}' has not; choose model 'patch'"):
        live.set_effects(["support_tilt"])
    for k in range(200):
        time, at = 0.01 * k, 0.2 * min(max(0.01 * k - 1.0, 0.0), 0.5)
        live.add_pose(time, np.array([at, 0.0, 0.0]), STD)
        live.add_pusher(time, np.array([at - 0.05, 0.0, 0.02, 0.0]))
        one = measured(time, 3.0 if 1.0 <= time < 1.5 else 0.0)
        live.add_contact(replace(one, point=np.array([at - 0.05, 0.0, 0.02])))
        live.advance(time)
    assert live.due(4.0) is None
    assert live.faster > 1
    known = live.properties()
    assert known.doubtful
    assert f"faster than what '{name}' was trained on; choose model 'patch'" in known.text


@pytest.mark.parametrize("make", [PropertyConfig, pushing_model])
def test_an_unknown_model_is_named_with_those_that_there_are(make):
    with pytest.raises(BadInputError, match="'nn': expected patch, graph, graph_residual"):
        make("nn")


@pytest.mark.parametrize(
    ("fit", "refused", "words"),
    [
        (fitted(), "", ""),
        (fitted(error=3.0), "", "the model does not fit (3.0 times the noise)"),
        (fitted(force=2.0), "", "something changed"),
        (fitted(), "it slides too little", "the latest push is not in it: it slides too little"),
    ],
)
def test_what_speaks_against_a_fit_is_said(fit, refused, words):
    mean = np.array([np.log(3.0 / 9.81), 0.0, 0.0, 0.0])
    live = of_filter(mean, np.diag([2.5e-3, 1.0, 1e-6, 1e-6]), PATCH, steps=100)
    known = of_fit(fit, live, refused)
    assert words in known.text
    assert known.doubtful == bool(words)
    assert known.values == fit.values


@pytest.mark.parametrize(("std", "doubted"), [(0.01, False), (0.06, True)])
def test_an_effect_of_unknown_size_may_stand_for_something_else(std, doubted):
    mean = np.array([np.log(3.0 / 9.81), 0.0, 0.0, 0.0])
    live = of_filter(mean, np.diag([2.5e-3, 1.0, 1e-6, 1e-6]), PATCH, steps=100)
    axes = {"t_x": {"value": -0.06, "std": std}, "t_y": {"value": 0.0, "std": 0.06}}
    known = of_fit(replace(fitted(), effects={"support_tilt": axes}), live, "")
    assert known.doubtful == doubted
    assert ("how large support_tilt is, the pushes do not tell" in known.text) == doubted


def test_the_filter_goes_on_from_a_fit():
    live = seen()
    live.take_fit(fitted(std=3e-3))
    mean, covariance = live.tracker.filter.parameters
    assert_allclose(mean[:4], [np.log(3.0 / 9.81), np.log(1.2), 0.004, -0.002])
    assert np.sqrt(covariance[0, 0]) == pytest.approx(np.hypot(1e-3, 0.02))
    assert np.all(np.linalg.eigvalsh(live.tracker.filter.belief.covariance) > 0.0)
    assert live.properties().source == "fit"
    live.take_fit(None, "it slides too little")
    assert live.properties().source == "fit"
    assert live.properties().doubtful


def test_a_fit_to_hardly_more_pushes_is_no_new_reference(monkeypatch):
    """What a change began to show is kept when the fit after its first push comes."""
    live, referred = seen(), []
    monkeypatch.setattr(live.monitor, "refer", lambda mean, _: referred.append(mean[0]))
    for push in range(8):
        live.add_contact(measured(2.0 * push, 3.0))
        live.take_fit(fitted(force=3.0 + push))
    assert np.round(9.81 * np.exp(referred)).tolist() == [3, 4, 5, 7, 10]  # of 1, 2, 3, 5, 8
    live.take_fit(fitted(error=2.0))
    assert len(referred) == 5


def told_change():
    return Change(30.0, 22.0, 5.0, np.zeros(2), 0.4, 3.0)


def test_no_fit_is_a_reference_while_a_change_is_told_and_not_answered(monkeypatch):
    live, referred = seen(), []
    live.add_contact(measured(0.05, 3.0))
    live.take_fit(fitted(force=3.0))
    live.monitor.alarm = told_change()
    live.advance(0.09)
    monkeypatch.setattr(live.monitor, "refer", lambda mean, _: referred.append(mean[0]))
    live.add_contact(measured(6.0, 3.0))
    live.take_fit(fitted(force=4.0))
    assert referred == []
    live.set_effects([])
    live.take_fit(fitted(force=4.0))
    assert 9.81 * np.exp(referred) == pytest.approx([4.0])


def test_fits_with_effects_begin_with_what_was_known_before_the_change():
    live = seen()
    live.add_contact(measured(0.05, 3.0))
    live.take_fit(fitted(force=3.0))
    live.add_contact(measured(3.0, 3.0))
    live.take_fit(fitted(force=5.0, error=2.0))  # no reference: the model does not fit
    live.set_effects(["support_tilt"])
    assert live.known is None  # nothing has changed
    live.set_effects([])
    live.monitor.alarm = told_change()
    live.advance(0.09)
    assert live.known is None
    live.set_effects(["support_tilt"])
    assert_allclose(np.exp(live.known.values[:2]), [3.0, 1.2])
    assert_allclose(live.known.covariance, fitted().covariance)


def test_another_outline_is_another_object():
    live = seen()
    live.take_fit(fitted())
    assert not live.set_outline(BLOCK + 1e-6)
    assert live.fit is not None
    assert live.set_outline(1.2 * BLOCK)
    assert live.fit is None
    assert live.properties() is None


def test_other_effects_are_fitted_to_what_was_measured():
    live = seen()
    live.add_contact(measured(0.05, 3.0))
    assert live.due(2.0) is not None
    assert live.due(2.0) is None
    live.take_fit(fitted())
    live.set_effects(["support_tilt"])
    assert live.properties().source != "fit"
    assert live.due(2.0) is not None
    with pytest.raises(BadInputError, match="no_such"):
        live.set_effects(["no_such"])
    assert live.effects == ("support_tilt",)


def test_a_filter_that_breaks_begins_anew_and_is_counted(monkeypatch):
    live = seen()

    def broken(tracker, ends, step):
        raise np.linalg.LinAlgError("Singular matrix")

    with monkeypatch.context() as patched:
        patched.setattr(type(live.tracker), "_take", broken)
        for k in range(10, 20):
            live.add_pose(0.01 * k, np.array([0.5, 0.0, 0.3]), STD)
        live.advance(0.18)
    assert live.tracker.problems["filter_restarted"] > 0
    assert np.isfinite(live.tracker.filter.parameters[0]).all()
    assert live.properties().source == "nothing"
