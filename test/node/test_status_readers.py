"""Every reader of a status copes with an estimate that is withheld, or not there yet."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from synthetic_recording import held_box

from benchmarks.replay.observations import read_status
from tactile_dynamics_ros.cli.demo_change import Act
from tactile_dynamics_ros.cli.demo_monitor import Monitor
from tactile_dynamics_ros.cli.demo_planar import Log
from tactile_dynamics_ros.cli.live import DEFAULT_CONFIG
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, Verdict
from tactile_dynamics_ros.core.inertia.live.refit import fit_live
from tactile_dynamics_ros.core.planar.diagnosis.changed import ChangeCheck
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce
from tactile_dynamics_ros.nodes.model_check import ModelCheckNode
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.names import PROPERTY_STATUS
from tactile_dynamics_ros.ros.object_state import ObjectState
from tactile_dynamics_ros.ros.statuses import (
    property_status,
    read_inertia_status,
    status_of,
    waiting_status,
)
from tactile_dynamics_ros.ros.table_scene import TableScene, TableSceneConfig
from tactile_dynamics_ros.share import share_file
from tactile_dynamics_ros.view.live import LiveSource
from tactile_dynamics_ros.view.state import State, take_property_status

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])
EFFECTS = ("viscous_drag",)
HELD, FOLLOWED = ObjectState("held", 1.0, "held"), ObjectState("followed", 1.0, "followed")


@pytest.fixture(scope="module")
def fit():
    return fit_live(held_box(seconds=6.0).streams, EFFECTS)


@pytest.fixture(scope="module")
def held(fit):
    """Statuses as inertial_estimator makes them, by the state that it is in."""
    return {
        "none": [],
        "waiting": waiting_status(EFFECTS, "fitting viscous_drag to the last 40 s"),
        "withheld": status_of(fit, EFFECTS, Verdict(Level.ERROR, "the model does not fit"), HELD),
        "known": status_of(fit, EFFECTS, Verdict(Level.OK, "10 of 10 directions identified"), HELD),
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
            for _ in range(2 if state == "known" else 1):  # repeated once a second, renewed or not
                monitor._on_status(message(held[state], 10 + second))
    finally:
        monitor.close()
    assert len(said) == 5
    assert said[1] == "  no estimate: the model does not fit"
    assert " samples: mass " in said[2]
    assert said[3] == "  no estimate: fitting viscous_drag to the last 40 s"
    assert list(monitor.history().time) == [12.0]
    assert monitor.seconds_of_data == 3.0, "what is withheld was measured all the same"


class Wire:
    """Stands for a node: keeps what readers subscribe with, and hands messages to them."""

    def __init__(self):
        self.taken = {}

    def create_subscription(self, kind, topic, callback, *_, **__):
        self.taken[topic] = callback

    def listen(self, kind, topic, callback, *_, **__):
        self.taken[topic] = callback


def test_the_page_shows_no_body_where_none_is_known(held):
    source = LiveSource(Wire())
    source._on_estimate(message(held["known"], 1))
    assert source.state.body.mass.value == pytest.approx(
        read_inertia_status(held["known"]).value[0]
    )
    assert source.state.good
    for state in ("withheld", "known", "waiting", "none"):
        source._on_estimate(message(held[state], 2))
        assert (source.state.body is None) == (state != "known")
        assert source.state.good == (state == "known")
        assert source.state.remark == read_inertia_status(held[state]).text


def test_the_replay_claims_nothing_where_nothing_is_known(held):
    told = {state: read_status(message(held[state], 1), 0.0) for state in held}
    assert [state for state, status in told.items() if status.has_interval] == ["known"]
    assert told["withheld"].samples == told["known"].samples > told["waiting"].samples == 0


def pushed(touched=False):
    """Statuses as property_estimator makes them, of an object that was seen or touched."""
    live = LiveProperties()
    live.set_outline(BLOCK)
    for k in range(20):
        live.add_pose(0.01 * k, np.array([0.5, 0.0, 0.3]), np.array([5e-4, 5e-4, 3e-3]))
        if touched:
            force, std, point = np.array([1.0, 0, 0]), np.full(3, 0.03), np.array([-0.05, 0, 0.02])
            live.add_contact(
                ContactForce("pusher", 0.01 * k, force, std, point, np.array([1.0, 0, 0]))
            )
    live.advance(0.18)
    return property_status(live.properties(), live, FOLLOWED)


@pytest.mark.parametrize("reader", ["view", "scene", "act", "log"])
def test_readers_of_a_pushed_object_take_any_status_with_any_entry_missing(reader):
    wire, state = Wire(), State()
    read = {
        "view": lambda: lambda told: take_property_status(state, 0.0, told.status),
        "scene": lambda: TableScene(wire, TableSceneConfig(), lambda: None),
        "act": lambda: Act(wire, None, None, print),
        "log": lambda: Log(wire),
    }[reader]()
    take = wire.taken.get(PROPERTY_STATUS, read)
    whole = pushed() + pushed(touched=True)
    for statuses in (pushed(), pushed(touched=True), []):
        take(message(statuses, 1))
    whole[0].values[-1].value = ""  # all is known
    for status in whole:
        take(message([other for other in whole if other.name != status.name], 1))
        for pair in status.values:
            left = [other for other in status.values if other.key != pair.key]
            take(message([status_message(status.name, {p.key: p.value for p in left})], 1))


def test_what_a_check_asks_about_is_a_rigid_body_where_no_effect_is_said(held):
    node = SimpleNamespace(
        check=SimpleNamespace(effects=()), _model=SimpleNamespace(change=ChangeCheck())
    )
    for state, effects in (
        ("known", EFFECTS),
        ("waiting", EFFECTS),
        ("withheld", EFFECTS),
        ("none", ()),
    ):
        ModelCheckNode._on_model(node, message(held[state], 1))
        assert node.check.effects == effects
        assert node._model.change.since == -np.inf
