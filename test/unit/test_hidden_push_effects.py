"""What is hidden in the simulated table acts physically, and its truth is told."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.sim.bodies import ContactReading
from tactile_dynamics_ros.sim.planar.bed import GRAVITY
from tactile_dynamics_ros.sim.planar.hidden_effects import CATALOGUED, OUTSIDE, hide
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTable, SimulatedTableConfig
from tactile_dynamics_ros.synthetic.pushed import effects as synthetic

PUSH = ContactReading(
    "pusher",
    1.0,
    True,
    np.array([2.0, 1.0, 0.0]),
    np.zeros(3),
    np.array([0.4, 0.0, 0.02]),
    np.array([1.0, 0.0, 0.0]),
    1.0,
)


@pytest.fixture
def table():
    """Makes tables with a hidden effect and lets time pass; they are closed in the end."""
    made = []

    def make(effect, magnitude=1.0, periods=0, number=123, waits=False):
        config = SimulatedTableConfig(
            object_number=number,
            hidden_effect=effect,
            hidden_magnitude=magnitude,
            hidden_time=0.2,
            hidden_waits=waits,
            friction_spread=0.0,
        )
        made.append(SimulatedTable(config))
        made[-1].before = made[-1].world.bodies[0].pose()
        for _ in range(periods):
            made[-1].advance(looking=False)
        return made[-1]

    yield make
    for each in made:
        each.world.close()


def shift(table):
    """Return by how much the object has moved, (2,) m."""
    return (table.world.bodies[0].pose() - table.before)[:2, 3]


def truth(table):
    """Return the true parameters by name."""
    told = table.reveal()["hidden_effect"]["parameters"]
    return {name: np.array(entry["value"]) for name, entry in told.items()}


def test_there_is_each_effect_of_the_other_generator_and_random_draws_one():
    assert set(synthetic.CATALOGUE) <= set(CATALOGUED)
    assert set(synthetic.OUTSIDE) == set(OUTSIDE)


@pytest.mark.parametrize(("magnitude", "slides"), [(1.0, False), (15.0, True)])
def test_an_object_slides_down_a_table_that_leans_beyond_its_friction(table, magnitude, slides):
    made = table("support_tilt", magnitude, 40)
    downhill = shift(made) @ truth(made)["direction"]
    assert (downhill > 0.02) == slides
    assert slides or downhill < 1e-3


def test_a_weight_that_is_put_on_presses_the_feet(table):
    made = table("load_change", periods=60)
    (bed,) = made.world.bodies[0].beds
    mass = made.reveal()["objects"][0]["mass"] + truth(made)["mass"]
    assert bed.pressure.sum() == pytest.approx(mass * GRAVITY, rel=2e-3)


def test_a_tether_draws_the_object_to_its_anchor_and_a_magnet_to_its_place(table):
    for effect, place in (("tether_spring", "anchor"), ("magnet", "place")):
        made = table(effect, 40.0, 20)
        way = truth(made)[place] - made.before[:2, 3]
        assert shift(made) @ way / np.linalg.norm(way) > 2e-3


def test_friction_changes_at_its_time(table):
    made = table("friction_change")
    assert made.world.surface.factor == 1.0
    for _ in range(30):
        made.advance(looking=False)
    assert made.world.surface.factor == truth(made)["factor"] != 1.0


def test_what_waits_begins_when_asked_to_and_only_once(table):
    made = table("support_tilt", 15.0, periods=40, waits=True)
    assert shift(made) == pytest.approx(0.0, abs=1e-3)
    assert made.reveal()["hidden_effect"]["name"] == "none"
    assert "0.40 s" in made.begin()
    for _ in range(40):
        made.advance(looking=False)
    assert shift(made) @ truth(made)["direction"] > 0.02
    assert made.reveal()["hidden_effect"]["begins"] == pytest.approx(0.4)
    for each in (made, table("support_tilt")):
        with pytest.raises(BadInputError, match="no hidden effect waits"):
            each.begin()
    with pytest.raises(BadInputError, match="does not exist"):
        table("wind", waits=True)


def test_concentrated_pressure_keeps_the_weight_and_moves_it_in_or_out(table):
    even, made = (table(name, periods=40) for name in ("none", "concentrated_pressure"))
    reach = []
    for each in (even, made):
        (bed,) = each.world.bodies[0].beds
        far = np.linalg.norm(bed.places() - bed.places().mean(axis=0), axis=1)
        reach.append(bed.pressure @ far / bed.pressure.sum())
        assert bed.pressure.sum() == pytest.approx(
            each.reveal()["objects"][0]["mass"] * GRAVITY, rel=1e-3
        )
    assert np.sign(reach[1] - reach[0]) == np.sign(truth(made)["towards_rim"])


@pytest.mark.parametrize("effect", OUTSIDE)
def test_what_no_catalogue_has_leaves_the_object_on_the_table(table, effect):
    made = table(effect, periods=60)
    assert np.linalg.norm(shift(made)) < 0.02
    assert made.world.bodies[0].pose()[2, 2] > 0.99
    assert not made.reveal()["hidden_effect"]["in_catalogue"]


@pytest.mark.parametrize(("share", "moves"), [(1.3, False), (2.2, True)])
def test_a_second_object_rubs_as_soon_as_the_first_is_pushed_against_it(table, share, moves):
    alone, made = (table(name, 1.35, 20) for name in ("none", "second_object"))
    first, other = made.world.bodies
    way = (other.pose() - first.pose())[:2, 3]
    place, (part,) = other.pose()[:2, 3], first.thing.parts
    weight = part.mass * part.friction * GRAVITY
    assert truth(made)["mass"] == pytest.approx(0.5 * 1.35 * part.mass)
    assert np.linalg.norm(shift(made)) < 1e-3  # they begin side by side, not in each other
    force = np.array([*(share * weight * way / np.linalg.norm(way)), 0.0])
    for each in (alone, made):
        body = each.world.bodies[0]

        def push(_, body=body):
            body.push(0, force, body.pose()[:3, 3] + body.pose()[:3, :3] @ [*part.com, 0.01])

        each.world.add_pre_step(push)
        for _ in range(30):
            each.advance(looking=False)
    assert np.linalg.norm(shift(alone)) > 0.015
    assert (np.linalg.norm(other.pose()[:2, 3] - place) > 0.01) == moves
    assert moves or np.linalg.norm(shift(made)) < 0.005
    assert not made.reveal()["hidden_effect"]["in_catalogue"]


def measured(table, effect, turn=0.0, times=1):
    """Return how a push is measured, and the truth."""
    made = table(effect)
    for _ in range(times):
        (found,) = made.effect.feel([PUSH], turn, 0.01)
    return found, truth(made)


def test_sensors_lie_as_the_truth_says(table):
    found, told = measured(table, "force_scale")
    assert_allclose(found.force, told["gain"] * PUSH.force)
    found, told = measured(table, "force_bias", turn=np.pi / 2.0)
    assert_allclose((found.force - PUSH.force)[:2], [-told["bias"][1], told["bias"][0]], atol=1e-12)
    found, told = measured(table, "sensor_rotation")
    angle = np.arctan2(found.force[1], found.force[0]) - np.arctan2(1.0, 2.0)
    assert angle == pytest.approx(float(told["angle"]))
    found, told = measured(table, "contact_offset")
    assert_allclose(found.point - PUSH.point, told["shift"])
    found, told = measured(table, "time_offset")
    assert found.time - PUSH.time == pytest.approx(float(told["delay"]))
    found, told = measured(table, "sensor_lag", times=2)
    assert_allclose(found.force, (1.0 - np.exp(-0.02 / told["lag"])) * PUSH.force)


def test_names_and_sizes_that_make_no_sense_are_refused(table):
    made = table("none")
    assert made.reveal()["hidden_effect"]["name"] == "none"
    with pytest.raises(BadInputError, match="does not exist; expected one of none, random"):
        hide("wind", 1.0, 0, made.world, 1.0)
    with pytest.raises(BadInputError, match="zero or more"):
        hide("shaker", -1.0, 0, made.world, 1.0)
