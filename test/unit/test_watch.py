"""When a large error is reported and when its data are kept; folders with a limited number."""

from __future__ import annotations

import json
from functools import partial

import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.diagnosis.live_check import diagnose_streams
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.ros.watch import Event, Watch, WatchConfig, drop_oldest, keep_and_diagnose
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate, generate_at_whitened_rms

CONFIG = WatchConfig(threshold=1.5, hold=5.0, span=30.0)


def _keep(streams, folder, most):
    write, ask = partial(write_bag, streams), partial(diagnose_streams, streams, ())
    return keep_and_diagnose(write, ask, folder, most)


def events(errors, config=CONFIG, step=2.5):
    watch = Watch(config)
    return [(k * step, event) for k, e in enumerate(errors) for event in watch.update(k * step, e)]


def test_an_error_that_stays_is_reported_once_and_kept_once():
    found = events([1.0] * 4 + [2.0] * 40)
    assert found == [(15.0, Event.REPORT), (40.0, Event.KEEP)]


def test_a_short_rise_is_not_reported():
    assert events([1.0, 2.0, 2.0, 1.0, 2.0, 1.4] * 20) == []


def test_what_ends_early_is_kept_at_its_end_and_the_next_rise_is_reported_again():
    found = events(([1.0] * 2 + [2.0] * 5) * 2 + [1.0])
    assert [event for _, event in found] == [Event.REPORT, Event.KEEP] * 2
    assert found[1][0] == 17.5


def test_what_stops_after_a_report_is_kept_once_and_not_reported_again_when_it_goes_on():
    watch = Watch(CONFIG)
    for k in range(5):
        watch.update(2.5 * k, 2.0)
    assert watch.pause() == [Event.KEEP]
    assert watch.pause() == []
    assert [watch.update(60.0 + 2.5 * k, 2.0) for k in range(20)] == [[]] * 20
    assert watch.update(110.0, 1.0) == []
    assert [event for k in range(4) for event in watch.update(112.5 + 2.5 * k, 2.0)] == [
        Event.REPORT
    ]


def test_silence_does_not_end_a_rise_but_counts_only_while_its_data_are_there():
    watch = Watch(CONFIG)
    watch.update(0.0, 2.0)
    assert watch.pause() == []
    assert watch.update(6.0, 2.0) == [Event.REPORT]
    watch = Watch(CONFIG)
    watch.update(0.0, 2.0)
    assert watch.update(31.0, 2.0) == []
    assert watch.update(35.9, 2.0) == []
    assert watch.update(36.1, 2.0) == [Event.REPORT]


def test_nothing_is_watched_without_a_threshold():
    assert events([9.0] * 50, WatchConfig()) == []


def test_a_clock_that_is_set_back_begins_anew():
    watch = Watch(CONFIG)
    watch.update(1000.0, 2.0)
    assert watch.update(3.0, 2.0) == []
    assert watch.update(7.9, 2.0) == []
    assert watch.update(8.1, 2.0) == [Event.REPORT]
    assert watch.update(2.0, 2.0) == []
    assert watch.update(7.1, 2.0) == [Event.REPORT]


def test_recordings_are_kept_with_their_diagnosis_and_the_oldest_goes(tmp_path):
    made = generate_at_whitened_rms(31, {"viscous_drag": 2.5}, ScenarioOptions(duration=6.0))
    for name in ("20200101T000000.000Z", "20210101T000000.000Z"):
        (tmp_path / name).mkdir()
    (tmp_path / "20190101T000000.000Z").mkdir()
    (tmp_path / "20190101T000000.000Z" / "mine.txt").write_text("not ours")
    (tmp_path / "notes").mkdir()
    document = _keep(made.streams, str(tmp_path), 2)
    left = sorted(path.name for path in tmp_path.iterdir())
    new = document["kept"].rsplit("/", 1)[1]
    assert left == ["20190101T000000.000Z", "20210101T000000.000Z", new, "notes"]
    assert document["effect"] == "viscous_drag"
    kept = json.loads((tmp_path / new / "diagnosis.json").read_text())
    assert kept == json.loads(json.dumps(document))
    again = Recording.from_bag(tmp_path / new / "recording.mcap")
    assert again.duration == pytest.approx(6.0, abs=0.1)


def test_what_cannot_be_diagnosed_is_kept_all_the_same(tmp_path):
    short = generate(31, {}, ScenarioOptions(duration=0.05)).streams
    document = _keep(short, str(tmp_path), 3)
    assert document["sentence"].startswith("no diagnosis: ")
    assert (tmp_path / document["kept"] / "recording.mcap").exists()
    with pytest.raises(BadInputError):
        _keep(short, "", 3)


def test_fewer_than_the_limit_stay(tmp_path):
    (tmp_path / "20200101T000000.000Z").mkdir()
    drop_oldest(tmp_path, 5)
    assert len(list(tmp_path.iterdir())) == 1
