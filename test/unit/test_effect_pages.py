"""The page of the effects: up to date with the classes, small pictures that show what they say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from docs.effect_pages import PICTURES, make_effect_page, make_picture
from docs.effect_signatures import compute_signature
from tactile_dynamics_ros.core.effects import EFFECT_NAMES
from tactile_dynamics_ros.core.effects.formula import load_effects

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_is_what_the_classes_say():
    assert (DOCS / "effects.md").read_text() == make_effect_page(), "run ./dev docs"


def test_every_effect_has_a_small_picture():
    for name in EFFECT_NAMES:
        picture = (DOCS / PICTURES / f"{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) < 40_000, name
    assert make_picture("viscous_drag").startswith(b"\x89PNG")


def test_the_formula_on_the_page_is_read(tmp_path):
    (text,) = re.findall(r"```yaml wind.yaml\n(.*?)```", make_effect_page(), re.DOTALL)
    (tmp_path / "wind.yaml").write_text(text)
    (effect,) = load_effects(tmp_path / "wind.yaml")
    assert effect.sentence == "the object moves through wind"


@pytest.mark.parametrize(
    ("name", "busy", "quiet"),
    [
        ("viscous_drag", "moves", "turns"),
        ("rotational_drag", "turns", "moves"),
        ("contact_offset", "squeezes", "moves"),
        ("time_offset", "moves", "holds"),
    ],
)
def test_effects_show_in_the_phase_that_excites_them(name, busy, quiet):
    from docs.effect_signatures import PHASES

    signature = compute_signature(name)
    size = np.linalg.norm(signature.force, axis=1) + 20 * np.linalg.norm(signature.torque, axis=1)
    rms = {}
    for phase, start, stop in PHASES:
        inside = (signature.samples.time >= start) & (signature.samples.time < stop)
        rms[phase] = np.sqrt(np.mean(size[inside] ** 2))
    assert rms[busy] > 1.5 * rms[quiet]


def test_what_inertial_parameters_explain_is_not_shown():
    tilt = compute_signature("gravity_tilt")
    assert np.abs(tilt.world_force[:, 2]).max() < 0.05 * np.abs(tilt.world_force).max()
    assert np.ptp(tilt.world_force, axis=0).max() < 0.1 * np.abs(tilt.world_force).max()
