"""The live page: what it draws, that it only shows, and who gets in."""

import urllib.error
import urllib.request
from argparse import Namespace

import numpy as np
import pytest
from browser import chromium
from synthetic_recording import held_box

pytest.importorskip("viser")

from tactile_dynamics_ros.cli.view import served
from tactile_dynamics_ros.core.rigid_body.poses import pose_of
from tactile_dynamics_ros.share import share_file
from tactile_dynamics_ros.view.gate import Gate
from tactile_dynamics_ros.view.page import METRES_PER_NEWTON, LivePage
from tactile_dynamics_ros.view.playback import Playback
from tactile_dynamics_ros.view.state import KEPT, Body, Force, History, Push, Quantity, State


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


def get(address, cookie=""):
    request = urllib.request.Request(address, headers={"Cookie": cookie} if cookie else {})
    return urllib.request.urlopen(request, timeout=20)


def test_only_the_token_opens_the_door(page):
    gate = Gate("127.0.0.1", 0, page.port, "secret")
    try:
        address = f"http://127.0.0.1:{gate.port}/"
        for wrong in (address, f"{address}?token=guess"):
            with pytest.raises(urllib.error.HTTPError) as refused:
                get(wrong)
            assert refused.value.code == 403
        with pytest.raises(urllib.error.HTTPError) as refused:
            get(address, "tactile_dynamics=guess")
        assert refused.value.code == 403
        with get(address, "tactile_dynamics=secret") as answer:
            assert b"<html" in answer.read()
    finally:
        gate.close()


@pytest.mark.parametrize(
    ("host", "control", "guarded"),
    [("127.0.0.1", False, False), ("127.0.0.1", True, True), ("0.0.0.0", False, True)],
)
def test_control_and_other_machines_need_a_token(host, control, guarded, capsys):
    args = Namespace(host=host, port=0, control=control, json=False)
    with served(args, {"Diagnose": lambda: "done"} if control else None) as page:
        said = capsys.readouterr().out
        assert ("?token=" in said) == guarded
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
        pushed = State(object_pose=pose_of((0.4, 0.0, 0.0), (0, 0, 0)), footprint=np.eye(3)[:, :2])
        pushed.pushes = (Push(np.array([0.4, 0.1]), np.array([0.0, 1.0]), 0.06, 5.5),)
        pushed.numbers, pushed.plan = {"friction force": "2.01 ± 0.01 N"}, "pushing: it tells most"
        page.show(pushed)
        browser.wait_for("pushing: it tells most")
        browser.wait_for("2.01 ± 0.01 N")
