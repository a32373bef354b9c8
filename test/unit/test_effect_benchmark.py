"""The hidden-effect benchmark grades honestly: oracles pass, guessers fail, stops are survived."""

import json

import numpy as np
import pytest

from benchmarks.effects.__main__ import describe, main
from benchmarks.effects.cases import IN_PART, Case, plan
from benchmarks.effects.figures import draw_confusion, draw_thresholds
from benchmarks.effects.grading import (
    count_confusions,
    find_thresholds,
    grade,
    is_in_group,
    is_right_alone,
)
from benchmarks.effects.parameters import parameter_errors, true_parameters
from benchmarks.effects.product import Answer
from benchmarks.effects.running import run_case
from benchmarks.kept import read_rows
from tactile_dynamics_ros.synthetic import CATALOGUE, OUTSIDE, generate

FLOOR = {"before": 2.0, "after": 1.01, "noise_floor": 1.0}


def signature_of(case, tone):
    """The world axis along which the hidden force is largest."""
    recording = case.record()
    wrench = recording.scenario.simulate(recording.effects).hidden_wrench
    axis = "xyz"[int(np.argmax(np.mean(wrench[:, 3:] ** 2, axis=0)))]
    return {"frequency_hz": tone, "frame": "world", "channels": [f"force_{axis}"]}


def oracle(case, offset_in_std=0.0):
    """A product that knows the case and is wrong about every parameter by some deviations."""
    names = list(case.effects)

    def ask(arguments):
        return Answer(0, answers[arguments[0]](arguments), "", 1.0)

    truth = case.record().truth()
    verdicts = {"clean": "adequate", "outside": "unexplained"}
    tones = [entry["signature"].get("frequency_hz") for entry in truth["effects"].values()]
    diagnosis = {
        "verdict": verdicts.get(case.kind, "missing_effect"),
        "effect": names[0] if case.kind == "single" else None,
        "group": [],
        "error": FLOOR,
        "unexplained": signature_of(case, tones[0]) if tones else None,
    }

    def estimate(arguments):
        values = true_parameters(arguments[-1], truth)
        found = {
            name: {"value": value + 0.1 * offset_in_std, "std": 0.1, "unit": ""}
            for name, value in values.items()
        }
        return {"effects": {arguments[-1]: found}, "error": {"whitened_rms": 1.0}}

    answers = {
        "diagnose": lambda _: diagnosis,
        "compare": lambda _: {"adequate": case.kind == "clean"},
        "explain": lambda _: {"steps": [{"added": None}, *({"added": name} for name in names)]},
        "estimate": estimate,
    }
    return ask


def record_of(case, offset_in_std=0.0):
    return run_case(case, oracle(case, offset_in_std))


CASES = (
    Case("clean", (), 1.0, 1, 3.0),
    Case("single", ("force_bias",), 2.0, 1, 3.0),
    Case("single", ("tether_spring",), 2.0, 1, 3.0),
    Case("pair", ("viscous_drag", "force_bias"), 2.0, 1, 3.0),
    Case("outside", ("motor_vibration",), 2.0, 1, 3.0),
    Case("outside", ("dry_rubbing",), 2.0, 1, 3.0),
)


@pytest.fixture(scope="module")
def records():
    return [record_of(case) for case in CASES]


def test_an_oracle_passes_everywhere(records):
    summary = grade(records)
    assert summary["clean"]["adequate"] == summary["clean"]["compare_adequate"] == 1.0
    assert summary["single"]["right_alone"] == summary["single"]["coverage"] == 1.0
    assert summary["single"]["error_at_floor"] == 1.0
    assert summary["pairs"]["both_within_two"] == 1.0
    assert summary["outside"]["unexplained"] == 1.0
    assert summary["outside"]["frequency_within_two_percent"] == 1.0
    assert summary["crashes"] == []
    assert "force_bias" in describe(summary)


def test_parameters_off_by_three_deviations_are_not_covered():
    summary = grade([record_of(CASES[1], offset_in_std=3.0)])
    assert summary["single"]["coverage"] == 0.0
    assert summary["single"]["effects"]["force_bias"]["median_error_in_std"] == pytest.approx(3.0)


def test_a_torque_is_the_wrong_channel_for_a_force_at_the_origin(records):
    [record] = [r for r in records if r["effects"] == ("dry_rubbing",)]
    said = {"frequency_hz": None, "frame": "world", "channels": ["torque_z"]}
    wrong = {**record["diagnose"]["json"], "unexplained": said}
    assert grade([record])["outside"]["right_channel"] == 1.0
    summary = grade([{**record, "diagnose": {**record["diagnose"], "json": wrong}}])
    assert summary["outside"]["unexplained"] == 1.0
    assert summary["outside"]["right_channel"] == 0.0


def test_a_guesser_fails(records):
    guess = {"verdict": "missing_effect", "effect": "viscous_drag", "group": [], "error": FLOOR}
    guessed = [
        {**record, "diagnose": {**record["diagnose"], "json": guess}, "estimates": {}}
        for record in records
        if record["kind"] != "pair"
    ]
    summary = grade(guessed)
    assert summary["clean"]["adequate"] == summary["single"]["right_or_group"] == 0.0
    assert summary["outside"]["wrong_name"] == 1.0
    assert count_confusions(guessed)["force_bias"] == {"viscous_drag": 1}


