"""Tables whose forces, torques or world are turned or mirrored are imported right at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.field import CASES, ask
from benchmarks.field_cases import (
    CORRUPTIONS,
    FAULTS,
    ZERO,
    corrupted,
    draw_change,
    draw_log,
    draw_static,
    heavier,
    write_log,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.conventions.finder import assumed
from tactile_dynamics_ros.core.inertia.conventions.poses import gravity_by_imu
from tactile_dynamics_ros.core.inertia.conventions.ranking import Readings
from tactile_dynamics_ros.recording.importers.csv_mapping import load_yaml, read_mapping
from tactile_dynamics_ros.recording.importers.guess import Answers, guess_tables

SECONDS = 7.0
UNTOLD_BY_REST = (
    "torque_in_n_cm",
    "world_mirrored",
    "inverse_pose",
    "quaternion_order",
    "torque_sign",
)
"""Mistakes that a table without time does not show: a mirror image rests alike."""
WORDS = {
    "force_mirrored_x": "x of the force alone",
    "torque_mirrored_z": "z of it alone",
    "world_mirrored_y": "left-handed: y points the other way",
    "gravity_along_-y": "gravity acts along (0, -1, 0)",
    "base_tilted": "9",
    "sensor_turned_90": "90 deg about z",
    "inverse_pose": "position too",
    "torque_in_n_cm": "tx .. tz in N cm",
}


def imported(log, folder, torque=True, **answers):
    """What is understood, and the streams of the mapping."""
    table = write_log(log, Path(folder) / "log.csv", torque)
    guess = guess_tables([table], Answers(answers))
    assert guess.question == ""
    words = " | ".join(f"{label}: {text}" for label, text in guess.understood)
    return words, read_mapping(guess.mapping, Path(folder), "log.csv").streams


def require_truth(log, streams):
    """What acts on the load in the sensor's axes, and where up is in them, are those of the log."""
    contact, pose = streams.contacts["wrist"], streams.pose
    rows = np.linspace(0, len(pose.time) - 1, len(log.wrench)).astype(int)
    to_body = np.swapaxes(pose.rotation[rows], 1, 2)
    assert_allclose(to_body @ [0.0, 0.0, 1.0], log.turn.inv().apply([0.0, 0.0, 1.0]), atol=0.01)
    for read, truth, atol in (
        (contact.force, log.wrench[:, :3], 0.15),
        (contact.torque, log.wrench[:, 3:], 0.02),
    ):
        own = (to_body @ read[rows][..., None])[..., 0]
        assert np.sqrt(np.mean((own + truth) ** 2)) < atol


@pytest.mark.parametrize("zero", [ZERO, 0.0 * ZERO], ids=["bias", "no bias"])
@pytest.mark.parametrize("name", list(CORRUPTIONS))
def test_a_mistake_with_axes_is_put_right(name, zero, tmp_path):
    seed = 20 + list(CORRUPTIONS).index(name)
    log = draw_log(seed, zero, SECONDS)
    words, streams = imported(corrupted(log, CORRUPTIONS[name], seed), tmp_path)
    require_truth(log, streams)
    assert WORDS.get(name, "") in words


@pytest.mark.parametrize("name", [n for n in CORRUPTIONS if not n.startswith(UNTOLD_BY_REST)])
def test_a_mistake_in_static_poses_leaves_the_weight(name, tmp_path):
    log = draw_static(21)
    _, streams = imported(corrupted(log, CORRUPTIONS[name], 21), tmp_path)
    up = np.swapaxes(streams.pose.rotation, 1, 2)[:, :, 2]
    force = np.einsum("nji,nj->ni", streams.pose.rotation, streams.contacts["wrist"].force)
    columns = np.hstack([9.81 * up.reshape(-1, 1), np.tile(np.eye(3), (len(up), 1))])
    weight = np.linalg.lstsq(columns, force.ravel(), rcond=None)[0][0]
    assert abs(weight) == pytest.approx(log.load[0].mass, rel=0.01)


def test_nothing_is_turned_that_only_filters_and_rounds(tmp_path):
    for seed, (name, corrupt) in enumerate(FAULTS.items(), start=31):
        words, _ = imported(corrupted(draw_log(seed), corrupt, seed), tmp_path)
        assert ("change:" in words) == (name == "zeroed")
        assert not any(label in words for label in ("world:", "sensor:", " axes:"))


def test_a_zero_and_a_load_that_step_are_told_apart_and_timed(tmp_path):
    log = draw_log(35)
    stepped = log.wrench + (log.time[:, None] >= 9.3) * np.array([2.0, -1.0, 0.5, 0.1, 0.0, 0.0])
    words, _ = imported(replace(log, wrench=stepped), tmp_path)
    assert "something changes at once at t = 9.30 s: the zero of the sensor steps by" in words
    changing = draw_change(36, heavier, (6.2, 6.2))
    words, _ = imported(changing, tmp_path)
    before, after = (f"{load.mass:.2f}" for load in changing.load)
    assert "at once at t = 6.20 s" in words and before[:3] in words and after[:3] in words


