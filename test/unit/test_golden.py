"""Answers of the verbs on small recordings stay as they are; all of them: `./dev bench golden`."""

import copy
import json

import pytest

from benchmarks.golden.__main__ import expected
from benchmarks.golden.answers import VERBS, answer, differences
from benchmarks.golden.recordings import RECORDINGS

QUICK = {
    "held_unstated": ("estimate", "compare"),
    "wrist_clean": ("estimate", "compare"),
    "static_wrong_row": VERBS,
    "bad_short": ("estimate", "diagnose"),
}


@pytest.mark.parametrize("name", QUICK)
def test_answers_are_as_expected(name):
    found = json.loads(json.dumps(answer(RECORDINGS[name](), QUICK[name])))
    before = {verb: expected(name)[verb] for verb in QUICK[name]}
    assert list(differences(before, found)) == []


@pytest.mark.long
@pytest.mark.parametrize("name", RECORDINGS)
def test_all_answers_are_as_expected(name):
    found = json.loads(json.dumps(answer(RECORDINGS[name]())))
    assert list(differences(expected(name), found)) == []


@pytest.fixture
def document():
    return {
        "mass": {"value": 0.5, "std": 0.01},
        "com": {"value": [0.1, 0.2], "std": [0.001, None]},
        "p_value": 1e-9,
        "sentence": "c = 1.25 ± 0.02 N s/m explains 93 % of it.",
        "effects": ["viscous_drag"],
        "adequate": False,
    }


def test_what_rounding_moves_is_no_difference(document):
    other = copy.deepcopy(document)
    other["mass"]["value"] += 0.0004
    other["com"]["value"][0] += 0.00004
    other["p_value"] = 3e-8
    other["sentence"] = "c = 1.26 ± 0.02 N s/m explains 92 % of it."
    assert list(differences(document, other)) == []


@pytest.mark.parametrize(
    "change, said",
    [
        (lambda d: d["mass"].update(value=0.502), ".mass.value: 0.5 -> 0.502, std 0.01"),
        (lambda d: d["mass"].update(std=0.011), ".mass.std: 0.01 -> 0.011"),
        (lambda d: d["com"]["value"].__setitem__(1, 0.201), ".com.value[1]: 0.2 -> 0.201"),
        (lambda d: d.update(p_value=0.3), ".p_value: 1e-09 -> 0.3"),
        (lambda d: d.update(adequate=True), ".adequate: False -> True"),
        (lambda d: d["effects"].append("force_bias"), ".effects: 1 entries -> 2"),
        (lambda d: d.update(sentence="Nothing is missing."), ".sentence: "),
        (lambda d: d.pop("mass"), ".mass: gone"),
        (lambda d: d.update(mass=None), ".mass: "),
    ],
)
def test_what_a_change_moves_is_said(document, change, said):
    other = copy.deepcopy(document)
    change(other)
    (line,) = differences(document, other)
    assert line.startswith(said)