def test_a_group_counts_only_if_its_members_fit_alike(records):
    group = {"verdict": "ambiguous", "effect": None, "group": ["force_bias", "unsensed_contact"]}
    for other_fit, honest in ((1.02, True), (1.4, False)):
        estimates = {
            name: {"json": {"error": {"whitened_rms": fit}, "effects": {}}}
            for name, fit in zip(group["group"], (1.0, other_fit), strict=True)
        }
        record = {**records[1], "diagnose": {"json": group}, "estimates": estimates}
        assert is_in_group(record) == honest
        assert not is_right_alone(record)


def test_a_product_that_answers_nothing_fails(records):
    silent = [{**record, "diagnose": {"json": None, "seconds": 1.0}} for record in records[:3]]
    summary = grade(silent)
    assert summary["clean"]["adequate"] == summary["single"]["right_or_group"] == 0.0


def test_threshold_is_the_level_from_which_on_effects_are_found(records):
    wrong = {**records[1], "diagnose": {"json": {"verdict": "adequate", "error": FLOOR}}}
    singles = [
        {**(wrong if level < 2.0 else records[1]), "level": level}
        for level in (1.1, 1.35, 2.0, 4.0)
    ]
    assert find_thresholds(singles)["force_bias"] == 2.0
    assert find_thresholds(singles)["added_mass"] is None


def test_an_effect_that_cannot_reach_its_level_is_set_aside(records):
    weak = {**records[1], "reached": [1.2]}
    summary = grade([weak])
    assert summary["out_of_reach"] == 1
    assert summary["single"]["count"] == 0


def test_every_parameter_of_the_catalogue_has_a_product_name():
    for name in CATALOGUE:
        truth = generate(3, {name: 1.0}, Case("single", (name,), 2.0, 3, 2.0).scenario()).truth()
        values = true_parameters(name, truth)
        assert values
        found = {key: {"value": value, "std": 1.0} for key, value in values.items()}
        errors = parameter_errors(name, truth, {"effects": {name: found}})
        assert len(errors) == len(values)


def test_a_gain_that_all_fingers_share_is_not_held_against_the_product():
    gains = {"index": 0.2, "middle": 0.0, "ring": 0.0, "thumb": 0.0}
    quantities = {f"{finger}.gain_error": {"value": gain} for finger, gain in gains.items()}
    truth = {"effects": {"force_scale": {"parameters": quantities}}}
    shared = {
        f"{finger}_gain": {"value": 1.05 * (1 + gain) - 1, "std": 0.01}
        for finger, gain in gains.items()
    }
    alone = {"index_gain": {"value": 0.2, "std": 0.01}}
    for said in (shared, alone):
        errors = parameter_errors("force_scale", truth, {"effects": {"force_scale": said}})
        assert errors["index_gain"] == (pytest.approx(0.0, abs=1e-12), 0.01)


def test_records_survive_a_cut_off_line(records, tmp_path):
    path = tmp_path / "records.jsonl"
    lines = [json.dumps(record) for record in records[:2]]
    path.write_text("\n".join(lines) + "\n" + lines[0][:40])
    assert [record["key"] for record in read_rows(path)] == [r["key"] for r in records[:2]]


def test_plan_covers_everything_with_report_seeds():
    cases = plan(start=1000, seeds=2, clean=5, pairs=8, outside=1, calm=1)
    assert min(case.seed for case in cases) >= 1000
    assert len({case.key for case in cases}) == len(cases)
    assert {name for case in cases if case.kind == "single" for name in case.effects} == set(
        CATALOGUE
    )
    assert {name for case in cases if case.kind == "outside" for name in case.effects} == {
        *OUTSIDE,
        *IN_PART,
    }
    assert all(len(set(case.effects)) == 2 for case in cases if case.kind == "pair")


def test_pictures_are_drawn(records, tmp_path):
    singles = [record for record in records if record["kind"] == "single"]
    confusion = draw_confusion(count_confusions(records), tmp_path / "confusion.png")
    thresholds = draw_thresholds(singles, is_in_group, tmp_path / "thresholds.png")
    for picture in (confusion, thresholds):
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_quick_benchmark_asks_the_real_command(tmp_path, capsys):
    code = main(["--quick", "--json", "--records", str(tmp_path / "records.jsonl")])
    summary = json.loads(capsys.readouterr().out)
    assert code == 0
    assert summary["crashes"] == []
    assert summary["clean"]["count"] == summary["single"]["count"] == 1
    assert summary["single"]["right_or_group"] == 1.0
    assert len(read_rows(tmp_path / "records.jsonl")) == 3


def test_vectors_in_axes_that_nobody_tells_are_compared_by_length():
    bias = {"middle.bias": {"value": [0.03, 0.04, 0.0], "unit": "N"}}
    truth = {"effects": {"force_bias": {"reading": "contact", "parameters": bias}}}
    values = {"middle_b_x": 0.0, "middle_b_y": 0.0, "middle_b_z": 0.051}
    said = {name: {"value": value, "std": 0.001} for name, value in values.items()}
    estimate = {"effects": {"force_bias": said}}
    [(name, (error, std))] = parameter_errors("force_bias", truth, estimate, False).items()
    assert name == "middle_b"
    assert (error, std) == pytest.approx((0.001, 0.001))
    assert len(parameter_errors("force_bias", truth, estimate, True)) == 3
