"""Every reader of a status copes with an estimate that is withheld, or not there yet."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from synthetic_recording import held_box

from tactile_dynamics_ros.cli.demo_monitor import Monitor
from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, Verdict
from tactile_dynamics_ros.core.inertia.live.refit import fit_live
from tactile_dynamics_ros.ros.inertia_status import (
    read_inertia_status,
    status_of,
    waiting_status,
)
from tactile_dynamics_ros.share import share_file

EFFECTS = ("viscous_drag",)


@pytest.fixture(scope="module")
def fit():
    return fit_live(held_box(seconds=6.0).streams, EFFECTS)


@pytest.fixture(scope="module")
def held(fit):
    """Statuses as inertial_estimator makes them, by the state that it is in."""
    return {
        "none": [],
        "waiting": waiting_status(EFFECTS, "fitting viscous_drag to the last 40 s"),
        "withheld": status_of(fit, EFFECTS, Verdict(Level.ERROR, "the model does not fit")),
        "known": status_of(fit, EFFECTS, Verdict(Level.OK, "10 of 10 directions identified")),
    }


def message(statuses, stamp):
    array = DiagnosticArray(status=list(statuses))
    array.header.stamp.sec = stamp
    return array


def test_what_is_read_is_what_was_written_and_nothing_else(held, fit):
    known = read_inertia_status(held["known"])
    assert (known.known, known.good, known.effects) == (True, True, EFFECTS)
    assert known.samples == fit.samples
    assert known.error == pytest.approx(fit.error.whitened_rms)
    assert known.value[0] == pytest.approx(fit.inertia.mass)
    assert known.std == pytest.approx(fit.parameter_std)
    withheld = read_inertia_status(held["withheld"])
    assert (withheld.known, withheld.good, withheld.samples) == (False, False, fit.samples)
    assert withheld.text == "the model does not fit"
    waiting = read_inertia_status(held["waiting"])
    assert (waiting.known, waiting.samples, waiting.effects) == (False, 0, EFFECTS)
    nothing = read_inertia_status(held["none"])
    assert (nothing.known, nothing.good, nothing.effects, nothing.text) == (False, False, (), "")


def test_the_demo_shows_why_there_is_no_estimate_and_goes_on(held):
    said = []
    monitor = Monitor(said.append, share_file(DEFAULT_CONFIG))
    try:
        for second, state in enumerate(["none", "withheld", "known", "waiting", "withheld"]):
            monitor._last_line = 0.0
            monitor._on_status(message(held[state], 10 + second))
    finally:
        monitor.close()
    shown = [line.split(": ", 1)[1] for line in said]
    assert shown[1] == "no estimate: the model does not fit"
    assert shown[2].startswith("mass ")
    assert shown[3] == "no estimate: fitting viscous_drag to the last 40 s"
    assert list(monitor.history().time) == [12.0]
    assert monitor.seconds_of_data == 3.0, "what is withheld was measured all the same"
