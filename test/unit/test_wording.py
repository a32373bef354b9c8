"""Numbers in sentences stand with their intervals; of what is known as a sum, the sum stands."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.support.carried import CarriedOptions, generate_carried
from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.verdict.wording import (
    write_fall,
    write_interval,
    write_p_value,
    write_parameters,
)
from tactile_dynamics_ros.core.effects.registry import create_effect
from tactile_dynamics_ros.core.inertia.batch.batch import fit_recording
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"


def entry(value, std, **more):
    return {"value": value, "std": std, "unit": "N"} | more


def biased(seed, first, third):
    recording = generate_carried(seed, CarriedOptions(fingers=4))
    streams = recording.streams
    contacts = dict(streams.contacts)
    for name, bias in (("finger_1", first), ("finger_3", third)):
        extra = streams.pose.rotation @ np.array(bias)
        contacts[name] = replace(contacts[name], force=contacts[name].force + extra)
    return replace(streams, contacts=contacts)


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.4123, 0.0317, "0.412 ± 0.032"),
        (1234.5, 12.0, "1234 ± 12"),
        (2.0, 0.0, "2"),
        (0.3, np.inf, "0.3 ± any"),
        (1e-9, 3e-10, "1e-09 ± 3e-10"),
    ],
)
def test_a_value_has_the_digits_that_its_interval_supports(value, std, text):
    assert write_interval(value, std) == text


@pytest.mark.parametrize(
    ("p_value", "text"),
    [(0.0, "p < 1e-16"), (5e-324, "p < 1e-16"), (3.21e-7, "p = 3.2e-07"), (0.25, "p = 0.25")],
)
def test_no_probability_is_zero(p_value, text):
    assert write_p_value(p_value) == text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (3.104, 1.021, "falls from 3.10 to 1.02"),
        (1.183, 1.176, "does not fall: it stays at 1.18"),
        (1.18, 1.25, "rises from 1.18 to 1.25"),
    ],
)
def test_an_error_falls_only_if_the_printed_numbers_do(before, after, text):
    assert write_fall(before, after) == text


def written_texts():
    """Yield name of file and value of each string of the package, and each document and example."""
    for path in sorted((ROOT / "tactile_dynamics_ros").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield path.name, node.value
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *EXAMPLES.glob("*.*")]:
        yield path.name, path.read_text()


def test_one_sign_stands_for_an_interval():
    """Classes of characters in regular expressions are no intervals."""
    of_ascii = {name for name, text in written_texts() if re.search(r"(?<!\[)\+-", text)}
    assert of_ascii == {"progress.py"}, "write ±; only what terminals cannot print is replaced"


def test_every_component_of_a_vector_has_its_interval():
    vector = {f"F_{axis}": entry(0.1, 0.01) for axis in "xyz"}
    assert write_parameters(vector) == "F = (0.100 ± 0.010, 0.100 ± 0.010, 0.100 ± 0.010) N"


@pytest.mark.parametrize(("share_std", "told"), [(0.5, True), (0.02, False)])
def test_the_sum_stands_for_shares_that_nobody_knows(share_std, told):
    table = {"index_b": entry(0.3, share_std), "thumb_b": entry(-0.1, share_std)}
    table["sum_b"] = entry(0.2, 0.01, sum_of=["index_b", "thumb_b"])
    text = write_parameters(table)
    assert ("sum_b = 0.200 ± 0.010 N" in text) == told
    assert ("index_b" in text) != told


def test_biases_of_two_fingers_in_one_grasp_are_told_as_their_sum():
    streams = biased(51, (0.3, 0.1, 0.0), (-0.1, 0.2, 0.25))
    diagnosis = diagnose(HeldObjectModel.from_fit(fit_with_readings(streams)))
    assert diagnosis.effect == "force_bias"
    sentence = diagnosis_document(diagnosis)["sentence"]
    assert "sum of b = (0." in sentence and "share it is undetermined" in sentence
    assert "finger_1_b" not in sentence


def test_the_sum_of_biases_has_the_interval_of_the_sum():
    effect = create_effect("force_bias:finger_1+finger_3")
    fit = fit_recording(biased(52, (0.3, 0.1, 0.0), (-0.1, 0.2, 0.25)), [effect])
    found = fit.to_estimate().effects["force_bias"]
    for axis, true in zip("xyz", (0.2, 0.3, 0.25), strict=True):
        std = found.std[f"sum_b_{axis}"]
        assert found.value[f"sum_b_{axis}"] == pytest.approx(true, abs=4.0 * std)
        assert std < 0.01
        parts = [found.value[f"finger_{k}_b_{axis}"] for k in (1, 3)]
        assert found.value[f"sum_b_{axis}"] == pytest.approx(sum(parts), abs=1e-9)
    assert found.std["finger_1_b_x"] > 0.1
