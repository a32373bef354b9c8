"""The benchmark of conventions makes, asks, grades and continues."""

from __future__ import annotations

import json

from benchmarks.conventions import describe, grade, main, plan


def record(kind, hidden, name, others=(), **more):
    return {
        "key": f"{kind}:{hidden}",
        "kind": kind,
        "hidden": hidden,
        "name": name,
        "others": list(others),
        "change": "",
        "verdict": "convention" if name else "adequate",
        "effect": None,
        "effects": [],
        "groups": {},
        "beside": "",
        "complaint": "",
    } | more


def test_every_kind_is_planned():
    tasks = plan(11, 5, 3, 60, 2)
    counts = {kind: sum(task.kind == kind for task in tasks) for kind in ("wrist", "pair")}
    assert counts == {"wrist": 85, "pair": 51}
    assert sum(task.kind == "clean" for task in tasks) == 60
    assert sum(task.kind == "single" for task in tasks) == 76
    assert len({task.key for task in tasks}) == len(tasks)


def test_a_name_counts_alone_first_or_among_the_others():
    summary = grade(
        [
            record("wrist", "torque_unit", "torque_unit"),
            record("wrist", "torque_unit", "torque_unit", ["force_unit"]),
            record("wrist", "torque_unit", "force_unit", ["torque_unit"]),
            record("wrist", "torque_unit", "force_sign"),
            record("clean", "wrist", None),
            record(
                "pair", "gyro_sign", "gyro_sign", effects=["viscous_drag"], beside="viscous_drag"
            ),
            record("pair", "gyro_sign", "gyro_sign", effects=["added_mass"], beside="viscous_drag"),
        ]
    )
    wrist = summary["wrist"]
    shares = [wrist[key] for key in ("right_alone", "right_first", "right_or_in_others")]
    assert shares == [0.25, 0.5, 0.75]
    assert (summary["pair"]["read_right_first"], summary["pair"]["effect_named_then"]) == (1.0, 0.5)
    assert summary["clean"]["conventions"] == 0
    assert "right or in others 75 %" in describe(summary)


def test_one_recording_is_asked_and_not_asked_again(tmp_path, capsys):
    arguments = ["--start", "31", "--seeds", "1", "--pairs", "0", "--clean", "0", "--json"]
    arguments += ["--only", "torque_sign", "--records", str(tmp_path / "records.jsonl")]
    for asked in (1, 0):
        assert main(arguments) == 0
        printed = capsys.readouterr()
        assert json.loads(printed.out)["wrist"]["right_alone"] == 1.0
        assert printed.err.count("wrist:torque_sign") == asked
