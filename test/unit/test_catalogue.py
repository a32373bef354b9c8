"""What belongs to an effect: adding one is its class and what fails here until it is there."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.effects.cases import plan
from benchmarks.pushed.diagnoses import pushed
from docs.effect_pages import PICTURES
from tactile_dynamics_ros.core.effects import EFFECT_NAMES, create_effect
from tactile_dynamics_ros.core.effects.registry import CatalogueEntry, describe_effect
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.effects import (
    JOINT_EFFECT_NAMES,
    JOINTS,
    describe_joint_effect,
)
from tactile_dynamics_ros.core.planar.effects.registry import (
    PUSHED,
    PUSHED_EFFECT_NAMES,
    describe_pushed_effect,
)
from tactile_dynamics_ros.sim import hidden_effects
from tactile_dynamics_ros.sim.planar import hidden_effects as table_effects
from tactile_dynamics_ros.synthetic import CATALOGUE, EVENTS
from tactile_dynamics_ros.synthetic import joints as hidden_joints

DOCS = Path(__file__).resolve().parents[2] / "docs"

HAPPEN_ONCE = {"payload_change", "grasp_shift", "sensor_zeroed"}
"""Events: `synthetic` makes them at an instant, the simulated robot does not."""
EVERYWHERE = {"sensor_lag", "time_offset"}
"""Faults of clocks, which no part of the motion is spared."""
EVERYWHERE_ON_A_TABLE = {
    *("support_tilt", "concentrated_pressure", "load_change", "loose_joint", "contact_offset"),
    *("force_bias", "force_scale", "sensor_rotation"),
}
"""What a pushed object's sensors, load and support are, rather than a force that comes and goes."""
EVERYWHERE_IN_AN_ARM = {
    *("friction_warming", "rotor_inertia", "joint_elasticity", "backlash", "base_tilt"),
    *("torque_drift", "torque_gain", "torque_ripple", "torque_delay"),
}
"""What an arm's gears, mounting, sensors and clocks are: in a part of a recording a gain passed for
friction that is larger there."""
ON_THE_TABLE_ONLY = {"unsensed_contact", "contact_offset", "sensor_lag"}
"""Made by the simulated table alone."""
OF_TWO_PARTS = {"loose_joint"}
"""Made by `synthetic` alone, for two parts on a hinge."""


def check_entry(entry: CatalogueEntry) -> None:
    """Every entry says what the law is, how it looks and what to do, with units."""
    page = (DOCS / "effects.md").read_text()
    assert entry.formula and entry.looks_like and entry.sentence and entry.remedy
    assert entry.family and entry.meaning
    assert f"`{entry.name}`" in page and entry.formula in page
    assert all(p.name and p.description and p.typical for p in entry.parameters)


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_an_effect_of_a_held_object_is_complete(name):
    check_entry(describe_effect(create_effect(name)))
    assert (DOCS / PICTURES / f"{name}.png").is_file()
    made = {*CATALOGUE, *EVENTS, *HAPPEN_ONCE}
    assert name in made
    assert (name in hidden_effects.CATALOGUED) != (name in HAPPEN_ONCE)
    asked = {effect for case in plan(0, 1, 0, 0, 0, 0) for effect in case.effects}
    assert (name in asked) != (name in HAPPEN_ONCE)


@pytest.mark.parametrize("name", PUSHED_EFFECT_NAMES)
def test_an_effect_of_a_pushed_object_is_complete(name):
    check_entry(describe_pushed_effect(name))
    assert (name in {*pushed.CATALOGUE, *pushed.JOINTED}) != (name in ON_THE_TABLE_ONLY)
    on_table = {*table_effects.CATALOGUED, *table_effects._BESIDE}
    assert (name in on_table or name == "unsensed_contact") != (name in OF_TWO_PARTS)


@pytest.mark.parametrize("name", JOINT_EFFECT_NAMES)
def test_an_effect_of_joints_is_complete(name):
    check_entry(describe_joint_effect(name))
    assert (DOCS / PICTURES / f"joints_{name}.png").is_file()
    assert name in hidden_joints.CATALOGUE, "`./dev bench joints` asks for all that are there"
    acts_in_part(JOINTS.create, name, EVERYWHERE_IN_AN_ARM)


@pytest.mark.parametrize("name", EFFECT_NAMES)
def test_an_effect_of_a_held_object_acts_in_a_part_of_the_motion(name):
    acts_in_part(create_effect, name, EVERYWHERE)


@pytest.mark.parametrize("name", PUSHED_EFFECT_NAMES)
def test_an_effect_of_a_pushed_object_acts_in_a_part_of_the_motion(name):
    acts_in_part(PUSHED.create, name, EVERYWHERE | EVERYWHERE_ON_A_TABLE)


def acts_in_part(create, name, everywhere):
    """An effect takes a regime, or says why it has none."""
    label = f"{name}[t<5]"
    if name not in everywhere:
        assert create(label).name.startswith(name)
        return
    with pytest.raises(BadInputError, match="leave the regime out"):
        create(label)
