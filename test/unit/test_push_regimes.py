"""Effects of pushes that act on a part of the table or for a while only."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.regimes import bounds_in

GYRATION = 1e-3
COUNT = 401


def straight(speed=0.1):
    """An object that slides along x from -0.2 to 0.2 m."""
    x = np.linspace(-0.2, 0.2, COUNT)
    still = np.zeros(COUNT)
    return PlanarMotion(
        time=5.0 + (x - x[0]) / speed,
        place=np.column_stack([x, still]),
        velocity=np.column_stack([np.full(COUNT, speed), still]),
        yaw=still,
        rate=still,
        gyration=GYRATION,
        middle=np.zeros(2),
    )


@pytest.mark.parametrize(
    ("regime", "inside"),
    [
        ("x>0.1", lambda m: m.place[:, 0] > 0.1),
        ("1<t<2.5", lambda m: (m.time - m.time[0] > 1.0) & (m.time - m.time[0] < 2.5)),
        ("v<0.05", lambda m: m.speed < 0.05),
        ("x>0&t<3", lambda m: (m.place[:, 0] > 0.0) & (m.time - m.time[0] < 3.0)),
    ],
)
def test_a_pull_in_a_regime_is_the_pull_inside_and_nothing_outside(regime, inside):
    motion = straight()
    gated, plain = PUSHED.create(f"constant_pull[{regime}]"), PUSHED.create("constant_pull")
    assert gated.name == f"constant_pull[{regime}]"
    theta = np.array([0.3, -0.2, 0.01, 0.02])
    expected = inside(motion)[:, None] * plain.wrench(motion, theta)
    off = np.any(np.abs(gated.wrench(motion, theta) - expected) > 1e-4, axis=1)
    assert np.count_nonzero(off) <= 9  # next to a border it sets in over millimetres


def test_a_rough_side_of_the_table_acts_under_the_share_of_the_footprint_that_lies_on_it():
    motion = straight()
    gated = PUSHED.create("friction_change[x>0.05]")
    factor = gated.friction(motion, np.array([0.5]))[:, 0, 0]
    points = np.random.default_rng(3).normal(0.0, np.sqrt(0.5 * GYRATION), size=100_000)
    for k in (150, 230, 250, 280, 350):
        beyond = np.mean(motion.place[k, 0] + points > 0.05)
        assert factor[k] == pytest.approx(1.0 + 0.5 * beyond, abs=5e-3)
    slope = gated.rise(motion, np.array([0.5]))[:, 0] * factor
    step = motion.place[1, 0] - motion.place[0, 0]
    assert slope[1:-1] == pytest.approx(np.gradient(factor, step)[1:-1], abs=0.05)


def test_what_cannot_act_in_a_regime_is_refused_in_words():
    for label in ("force_bias[x>0.1]", "time_offset[t>3]", "constant_pull[z>0.1]"):
        with pytest.raises(BadInputError, match="regime|unknown of pushes"):
            PUSHED.create(label)


def test_an_effect_in_a_regime_goes_to_other_processes():
    effect = PUSHED.create("viscous_support[y<0.02]")
    again = pickle.loads(pickle.dumps(effect))
    theta, motion = np.array([3.0]), straight()
    assert (again.name, again.family) == (effect.name, effect.family)
    assert np.array_equal(again.wrench(motion, theta), effect.wrench(motion, theta))


THREE = pushed.PushOptions(actions=pushed.ActionOptions(count=3, travel=0.12))


@pytest.fixture(scope="module")
def clean():
    """The motion of three pushes."""
    return pushed.generate([7], {}, THREE)[0].motion


@pytest.mark.parametrize("case", pushed.REGIONAL)
def test_what_is_hidden_acts_inside_its_bounds_only(case, clean):
    made = pushed.generate([7], {case: 2.0}, THREE)[0]
    bounds = bounds_in(made.scene, made.effects[case]["parameters"]["regime"])
    inside = (bounds.values(clean) > bounds.low) & (bounds.values(clean) < bounds.high)
    first = int(np.argmax(inside))
    differs = np.abs(made.motion.origin - clean.origin).max(axis=(1, 2)) > 1e-6
    assert 0.05 < inside.mean() < 0.95
    assert differs.any()
    # Feet reach beyond a border before the middle does.
    reach = 0 if bounds.symbol == "t" else np.ptp(made.scene.thing.links[0].corners, axis=0).max()
    near = np.abs(bounds.values(clean) - bounds.low) <= reach
    assert np.argmax(differs) >= min(first, int(np.argmax(near)))
