"""Many robots: drifts and outliers are named where they are, and rarely where nothing is."""

import contextlib
import csv
import subprocess
import sys
import time

import numpy as np
import psutil
import pytest
from synthetic_recording import held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.report.fleet import FALSE_ALARMS, Fleet, Track, outlier_p_values

ROBOTS, RECORDINGS = 10, 30


def fleet(seed, spoil=lambda robot, values: values):
    """Ten robots with loads of their own, each weighed thirty times."""
    random = np.random.default_rng(seed)
    names = tuple(f"{k}.mcap" for k in range(RECORDINGS))
    tracks = []
    for robot in range(ROBOTS):
        values = random.uniform(0.2, 1.0) + 0.002 * random.normal(size=RECORDINGS)
        tracks.append(Track(f"robot_{robot}", "mass_kg", names, spoil(robot, values)))
    return Fleet(tracks)


def test_of_fleets_in_which_nothing_changes_no_more_are_named_than_stated():
    named = [bool(one.drifting or one.outliers) for one in map(fleet, range(100))]
    most = 100 * FALSE_ALARMS + 2.6 * np.sqrt(100 * FALSE_ALARMS * (1 - FALSE_ALARMS))
    assert sum(named) <= most


def test_p_values_of_outliers_are_as_rare_as_they_say_and_no_rarer_than_half_of_it():
    random = np.random.default_rng(0)
    p_values = np.concatenate([outlier_p_values(random.normal(size=50)) for _ in range(600)])
    for level in (0.1, 0.01, 0.001):
        assert 0.5 * level < np.mean(p_values < level) < 1.3 * level


def test_a_drift_is_named_with_its_size_and_its_ends_are_no_outliers():
    slope = 4e-4
    found = fleet(1, lambda robot, v: v + slope * np.arange(RECORDINGS) * (robot == 7))
    assert [track.robot for track in found.drifting] == ["robot_7"] and found.outliers == []
    _, low, high = found.drifting[0].slope
    assert low < slope < high
    section, robots = found.sections()
    assert section.rows[0][0] == "robot_7" and len(section.pictures) == 1
    assert len(robots.rows) == ROBOTS


def test_a_recording_with_another_load_stands_out():
    found = fleet(2, lambda robot, v: v + 0.04 * ((np.arange(RECORDINGS) == 21) & (robot == 3)))
    [(track, k, p_value)] = found.outliers
    assert (track.robot, k) == ("robot_3", 21) and p_value < 1e-5
    assert found.drifting == []
    [row] = found.sections()[0].rows
    assert row[0] == "21.mcap"


def test_values_that_are_all_the_same_or_few_name_nothing():
    assert np.all(outlier_p_values(np.ones(20)) == 1.0)
    few = Fleet([Track("r", "error", ("a", "b"), np.array([1.0, 9.0]))])
    assert few.drifting == [] and few.outliers == [] and Fleet([]).sections()


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two robots with three recordings each."""
    folder = tmp_path_factory.mktemp("fleet")
    for robot in "ab":
        for k in range(3):
            (folder / robot).mkdir(exist_ok=True)
            held_box().to_bag(folder / robot / f"{k}.mcap")
    return folder


def read(folder):
    with (folder / "table.csv").open() as stream:
        return list(csv.DictReader(stream))


def _busy(pid):
    """Return the workers of a batch that run a verb: none that starts, or has just ended."""
    busy = []
    for worker in psutil.Process(pid).children():
        with contextlib.suppress(psutil.NoSuchProcess):
            told = [child.cmdline() for child in worker.children()]
            busy += [worker] * any("tactile_dynamics_ros.cli.main" in words for words in told)
    return busy


@pytest.mark.slow
def test_a_killed_worker_costs_no_row_and_makes_none_twice(recordings, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    pytest.importorskip("distributed")
    patterns = [str(recordings / "**" / "*.mcap"), str(recordings / "a" / ".." / "a" / "0.mcap")]
    command = [sys.executable, "-m", "tactile_dynamics_ros.cli.main", "batch", "estimate"]
    command += [*patterns, "--out", str(tmp_path), "--workers", "2", "--no-reports"]
    batch = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not (busy := _busy(batch.pid)):
        assert time.monotonic() < deadline and batch.poll() is None
        time.sleep(0.02)
    busy[0].kill()
    _, said = batch.communicate(timeout=240)
    assert batch.returncode == 0, said
    rows = read(tmp_path)
    assert len(rows) == len({row["recording"] for row in rows}) == 6
    assert [row["robot"] for row in rows] == ["a", "a", "a", "b", "b", "b"]
    assert {row["status"] for row in rows} == {"done"}
    table = parquet.read_table(tmp_path / "table.parquet")
    assert table.column_names == list(rows[0])
    assert table["mass_kg"].to_pylist() == [float(row["mass_kg"]) for row in rows]
    assert "Robots" in (tmp_path / "report.html").read_text()
    assert not list(tmp_path.rglob("*.png")), "no reports were wanted"


def test_without_dask_threads_of_this_process_answer_alike(recordings, tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_dynamics_ros.cli.batch.find_spec", lambda name: None)
    pattern = str(recordings / "a" / "*.mcap")
    told = ["batch", "estimate", pattern, "--out", str(tmp_path), "--workers", "2", "--no-reports"]
    assert main(told) == 0
    assert [row["status"] for row in read(tmp_path)] == ["done"] * 3
    assert not (tmp_path / "table.parquet").exists()
