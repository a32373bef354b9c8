"""A model with effects, live: fitted to the last measurements as a recording is."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_recording import held_box

from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, RecentFit, judge_estimate
from tactile_dynamics_ros.core.inertia.live.refit import RefitConfig, RefittedModel, fit_live
from tactile_dynamics_ros.core.streams.streams import ContactSample


def feed(model, streams, start=0.0, stop=np.inf):
    """Give a model what was measured between two times."""
    pose = streams.pose
    for k in np.flatnonzero((pose.time >= start) & (pose.time < stop)):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation[k], pose.position[k]
        model.window.add_pose(float(pose.time[k]), matrix, pose.covariance[k])
        for name, c in streams.contacts.items():
            place = c.position[k], c.rotation[k]
            std = None if c.force_std is None else c.force_std[k]
            sample = ContactSample(float(c.time[k]), name, *place, c.force[k], std=std)
            model.window.add_contact(sample)


@pytest.fixture(scope="module")
def streams():
    return held_box(seconds=6.0).streams


@pytest.fixture(scope="module")
def fit(streams):
    model = RefittedModel()
    model.set_effects(["viscous_drag"])
    feed(model, streams)
    return fit_live(*model.begin())


def test_live_says_what_the_recording_says(streams, fit):
    offline = estimate(streams, create_effects(["viscous_drag"])).to_estimate()
    np.testing.assert_allclose(
        fit.inertia.dynamic_parameters, offline.inertia.dynamic_parameters, rtol=1e-9
    )
    np.testing.assert_allclose(fit.covariance, offline.covariance, rtol=1e-9)
    assert fit.effects["viscous_drag"].value == pytest.approx(offline.effects["viscous_drag"].value)
    assert fit.time == pytest.approx(streams.pose.time[-1], abs=0.2)
    assert len(fit.directions) == 10
    assert 0.9 < fit.recent.explained <= 1.0


def test_a_fit_is_due_where_something_new_has_come(streams):
    model = RefittedModel()
    feed(model, streams, stop=1.0)
    assert not model.is_due
    model.set_effects(["viscous_drag"])
    assert not model.is_due, "a second of motion tells nothing"
    feed(model, streams, start=1.0, stop=4.0)
    assert model.is_due
    model.begin()
    assert not model.is_due
    feed(model, streams, start=4.0)
    assert model.is_due


def test_a_fit_of_another_model_or_of_what_was_forgotten_is_dropped(streams, fit):
    model = RefittedModel()
    model.set_effects(["viscous_drag"])
    feed(model, streams)
    model.take(["force_bias"], fit)
    assert model.newest_fit is None
    model.take(["viscous_drag"], fit)
    assert model.newest_fit is fit
    model.clear()
    assert model.newest_fit is None
    model.take(["viscous_drag"], fit)
    assert model.newest_fit is None


def test_only_the_last_seconds_are_kept(streams):
    model = RefittedModel(RefitConfig(history=5.0))
    feed(model, streams)
    assert model.window.span == pytest.approx(5.0, abs=0.011)


def test_unknown_and_repeated_effects_are_refused_and_change_nothing():
    model = RefittedModel()
    model.set_effects(["viscous_drag"])
    for names, word in ((["magic"], "unknown"), (["force_bias"] * 2, "more than once")):
        with pytest.raises(BadInputError, match=word):
            model.set_effects(names)
    assert model.effects == ("viscous_drag",)


@pytest.mark.parametrize(
    ("recent", "level", "text"),
    [
        (RecentFit(1.1, 1.0), Level.OK, "10 of 10"),
        (RecentFit(3.2, 0.99), Level.WARN, "error 3.2 times the noise; call /model_check/diagnose"),
        (RecentFit(3.2, 0.2), Level.ERROR, "does not fit"),
        (RecentFit(120.0, 0.99), Level.ERROR, "error 120 times"),
    ],
)
def test_the_status_says_how_far_the_model_is_off(fit, recent, level, text):
    verdict = judge_estimate(replace(fit, recent=recent), [], "/model_check/diagnose")
    assert verdict.level is level
    assert text in verdict.text
    assert verdict.withheld == (level is Level.ERROR)


def test_the_first_samples_are_judged_by_what_is_grossly_wrong_alone(fit):
    early = replace(fit, samples=20)
    judged = [
        judge_estimate(replace(early, recent=recent), [], "").level
        for recent in (RecentFit(3.2, 0.99), RecentFit(3.2, 0.2), RecentFit(120.0, 0.99))
    ]
    assert judged == [Level.OK, Level.ERROR, Level.ERROR]


def test_obstacles_withhold_whatever_the_fit(fit):
    verdict = judge_estimate(fit, ["two publishers on object/pose"], "")
    assert verdict.withheld
    assert "two publishers" in verdict.text


def test_the_zero_of_a_single_sensor_is_always_fitted(streams):
    model = RefittedModel()
    assert model.effects == ()
    wrist = replace(streams, contacts={"wrist": next(iter(streams.contacts.values()))})
    feed(model, wrist)
    assert model.effects == ("force_bias",)
    assert model.is_due
    model.set_effects(["viscous_drag"])
    assert model.effects == ("force_bias", "viscous_drag")
    model.set_effects(["force_bias", "viscous_drag"])
    assert model.effects == ("force_bias", "viscous_drag")
    feed(model, streams)
    model.set_effects([])
    assert model.effects == (), "several fingers have no zero that is never known"
