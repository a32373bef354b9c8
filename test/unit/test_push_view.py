"""The live page of a pushed object: what nodes say is shown, recordings are scrubbed."""

from concurrent.futures import Future
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

pytest.importorskip("viser")

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.view import push_playback
from tactile_dynamics_ros.view.page import LivePage
from tactile_dynamics_ros.view.state import (
    State,
    take_diagnosis,
    take_markers,
    take_progress,
    take_property_status,
)

BLOCK = np.array([[-0.05, -0.03], [0.05, -0.03], [0.05, 0.03], [-0.05, 0.03]])


def status(name, message="", level=b"\0", **values):
    pairs = [SimpleNamespace(key=key, value=str(value)) for key, value in values.items()]
    return SimpleNamespace(name=name, message=message, level=level, values=pairs)


def properties(force=2.0, undetermined="mass,friction"):
    told = {"friction_force_n": force, "friction_force_n_std": 0.04, "mass": 0.7, "mass_std": 0.3}
    told |= {"com_x": 0.01, "com_x_std": 1e-3, "com_y": 0.0, "com_y_std": 2e-3}
    link = status("link_1", "known as a product", b"\1", **told, undetermined=undetermined)
    return [link, status("solver", whitened_rms=1.2)]


PUSHING = status(
    "explorer",
    "it narrows mass most",
    state="pushing",
    point="[0.5, 0.1]",
    direction="[0.0, 1.0]",
    length="0.05",
    expected_gain="5.5",
    rivals='[{"point": [0.4, 0.1], "direction": [1.0, 0.0], "length": 0.05, "expected_gain": 3}]',
)


def test_what_is_undetermined_is_shown_as_that():
    state = State()
    take_property_status(state, 3.0, properties())
    assert state.numbers["friction force"] == "2.000 ± 0.040 N"
    assert state.numbers["mass"] == "undetermined (700 ± 300 g)"
    assert state.numbers["centre of mass x"] == "10.0 ± 1.0 mm"
    assert (state.remark, state.good, state.error) == ("known as a product", False, 1.2)
    assert_allclose(state.centre[0], [0.01, 0.0, 0.0])
    take_property_status(state, 4.0, properties(2.5, "com"))
    assert state.centre is None
    assert_allclose(state.histories["friction_force_n"].columns()[1], [2.0, 2.5], atol=0.51)


def test_a_verdict_that_something_is_missing_is_no_good_news():
    page = LivePage("127.0.0.1", 0)
    try:
        state = State()
        take_diagnosis(state, [status("diagnosis", "the table leans", b"\1")])
        page.show(state)
        assert "the table leans" in page._verdict.content
        told = page._verdict.content
        take_diagnosis(state, [status("diagnosis", "nothing is missing", b"\0")])
        page.show(state)
        assert told.split(";")[0] != page._verdict.content.split(";")[0]
    finally:
        page.close()


def test_a_push_and_its_rivals_are_arrows_while_it_is_made():
    page = LivePage("127.0.0.1", 0)
    try:
        state = State(object_pose=pose_of((0.5, 0.15, 0.0), (0, 0, 0)), footprint=BLOCK)
        take_progress(state, PUSHING)
        page.show(state)
        assert {"/pushes/0", "/pushes/1", "/object/footprint"} <= page.nodes
        back, tip = page.drawn("/pushes/0").points[0]
        assert_allclose(tip[:2], [0.5, 0.1], atol=1e-6)
        assert_allclose(tip - back, [0.0, 0.05, 0.0], atol=1e-6)
        assert state.plan == "pushing: it narrows mass most"
        take_progress(state, status("explorer", "simulating pushes", state="choosing"))
        page.show(state)
        assert not [name for name in page.nodes if name.startswith("/pushes/")]
    finally:
        page.close()


def test_both_parts_of_a_pushed_object_are_shown_where_they_lie():
    pytest.importorskip("rclpy")
    from geometry_msgs.msg import Point32, PolygonStamped, PoseWithCovarianceStamped

    from tactile_dynamics_ros.view.live import LiveSource

    node = SimpleNamespace(create_subscription=lambda _, topic, *__, **___: topic)
    source = LiveSource(node)
    take = dict(source._subscriptions)
    for place, link in ((0.5, "object"), (0.6, "object/link_2")):
        outline, pose = PolygonStamped(), PoseWithCovarianceStamped()
        outline.polygon.points = [Point32(x=float(x), y=float(y)) for x, y in BLOCK]
        pose.pose.pose.position.x, pose.pose.pose.orientation.w = place, 1.0
        take[f"{link}/footprint"](outline)
        take[f"{link}/pose"](pose)
    page = LivePage("127.0.0.1", 0)
    try:
        page.show(source.state)
        assert {"/object/footprint", "/second/footprint"} <= page.nodes
        assert_allclose(page.drawn("/second").position, [0.6, 0.0, 0.0])
        assert_allclose(page.drawn("/object").position, [0.5, 0.0, 0.0])
    finally:
        page.close()


def test_the_surface_moves_with_the_object():
    page = LivePage("127.0.0.1", 0)
    try:
        state = State(object_pose=pose_of((0.5, 0.0, 0.0), (0, 0, 0)))
        corner = SimpleNamespace(x=0.5, y=0.0, z=0.1)
        take_markers(state, [SimpleNamespace(type=11, action=0, points=[corner] * 3)])
        state.object_pose = pose_of((0.5, 0.2, 0.0), (0, 0, 0))
        page.show(state)
        assert_allclose(page.drawn("/shape").position, [0.0, 0.2, 0.0])
    finally:
        page.close()


