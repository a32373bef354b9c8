"""The live page: what it draws, that it only shows, and who gets in."""

import socket
from argparse import Namespace
from http.client import HTTPConnection
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest
from browser import chromium
from synthetic_recording import held_box

pytest.importorskip("viser")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tactile_dynamics_ros.cli.view import Control, served
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.share import share_file
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate
from tactile_dynamics_ros.view.page import METRES_PER_NEWTON, LivePage
from tactile_dynamics_ros.view.playback import Playback
from tactile_dynamics_ros.view.state import (
    KEPT,
    Body,
    Force,
    History,
    Push,
    Quantity,
    State,
    error_columns,
    take_diagnosis,
)


def held_state():
    """An object in two fingers."""
    state = State(object_pose=pose_of((0.4, 0.0, 0.5), (0, 0, 0)), verdict="Drag is missing.")
    state.body = Body(Quantity(0.4321, 0.0012), np.array([0.01, 0, 0]), np.array([2e-3, 1e-3, 0]))
    for name, x in (("index", 0.43), ("thumb", 0.37)):
        force = Force(np.array([x, 0, 0.5]), np.array([0.4 - x, 0.0, 0.05]) * 40, np.full(3, 0.1))
        state.forces[name] = force
    return state


@pytest.fixture
def page():
    made = LivePage("127.0.0.1", 0)
    yield made
    made.close()


def test_the_scene_has_object_arrows_and_ellipsoid_where_they_are(page):
    state = held_state()
    page.show(state)
    assert {"/object", "/object/centre_of_mass", "/contacts/index/force"} <= page.nodes
    index = state.forces["index"]
    start, tip = page.drawn("/contacts/index/force").points[0]
    np.testing.assert_allclose(start, index.point, atol=1e-6)
    np.testing.assert_allclose(tip - start, METRES_PER_NEWTON * index.force, atol=1e-6)
    ellipsoid = page.drawn("/object/centre_of_mass")
    np.testing.assert_allclose(ellipsoid.position, state.body.com)
    np.testing.assert_allclose(ellipsoid.scale[:2], [2e-3, 1e-3])
    del state.forces["thumb"]
    page.show(state)
    assert "/contacts/thumb/force" not in page.nodes


def test_the_robot_of_a_urdf_follows_its_joints(page):
    state = held_state()
    state.urdf = share_file("config/robots/allegro_iiwa.urdf").read_text()
    page.show(state)
    assert "/robot" in page.nodes


def test_without_control_nothing_can_be_pressed(page):
    assert page.buttons == []


def test_a_history_keeps_a_minute_and_forgets_a_time_that_is_set_back():
    history = History()
    for k in range(KEPT + 50):
        history.add(0.1 * k, k, 1.0)
    time, value, low, high = history.columns()
    assert len(time) == KEPT and value[-1] == KEPT + 49
    np.testing.assert_array_equal(high - low, 2.0)
    history.add(1.0, 5.0)
    assert history.columns().shape == (4, 1)


def test_the_wide_bands_of_the_beginning_do_not_hide_the_later_ones():
    history = History()
    for k in range(100):
        history.add(0.1 * k, 0.4, 5.0 if k < 10 else 0.01)
    _, _, low, high = history.columns()
    assert high[0] - low[0] < 0.2 and high[-1] - low[-1] == pytest.approx(0.02)


def test_a_recording_plays_with_its_estimate():
    recording = held_box()
    state = Playback(recording).at(3.0)
    pose = recording.streams.pose
    k = np.abs(pose.time - pose.time[0] - 3.0).argmin()
    np.testing.assert_allclose(state.object_pose[:3, 3], pose.position[k])
    assert set(state.forces) == {"index", "middle", "ring", "thumb"}
    assert abs(state.body.mass.value - 0.4) < 0.02
    assert "fits" in state.remark
    assert len(state.histories["load"].columns()[0]) == KEPT


def test_the_error_of_a_recording_has_its_floor_and_where_an_effect_acts_until_it_is_added():
    options = ScenarioOptions(duration=8.0)
    streams = generate(3, {"viscous_drag": 4.0}, options).streams
    played = Playback(Recording(streams, "made"))
    before, first = played.at(0.0).error, played.at(0.0).histories["error"].columns()
    assert before > 1.5 and not played.at(0.0).good
    assert first[1].mean() == pytest.approx(before, rel=0.2)
    assert "viscous" in played.diagnose() and played.at(0.0).missing[0] == "viscous_drag"
    played.add("viscous_drag")
    state = played.at(0.0)
    assert state.effects == ("viscous_drag",) and state.missing == ()
    assert state.error < 1.2 and state.histories["error"].columns()[1].mean() < 1.2
    assert "not added" in played.add("no_such_effect") and state.effects == ("viscous_drag",)


