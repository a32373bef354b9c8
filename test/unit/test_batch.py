"""Many recordings: one answer each, bad ones among them, resumed, on this machine or on Dask."""

import csv
import json

import pytest
from synthetic_recording import held_box

from tactile_dynamics_ros.cli import batch_table as batch_jobs
from tactile_dynamics_ros.cli.batch_table import columns, row
from tactile_dynamics_ros.cli.main import main

SAID = {
    "verdict": "missing_effect",
    "effect": "viscous_drag",
    "group": ["tether_spring"],
    "error": {"before": 2.5, "after": 1.0, "noise_floor": 0.9},
}


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Five files; the verb knows drag in all but `bad.mcap`, and dies of `worse.mcap`."""
    asked = []

    def answer(job):
        asked.append(job.recording)
        if job.recording.endswith("/bad.mcap"):
            return "bad input", {}, "no message could be read"
        return (
            ("crashed", {}, "died") if job.recording.endswith("worse.mcap") else ("done", SAID, "")
        )

    monkeypatch.setattr(batch_jobs, "_run", answer)
    for name in ("a/1.mcap", "a/2.mcap", "b/3.mcap", "bad.mcap", "worse.mcap"):
        (tmp_path / "runs" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "runs" / name).write_bytes(b"x")
    return tmp_path, asked


def ask(folder, *more):
    pattern = str(folder / "runs" / "**" / "*.mcap")
    return main(
        ["batch", "diagnose", pattern, "--out", str(folder / "out"), "--workers", "1", *more]
    )


def test_a_bad_recording_does_not_stop_the_others(runs, capsys):
    folder, asked = runs
    assert ask(folder) == 3
    assert "2 of 5 recordings have no answer" in capsys.readouterr().err
    with (folder / "out" / "table.csv").open() as stream:
        rows = {row["recording"].rpartition("runs/")[2]: row for row in csv.DictReader(stream)}
    assert set(rows) == {"a/1.mcap", "a/2.mcap", "b/3.mcap", "bad.mcap", "worse.mcap"}
    assert rows["a/1.mcap"]["effect"] == "viscous_drag"
    assert rows["a/1.mcap"]["group"] == "tether_spring"
    assert float(rows["a/1.mcap"]["error_before"]) == 2.5
    assert rows["bad.mcap"]["message"] == "no message could be read"
    assert len(asked) == 5


def test_it_resumes_where_it_was_and_asks_again_what_has_changed(runs):
    folder, asked = runs
    ask(folder)
    asked.clear()
    ask(folder)
    assert [name.rpartition("/")[2] for name in asked] == ["worse.mcap"]
    asked.clear()
    (folder / "runs" / "a" / "1.mcap").write_bytes(b"longer")
    ask(folder)
    assert sorted(name.rpartition("/")[2] for name in asked) == ["1.mcap", "worse.mcap"]
    asked.clear()
    ask(folder, "--effects", "viscous_drag")
    assert len(asked) == 5


def test_what_a_lost_worker_had_answered_is_not_asked_twice_unless_that_is_wanted(runs):
    folder, asked = runs
    ask(folder)
    asked.clear()
    out = folder / "out" / "reports" / "a" / "1.mcap"
    job = batch_jobs.Job(str(folder / "runs" / "a" / "1.mcap"), str(out), "diagnose", (), 1800.0)
    assert batch_jobs.ask(job).document == SAID and asked == []
    ask(folder, "--again")
    assert len(asked) == 5


def test_an_answer_that_was_cut_off_is_asked_again(runs):
    folder, asked = runs
    ask(folder)
    asked.clear()
    kept = folder / "out" / "reports" / "b" / "3.mcap" / batch_jobs.ANSWER
    kept.write_text(kept.read_text()[:40])
    ask(folder)
    assert sorted(name.rpartition("/")[2] for name in asked) == ["3.mcap", "worse.mcap"]


def test_the_page_links_reports_and_counts_what_was_said(runs):
    folder, _ = runs
    report = folder / "out" / "reports" / "a" / "1.mcap" / "report.html"
    report.parent.mkdir(parents=True)
    report.write_text("report")
    ask(folder)
    page = (folder / "out" / "report.html").read_text()
    assert 'href="reports/a/1.mcap/report.html"' in page
    assert page.count("href=") == 1
    assert "viscous_drag: 3" in page


def test_the_verb_itself_is_asked_in_a_process_of_its_own(tmp_path, capfd):
    held_box().to_bag(tmp_path / "good")
    (tmp_path / "bad.mcap").write_bytes(b"x")
    names = [str(tmp_path / name) for name in ("good", "bad.mcap")]
    out = str(tmp_path / "out")
    assert main(["batch", "estimate", *names, "--out", out, "--json", "--workers", "2"]) == 3
    good, bad = json.loads(capfd.readouterr().out)
    assert good["status"] == "done" and good["estimate"]["mass"]["value"] > 0.0
    assert bad["status"] == "bad input" and "bad.mcap" in bad["message"]


def told(document):
    cells = row("estimate", batch_jobs.Answer("push.mcap", ".", "done", 1.0, document))
    return dict(zip(columns("estimate"), cells, strict=True))


def test_pushed_objects_have_their_friction_force_and_what_is_not_told_is_empty():
    number = {"value": 1.5, "std": 0.02}
    part = {"mass": number, "friction_force_n": number, "com": {"value": [0.01, 0.02]}}
    document = {"model": "pushed", "links": [part], "undetermined": ["mass"], "error": 0.97}
    cells = told(document)
    assert cells["friction_force_n"] == "1.500" and cells["friction_force_std_n"] == "0.02000"
    assert cells["mass_kg"] == cells["com_z_m"] == "" and cells["com_y_m"] == "0.02000"
    assert cells["error"] == "0.9700" and cells["undetermined"] == "mass"
    whole = {"mass": number, "friction_force_n": {"value": 4.0, "std": 0.1}}
    both = document | {"links": [part, part], "whole": whole, "undetermined": ["link_1.mass"]}
    assert told(both)["friction_force_n"] == "4.000" and told(both)["mass_kg"] == "1.500"


def test_nothing_that_matches_is_bad_input(tmp_path, capsys):
    assert main(["batch", "estimate", str(tmp_path / "*"), "--out", str(tmp_path / "o")]) == 2
    assert "no recording matches" in capsys.readouterr().err


def test_two_workers_of_a_cluster_answer_alike(runs):
    distributed = pytest.importorskip("distributed")
    folder, _ = runs
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        assert ask(folder, "--scheduler", cluster.scheduler_address) == 3
    table = (folder / "out" / "table.csv").read_text()
    assert table.count("viscous_drag") == 3 and table.count("no message could be read") == 1
