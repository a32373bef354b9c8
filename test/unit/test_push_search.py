"""Searches without gradients: what they find, and the noise they draw."""

import numpy as np
import pytest

from tactile_dynamics_ros.core.numerics.search import (
    SearchConfig,
    coloured_noise,
    cross_entropy,
    evolve,
)

WANTED = np.array([[0.3, -0.2], [0.1, 0.4], [-0.5, 0.2]])


def bowl(plans):
    return np.sum(np.square(plans - WANTED), axis=(1, 2))


@pytest.mark.parametrize("horizon", [2, 5, 8])
def test_noise_has_unit_variance_whatever_its_colour(horizon):
    rng = np.random.default_rng(0)
    noise = coloured_noise(rng, (20000, horizon, 2), 2.0)
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=0.03)


def test_coloured_noise_is_alike_at_neighbouring_times():
    noise = coloured_noise(np.random.default_rng(1), (20000, 8, 1), 2.0)[..., 0]
    near = np.mean(noise[:, 2] * noise[:, 3])
    white = coloured_noise(np.random.default_rng(1), (20000, 8, 1), 0.0)[..., 0]
    assert near > 0.4
    assert abs(np.mean(white[:, 2] * white[:, 3])) < 0.03


def test_cross_entropy_comes_nearer_with_every_round():
    errors = []
    for rounds in (1, 4, 12):
        config = SearchConfig(samples=60, elites=8, rounds=rounds)
        rng = np.random.default_rng(2)
        found = cross_entropy(bowl, np.zeros((3, 2)), np.full((3, 2), 0.5), rng, config)
        errors.append(found.cost)
        assert found.cost == pytest.approx(float(bowl(found.best[None])[0]))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.02


def test_the_last_solution_is_never_lost():
    config = SearchConfig(samples=5, elites=2, rounds=1)
    rng = np.random.default_rng(3)
    found = cross_entropy(bowl, WANTED, np.full((3, 2), 5.0), rng, config)
    np.testing.assert_array_equal(found.best, WANTED)


def test_evolution_keeps_several_valleys_until_the_deeper_is_found():
    def two(plans):
        near = np.sum(np.square(plans - 2.0), axis=(1, 2))
        far = np.sum(np.square(plans + 2.0), axis=(1, 2)) - 0.1
        return np.minimum(near + 0.0, far)

    rng = np.random.default_rng(4)
    parents = rng.uniform(-3.0, 3.0, (200, 1, 2))
    config = SearchConfig(samples=120, elites=12, rounds=12)
    found = evolve(two, parents, np.full((1, 2), 0.5), rng, config)
    np.testing.assert_allclose(found.best, -2.0, atol=0.1)