def test_the_regime_in_which_a_drag_acts_is_shaded_where_it_acts():
    options = ScenarioOptions(duration=10.0)
    streams = generate(3, {}, options).streams
    for contact in streams.contacts.values():
        contact.force[contact.time > contact.time[0] + 6.0, 0] += 0.4
    played = Playback(Recording(streams, "made"))
    played.diagnose()
    shaded = [*played.at(0.0).regimes, *played.at(0.0).failing]
    inside = sum(max(0.0, min(b, 10.0) - max(a, 6.0)) for a, b in shaded)
    assert inside > 0.6 * sum(b - a for a, b in shaded) > 0.0


@pytest.mark.parametrize(
    ("pushed", "estimator", "offered"),
    [
        (False, "inertial_estimator", "sloshing_mass"),
        (True, "property_estimator", "support_tilt"),
    ],
)
def test_live_an_effect_joins_those_of_the_estimator_that_runs(
    monkeypatch, pushed, estimator, offered
):
    asked, chosen, adding = [], [], []
    state = State(effects=("force_bias",), pushed=pushed, error=1.9)

    def set_parameter(*what):
        asked.append(what)
        state.effects = state.fitted = tuple(what[3])
        state.error = 1.1

    monkeypatch.setattr("tactile_dynamics_ros.cli.topics.set_parameter", set_parameter)
    control = Control(Namespace(create_publisher=lambda *_: None), state)
    page = Namespace(add_choice=lambda *what: chosen.append(what), allow_adding=adding.append)
    control.add_effects(page)
    assert asked == []
    assert offered in chosen[0][1]
    said = adding[0]("tether_spring")
    assert asked[0][1:4] == (estimator, "effects", ["force_bias", "tether_spring"])
    assert said == (
        "tether_spring is added: error 1.90 -> 1.10"
        if pushed
        else "effects of the model: force_bias, tether_spring"
    )


def test_a_fit_with_an_added_effect_that_came_to_no_end_is_said(monkeypatch):
    state = State(pushed=True, error=1.9)

    def set_parameter(*what):
        state.effects, state.refused = tuple(what[3]), "it slides too little"

    monkeypatch.setattr("tactile_dynamics_ros.cli.topics.set_parameter", set_parameter)
    control = Control(Namespace(create_publisher=lambda *_: None), state)
    assert control.add("support_tilt").endswith("without a fit: it slides too little")


def test_a_diagnosis_offers_what_it_names_its_floor_and_when_it_acts():
    found = {"noise_floor": 0.97, "effect": "", "group": "force_bias,unsensed_contact"}
    found |= {"regime": "[[12.0, 14.0]]", "failing": "[]"}
    state = State()
    take_diagnosis(state, [status_message("diagnosis", found, message="one of two")], 10.0)
    assert state.missing == ("force_bias", "unsensed_contact") and state.floor == 0.97
    assert state.regimes == ((2.0, 4.0),) and state.failing == ()
    take_diagnosis(state, [status_message("diagnosis", {"effect": "viscous_drag[z<0.42]"})])
    assert state.missing == ("viscous_drag[z<0.42]",) and state.floor == 1.0


def test_the_chart_of_the_error_has_its_floor_and_shades_between_its_points():
    state = State(floor=0.9, regimes=((102.0, 104.0),), failing=((106.0, 107.0), (109.0, 120.0)))
    for time, error in ((100.0, 2.0), (105.0, 2.0), (108.0, 2.0), (110.0, 1.0)):
        state.note("error", time, error)
    history = state.histories["error"]
    assert list(history.columns()[0]) == [0.0, 8.0, 10.0]  # a value that stays is two points
    assert history.columns()[1].max() == 2.0  # and is not cut off
    time, error, _, _, floor, regime, fails = error_columns(history, state)
    np.testing.assert_array_equal(floor, 0.9)
    np.testing.assert_allclose(error, np.interp(time, [0.0, 8.0, 10.0], [2.0, 2.0, 1.0]))
    for shade, spans in ((regime, [(2, 4)]), (fails, [(6, 7), (9, 10)])):
        inside = np.any([(time >= a) & (time <= b) for a, b in spans], axis=0)
        np.testing.assert_array_equal(shade, 2.0 * inside)
        area = np.diff(time) @ (shade[1:] + shade[:-1]) / 2.0
        assert area == pytest.approx(2.0 * sum(b - a for a, b in spans), abs=0.01)
    assert not error_columns(history, State())[-1].any()
    assert error_columns(History(), state)[0].size == 0


