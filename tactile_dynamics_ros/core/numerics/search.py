"""Minima of costs without gradients: an evolution strategy, and cross-entropy with coloured noise.

Source: Pinneri et al. 2020 (iCEM: coloured noise, kept elites, start from the last solution).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array

Cost = Callable[[Array], Array]


@dataclass(frozen=True)
class SearchConfig:
    """How a search spends its evaluations.

    Attributes:
        samples: per round. elites: best ones that shape the next round. rounds: of samples.
        kept: share of the elites that stay in the next round.
        shrink: of the evolution strategy's std from round to round.
        colour: exponent of the noise's power spectrum along the horizon; 0 is white.
        memory: share of the old mean and std that a round of cross-entropy keeps.
    """

    samples: int = 64
    elites: int = 8
    rounds: int = 3
    kept: float = 0.3
    shrink: float = 0.6
    colour: float = 2.0
    memory: float = 0.1


@dataclass(frozen=True)
class Found:
    """Best of a search.

    Attributes:
        best: (H, D). cost: of it. elites: (E, H, D), the best ones, best first.
    """

    best: Array
    cost: float
    elites: Array


def coloured_noise(rng: np.random.Generator, shape: tuple[int, int, int], colour: float) -> Array:
    """Noise (N, H, D) of unit variance whose power falls as frequency^-colour along H."""
    count, horizon, size = shape
    if horizon < 2 or colour == 0.0:
        return rng.standard_normal(shape)
    frequency = np.fft.rfftfreq(horizon)
    frequency[0] = frequency[1]
    scale = frequency ** (-0.5 * colour)
    parts = rng.standard_normal((2, count, size, len(frequency)))
    noise = np.fft.irfft((parts[0] + 1j * parts[1]) * scale, n=horizon, axis=-1)
    weights = np.full(len(frequency), 4.0)
    weights[0] = 1.0
    if horizon % 2 == 0:
        weights[-1] = 1.0
    std = np.sqrt(weights @ np.square(scale)) / horizon
    return np.asarray(noise.swapaxes(1, 2) / std)


def cross_entropy(
    cost: Cost, mean: Array, std: Array, rng: np.random.Generator, config: SearchConfig
) -> Found:
    """Search around a mean by fitting a normal distribution to the best of each round.

    Args:
        cost: (N, H, D) to (N,).
        mean: (H, D), for example the last solution moved on by a step.
        std: (H, D).
        rng: of the draws.
        config: how.
    """
    kept = mean[None]
    centre, spread = mean.copy(), std.copy()
    for _ in range(config.rounds):
        noise = coloured_noise(rng, (config.samples, *mean.shape), config.colour)
        tried = np.concatenate([kept, centre + spread * noise])
        costs = cost(tried)
        order = np.argsort(costs)[: config.elites]
        elites, best_cost = tried[order], float(costs[order[0]])
        centre = config.memory * centre + (1.0 - config.memory) * elites.mean(axis=0)
        spread = config.memory * spread + (1.0 - config.memory) * elites.std(axis=0)
        kept = elites[: max(1, round(config.kept * config.elites))]
    return Found(elites[0], best_cost, elites)


def evolve(
    cost: Cost, parents: Array, std: Array, rng: np.random.Generator, config: SearchConfig
) -> Found:
    """Search near many parents at once, for costs with several valleys.

    Every round keeps the best and draws children around each of them, nearer and nearer.

    Args:
        cost: (N, H, D) to (N,).
        parents: (N, H, D) to begin with.
        std: (H, D) of the first children.
        rng: of the draws.
        config: how.
    """
    tried, costs = parents, cost(parents)
    spread = std
    for _ in range(config.rounds):
        elites, ranked = _best(tried, costs, config.elites)
        repeats = max(1, config.samples // len(elites))
        children = np.repeat(elites, repeats, axis=0)
        children = children + spread * rng.standard_normal(children.shape)
        tried = np.concatenate([elites, children])
        costs = np.concatenate([ranked, cost(children)])
        spread = config.shrink * spread
    elites, ranked = _best(tried, costs, config.elites)
    return Found(elites[0], float(ranked[0]), elites)


def _best(tried: Array, costs: Array, count: int) -> tuple[Array, Array]:
    order = np.argsort(costs)[:count]
    return tried[order], costs[order]
