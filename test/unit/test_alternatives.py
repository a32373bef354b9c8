"""Effects that cannot be told apart: intervals hold the object by each of them."""

import pytest

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms


@pytest.fixture(scope="module")
def explained():
    """A fluid that moves along, which a pull upwards would look like."""
    made = generate_at_whitened_rms(13, {"added_mass": 1.5}, ScenarioOptions(duration=10.0))
    return td.explain(Recording(made.streams, "made"))


def test_the_interval_holds_the_mass_by_each_of_them(explained):
    assert explained.to_json()["groups"] == {"added_mass": ["added_mass", "hanging_cable"]}
    found = explained.to_json()["estimate"]["after"]["mass"]
    fluid = explained.to_json()["parameters"]["added_mass"]["m_a"]["value"]
    with_cable = found["value"] + fluid
    assert 0.9 * fluid < found["std"] < 1.2 * fluid
    assert abs(found["value"] - with_cable) < 1.1 * found["std"]


def test_the_mass_by_each_of_them_is_said(explained):
    said = [line for line in explained.lines() if line.startswith("The mass is")]
    assert len(said) == 1
    assert "kg with added_mass or 0.3" in said[0] and "kg with hanging_cable" in said[0]