def test_a_drift_is_no_change(tmp_path):
    log = draw_log(37)
    drifting = log.wrench + 0.3 * log.time[:, None] * np.array([1.0, -1.0, 0.5, 0.0, 0.0, 0.0])
    guess = guess_tables([write_log(replace(log, wrench=drifting), tmp_path / "log.csv")])
    assert "change" not in dict(guess.understood)


def test_a_world_that_leans_is_asked_about_without_torques_and_can_be_said(tmp_path):
    log = draw_log(38)
    table = write_log(corrupted(log, CORRUPTIONS["base_tilted"], 38), tmp_path / "a.csv", False)
    question = guess_tables([table]).question
    assert "which no torque tells" in question and question.endswith("--say gravity=0,0,-1")
    said = question.split("--say gravity=")[1].split()[0]
    guess = guess_tables([table], Answers({"gravity": said}))
    assert_allclose(guess.mapping["gravity"], [float(part) for part in said.split(",")], atol=1e-3)
    with pytest.raises(BadInputError, match="three numbers with commas"):
        guess_tables([table], Answers({"gravity": "down"}))


def test_a_mounting_can_be_said(tmp_path):
    log = draw_log(39)
    turned = corrupted(log, CORRUPTIONS["sensor_turned_90"], 39)
    _, streams = imported(turned, tmp_path, sensor_rotation="0,0,-90")
    require_truth(log, streams)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("gravity: [0, 0, 0]", "expected three numbers"),
        ("gravity: down", "expected three numbers"),
        ("mirrored_world: left", "expected one of x, y, z, xy, xz, yz"),
        ("gravity: [0, -1, 0]\nworld_rotation: {euler: [0, 0, 0]}", "expected one of them"),
    ],
)
def test_a_world_that_is_none_is_refused(more, message, tmp_path):
    write_log(draw_static(40), tmp_path / "log.csv")
    (tmp_path / "m.yaml").write_text(f"static_poses: {{file: log.csv}}\n{more}\n")
    with pytest.raises(BadInputError, match=message):
        read_mapping(load_yaml(tmp_path / "m.yaml"), tmp_path, "m.yaml")


@pytest.mark.parametrize(
    "entry",
    [
        "force: {columns: [fx, fy, fz], inverse: true}",
        "force: {columns: [fx, fy, fz], order: xyz}",
        "force: {columns: [fx, fy, fz], scale: [1, -1]}",
    ],
)
def test_an_option_that_a_field_has_no_use_for_is_refused(entry, tmp_path):
    write_log(draw_static(41), tmp_path / "log.csv")
    (tmp_path / "m.yaml").write_text(f"static_poses:\n  file: log.csv\n  {entry}\n")
    with pytest.raises(BadInputError, match=r"force\.(inverse|order|scale)"):
        read_mapping(load_yaml(tmp_path / "m.yaml"), tmp_path, "m.yaml")


def recorded(log, folder):
    """The streams of a log whose columns are taken at their word."""
    from benchmarks.field import _PLAIN

    write_log(log, folder / "log.csv")
    (folder / "m.yaml").write_text(_PLAIN)
    return read_mapping(load_yaml(folder / "m.yaml"), folder, "m.yaml").streams


@pytest.mark.parametrize("name", ["force_mirrored_z", "torque_mirrored_x"])
def test_what_is_mirrored_alone_ranks_first_in_a_recording(name, tmp_path):
    log = corrupted(draw_log(42), CORRUPTIONS[name], 42)
    best = Readings.of(recorded(log, tmp_path)).alone.ranked[0].reading
    what = "forces" if name.startswith("force") else "torques"
    assert best.name == "mirrored_axes"
    assert best.change == f"{name[-1]} of the {what} alone points the other way, sensor axes"


def test_gravity_along_no_axis_is_read_off_a_recording_and_can_be_stated(tmp_path):
    log = draw_log(43)
    streams = recorded(corrupted(log, CORRUPTIONS["gravity_anywhere"], 43), tmp_path)
    down = -(
        log.turn.inv().apply([0.0, 0.0, 1.0])[:, None] @ np.swapaxes(streams.pose.rotation, 1, 2)
    )[0, 0]
    found, reading = assumed(streams, "gravity_direction")
    stated = "gravity_direction=" + ",".join(f"{part:.4f}" for part in down)
    for read in (found, assumed(streams, stated)[0]):
        up = np.swapaxes(read.pose.rotation, 1, 2)[:, :, 2]
        assert_allclose(up, log.turn.inv().apply([0.0, 0.0, 1.0]), atol=0.01)
    assert "gravity acts along (" in reading.change
    assert gravity_by_imu(recorded(log, tmp_path)) is None
    with pytest.raises(BadInputError, match="expected three numbers"):
        assumed(streams, "gravity_direction=up")


@pytest.mark.parametrize("kind", ["force_mirrored_y", "base_tilted", "recorded_torque_mirrored_y"])
def test_who_follows_the_advice_once_gets_the_mass(kind):
    [case] = [case for case in CASES if case.kind == kind]
    found = ask(case, 44)
    assert (found["outcome"], found["attempts"], found["verdict"]) == ("right", 1, "adequate")
