"""Statuses of estimates: keys are unique over a message, and what is not of now is not OK."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from synthetic_recording import held_box
from test_live_properties import fitted, measured, seen

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import EffectEstimate
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, Verdict
from tactile_dynamics_ros.core.inertia.live.refit import fit_live
from tactile_dynamics_ros.core.planar.filter.change import Change
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.object_state import ObjectState
from tactile_dynamics_ros.ros.statuses import property_status, status_of, waiting_status

HELD = ObjectState("held", 3.0, "held")
FOLLOWED = ObjectState("followed", 3.0, "followed, not touched")
LEFT = ObjectState("nothing held", 76.0, "nothing held since 76 s")
GOOD = Verdict(Level.OK, "10 of 10 directions identified")


def repeated(*statuses):
    """Keys that occur more than once."""
    keys = Counter(pair.key for status in statuses for pair in status.values)
    return [key for key, count in keys.items() if count > 1]


@pytest.fixture(scope="module")
def estimate():
    one = {name: EffectEstimate({"mass": 1.0}, {"mass": 0.1}, {"mass": "kg"}) for name in "ab"}
    return replace(fit_live(held_box(seconds=3.0).streams, []), effects=one)


def test_keys_of_a_held_object_are_unique(estimate):
    statuses = status_of(estimate, ("a", "b"), GOOD, HELD)
    assert repeated(HELD.status(0.1), *statuses) == []
    assert repeated(LEFT.status(0.1), *waiting_status(("a",), "waits")) == []
    values = {key: value for s in statuses for key, value in status_values(s).items()}
    assert float(values["mass"]) == pytest.approx(estimate.inertia.mass)
    gains = {d.name: d.gain for d in estimate.directions}
    assert float(values["mass_gain"]) == pytest.approx(gains["mass"])
    assert (values["a.mass"], values["b.mass_std"]) == ("1", "0.1")


def test_keys_of_a_pushed_object_are_unique():
    live = seen()
    live.add_contact(measured(0.05, 3.0))
    live.set_effects(["support_tilt", "viscous_support"])
    entry = {"mass": {"value": 1.0, "std": 0.1, "unit": ""}}
    fit = replace(fitted(), effects=dict.fromkeys(live.effects, entry), error_without=2.0)
    live.take_fit(fit)
    live.changed = Change(30.0, 20.0, 1.0, np.array([0.1, 0.2]), 0.5, 3.0)
    for known in (live.properties(), None):
        assert repeated(FOLLOWED.status(0.1), *property_status(known, live, FOLLOWED)) == []


def test_an_estimate_of_the_last_grasp_is_not_ok_and_says_so(estimate):
    now, then = (status_of(estimate, (), GOOD, state)[0] for state in (HELD, LEFT))
    assert (now.level, now.message) == (DiagnosticStatus.OK, GOOD.text)
    assert then.level == DiagnosticStatus.WARN
    assert then.message == f"nothing held since 76 s; last grasp: {GOOD.text}"
    assert status_values(then) == status_values(now)
    withheld = Verdict(Level.ERROR, "two publishers")
    assert status_of(estimate, (), withheld, LEFT)[0].level == DiagnosticStatus.ERROR


def test_properties_of_an_object_that_is_not_followed_are_not_ok():
    live, lost = seen(), ObjectState("waiting", 12.0, "waiting for object/pose, silent since 12 s")
    live.take_fit(fitted(undetermined=()))
    now, then = (property_status(live.properties(), live, state)[0] for state in (FOLLOWED, lost))
    assert now.level == DiagnosticStatus.OK
    assert then.level == DiagnosticStatus.WARN
    assert then.message == f"{lost.text}; before: {now.message}"
    assert status_values(then) == status_values(now)


def test_before_the_object_was_seen_the_status_says_what_is_awaited():
    live, state = seen(), ObjectState("waiting", 2.0, "waiting for object/pose")
    link, solver = property_status(None, live, state)
    assert (link.level, link.message) == (DiagnosticStatus.WARN, state.text)
    assert status_values(link) == {}
    assert status_values(solver)["effects"] == ""