def recording(folder):
    """Two pushes, from 1 to 2 and from 3 to 4 s, of a block that moves along x."""
    time = np.arange(0.0, 5.0, 0.1)
    pose = np.column_stack([0.5 + 0.01 * time, np.zeros((len(time), 2))])
    pushing = ((time >= 1.0) & (time < 2.0)) | ((time >= 3.0) & (time < 4.0))
    force = np.outer(pushing, [2.0, 0.0, 0.0])
    point = np.column_stack([pose[:, 0] - 0.05, np.zeros(len(time)), np.full(len(time), 0.02)])
    normal = np.tile([1.0, 0.0, 0.0], (len(time), 1))
    contact = PushContact("pusher", time, force, np.full(3, 0.03), time, point, normal)
    streams = PushedStreams((LinkStream(time, pose, None, BLOCK),), {"pusher": contact})
    path = PushedRecording(streams, "made").to_bag(folder / "pushes")
    return PushedRecording.from_bag(path)


class Estimates:
    """Stands in for the process beside the page: answers at once, the second time not."""

    def __init__(self):
        self.lengths = []

    def submit(self, work, streams):
        self.lengths.append(streams.contacts["pusher"].time[-1])
        future = Future()
        if len(self.lengths) == 2:
            future.set_exception(NotIdentifiableError("slides too little"))
            return future
        names = ("mass", "friction", "friction_force_n", "com_x", "com_y", "friction_radius_m")
        values = {name: (float(len(self.lengths)), 0.1) for name in names}
        future.set_result(PushedEstimate(9, 1.0, values, ("mass",), np.eye(4), 1.0))
        return future

    def close(self):
        self.lengths.append("closed")


def test_a_recording_is_scrubbed_with_the_estimate_after_each_push(tmp_path, monkeypatch):
    estimates = Estimates()
    monkeypatch.setattr(push_playback, "Background", lambda: estimates)
    playback = push_playback.PushPlayback(recording(tmp_path))
    assert_allclose(estimates.lengths, [2.05, 4.05], atol=0.06)
    before, during, after = (playback.at(s) for s in (0.5, 3.05, 4.85))
    assert_allclose(during.object_pose[0, 3], 0.53, atol=2e-3)
    assert set(during.forces) == {"pusher"}
    assert not before.forces
    assert not before.numbers
    assert during.numbers["friction force"] == "1.00 ± 0.10 N"
    assert during.numbers["mass"].startswith("undetermined")
    assert (after.remark, after.good) == ("slides too little", False)
    playback.close()
    assert estimates.lengths[-1] == "closed"


def asked_of_pushes(recording, effects=()):
    """Stands in for an estimate: the error falls from 2 to 1 when the table leans."""
    if "friction_gradient" in effects:
        raise NotIdentifiableError("it slides too little")
    error = 1.0 if effects else 2.0
    linear = SimpleNamespace(times=np.array([0.5]))
    question = SimpleNamespace(whitened_rms=error, model=SimpleNamespace(linear=linear))
    values = {"friction_force_n": (2.0, 0.1), "mass": (0.5, 0.1)}
    found = PushedEstimate(9, 1.0, values, (), np.eye(4), error)
    return SimpleNamespace(question=question, found=found)


def test_an_effect_that_a_diagnosis_names_is_added_to_a_recording_and_its_error_falls(
    tmp_path, monkeypatch
):
    def compared(question):
        time = np.arange(0.0, 4.0, 0.1)
        return SimpleNamespace(
            answer=SimpleNamespace(intervals=((1.0, 2.0),) if question.whitened_rms > 1 else ()),
            error_over_time=lambda: (time, np.full(len(time), question.whitened_rms)),
            regime_spans=list,
        )

    document = {"group": ["support_tilt", "constant_pull"], "error": {"noise_floor": 0.9}}
    diagnosed = SimpleNamespace(
        effect="support_tilt",
        verdict="ambiguous",
        to_json=lambda: document | {"sentence": "the table leans"},
        findings=SimpleNamespace(regimes=[]),
    )
    monkeypatch.setattr(push_playback, "Background", Estimates)
    for name, answer in (
        ("EstimateOfPushes", asked_of_pushes),
        ("Comparison", compared),
        ("Diagnosis", lambda _: diagnosed),
    ):
        monkeypatch.setattr(push_playback, name, SimpleNamespace(of=answer))
    playback = push_playback.PushPlayback(recording(tmp_path))
    assert playback.diagnose() == "the table leans"
    state = playback.at(3.0)
    assert state.missing == ("support_tilt", "constant_pull") and not state.fits
    assert (state.error, state.floor, state.failing) == (2.0, 0.9, ((1.5, 2.5),))
    assert state.histories["error"].first == 0.5
    assert "not added: it slides too little" in playback.add("friction_gradient")
    assert playback.add("support_tilt") == "support_tilt is added: error 2.00 -> 1.00"
    state = playback.at(3.0)
    assert (state.effects, state.missing, state.error) == (("support_tilt",), (), 1.0)
    assert state.numbers["friction force"] == "2.00 ± 0.10 N"
    assert state.histories["error"].columns()[1].max() == 1.0 and state.failing == ()