def get(address, **headers):
    """Status and body of a request, redirects not followed."""
    where = urlsplit(address)
    connection = HTTPConnection(where.hostname, where.port, timeout=20)
    connection.request("GET", f"{where.path}?{where.query}", headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.getheader("Set-Cookie", "").split(";")[0], answer.read()


def test_only_the_token_opens_the_door(page):
    plain = page.address.split("?")[0]
    for wrong in (plain, f"{plain}?token=guess"):
        assert get(wrong)[0] == 403
    status, cookie, _ = get(page.address)
    assert status == 303
    name, _, _ = cookie.partition("=")
    assert get(plain, Cookie=f"{name}=guess")[0] == 403
    status, _, text = get(plain, Cookie=cookie)
    assert status == 200 and b"<html" in text


def test_no_other_site_gets_in_though_it_has_the_token(page):
    plain = page.address.split("?")[0]
    _, cookie, _ = get(page.address)
    port = urlsplit(plain).port
    assert get(plain, Cookie=cookie, Origin="http://evil.example")[0] == 403
    assert get(plain, Cookie=cookie, Host=f"evil.example:{port}")[0] == 403
    assert get(plain, Cookie=cookie, Origin=plain.rstrip("/"))[0] == 200


def listening():
    """TCP ports of this process."""
    found = psutil.Process().net_connections("tcp")
    return {c.laddr.port for c in found if c.status == "LISTEN"}


def test_every_port_of_a_page_asks_websockets_too():
    """No server behind the page can be reached by those who look for its port."""
    before = listening()
    page = LivePage("127.0.0.1", 0)
    plain = urlsplit(page.address)
    assert plain.port in listening()
    _, cookie, _ = get(page.address)
    for port in listening() - before:
        for headers in ({}, {"Origin": "http://evil.example", "Cookie": cookie}):
            with pytest.raises(InvalidStatus) as refused:
                connect(f"ws://127.0.0.1:{port}/", additional_headers=headers)
            assert refused.value.response.status_code == 403
    with connect(f"ws://{plain.netloc}/", additional_headers={"Cookie": cookie}):
        page.close()


@pytest.mark.parametrize("target", ["http://[::1/", "//[/", "*", "http://evil.example/"])
def test_a_target_that_is_none_is_refused(page, target, capfd):
    with socket.create_connection(("127.0.0.1", urlsplit(page.address).port)) as door:
        door.sendall(f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        assert door.recv(100).startswith(b"HTTP/1.1 400")
    with socket.create_connection(("127.0.0.1", urlsplit(page.address).port)) as door:
        door.sendall(b"\x16\x03\x01 no HTTP\r\n\r\n")
        door.recv(100)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("control", [False, True])
def test_the_address_lets_in_and_only_control_has_buttons(control, capsys):
    args = Namespace(host="127.0.0.1", port=0, control=control, json=False)
    with served(args, {"Diagnose": lambda: "done"} if control else None) as page:
        assert capsys.readouterr().out == f"page: {page.address}\n"
        assert len(page.buttons) == control


def test_a_browser_shows_the_verdict_and_asks(tmp_path, capsys):
    args = Namespace(host="127.0.0.1", port=0, control=True, json=False)
    with chromium(tmp_path) as browser, served(args, {"Diagnose": lambda: "It slips."}) as page:
        page.show(held_state())
        browser.open(capsys.readouterr().out.split()[-1])
        browser.wait_for("Drag is missing.")
        browser.wait_for("432.1 ± 1.2 g")
        assert browser.value("document.querySelector('canvas') !== null")
        browser.click("Diagnose")
        browser.wait_for("It slips.")
        missing = held_state()
        missing.missing, added = ("viscous_drag",), []
        page.show(missing)
        assert "Add viscous_drag" not in browser.text  # nobody said how
        page.allow_adding(lambda name: added.append(name) or "It is in the model.")
        page.show(missing)
        for answer, after in (("No", []), ("Yes, add it", ["viscous_drag"])):
            browser.wait_for("Add viscous_drag ...")
            browser.click("Add viscous_drag ...")
            browser.wait_for("Add viscous_drag to the model?")
            assert added == []  # not before it is confirmed
            browser.click(answer)
            browser.wait_until("!document.body.innerText.includes('to the model?')")
            assert added == after
        browser.wait_for("It is in the model.")
        missing.effects = ("viscous_drag",)
        page.show(missing)
        browser.wait_until("!document.body.innerText.includes('Add viscous_drag')")
        pushed = State(object_pose=pose_of((0.4, 0.0, 0.0), (0, 0, 0)), footprint=np.eye(3)[:, :2])
        pushed.pushes = (Push(np.array([0.4, 0.1]), np.array([0.0, 1.0]), 0.06, 5.5),)
        pushed.numbers, pushed.plan = {"friction force": "2.01 ± 0.01 N"}, "pushing: it tells most"
        page.show(pushed)
        browser.wait_for("pushing: it tells most")
        browser.wait_for("2.01 ± 0.01 N")
