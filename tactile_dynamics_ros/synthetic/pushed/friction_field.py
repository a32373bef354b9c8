"""A table whose friction varies from place to place, and how weight spreads over feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_TILE = 0.64
"""Side of the square after which the pattern repeats, m: pushes of one recording cover less."""
_CELLS = 64
_LENGTH = 0.025
"""Distance over which friction stays alike, m (std of the smoothing): about a quarter of an object,
so that neither all feet feel the same nor all differences average out."""


@dataclass(frozen=True)
class FrictionField:
    """Relative friction over the table.

    Attributes:
        cells: (C, C) relative change on a periodic grid.
        gradient: (2,) relative change per m.
    """

    cells: np.ndarray
    gradient: np.ndarray

    @classmethod
    def even(cls) -> FrictionField:
        """Return a table that is the same everywhere."""
        return cls(np.zeros((_CELLS, _CELLS)), np.zeros(2))

    @classmethod
    def draw(cls, rng: np.random.Generator, size: float) -> FrictionField:
        """Draw a smooth Gaussian field with the given relative std."""
        frequency = np.fft.fftfreq(_CELLS, d=_TILE / _CELLS)
        squared = frequency[:, None] ** 2 + frequency[None, :] ** 2
        smooth = np.exp(-2.0 * (np.pi * _LENGTH) ** 2 * squared)
        field = np.fft.ifft2(np.fft.fft2(rng.normal(size=(_CELLS, _CELLS))) * smooth).real
        field = (field - field.mean()) / field.std()
        return cls(size * field, np.zeros(2))

    def with_step(self, axis: int, border: float, change: float) -> FrictionField:
        """Return the table with another friction beyond a border, up to half a tile away.

        Args:
            axis: 0 for x, 1 for y.
            border: m.
            change: relative.
        """
        places = np.arange(_CELLS) * (_TILE / _CELLS)
        beyond = change * (np.mod(places - border, _TILE) < 0.5 * _TILE)
        step = beyond[:, None] if axis == 0 else beyond[None, :]
        return FrictionField(self.cells + step, self.gradient)


def friction_factor(cells: np.ndarray, gradient: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the relative friction (B, P) at places on several tables, never below a tenth.

    Args:
        cells: (B, C, C).
        gradient: (B, 2) per m.
        place: (B, P, 2) m.
    """
    scaled = np.mod(place * (_CELLS / _TILE), _CELLS)
    corner = scaled.astype(int) % _CELLS
    after = (corner + 1) % _CELLS
    a, b = np.moveaxis(scaled - np.floor(scaled), -1, 0)
    table = np.arange(len(cells))[:, None]
    (i, j), (k, m) = np.moveaxis(corner, -1, 0), np.moveaxis(after, -1, 0)
    low = (1.0 - b) * cells[table, i, j] + b * cells[table, i, m]
    high = (1.0 - b) * cells[table, k, j] + b * cells[table, k, m]
    value = 1.0 + (1.0 - a) * low + a * high + np.einsum("bpk,bk->bp", place, gradient)
    return np.maximum(value, 0.1)


_SCALE = 0.05
"""m; makes the two lever arms as large as the 1 beside them, so that the small systems are well
conditioned."""
_ROUNDS = 6
"""Most changes of the set of feet that touch, in one step: it rarely changes at all."""


def spread_weight(
    feet: np.ndarray,
    stiffness: np.ndarray,
    load: np.ndarray,
    moment: np.ndarray,
    touching: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces of all feet and which of them touch.

    The underside is a plane that sinks and leans: foot i at b_i carries
    n_i = max(0, k_i (s + l . b_i)) with sum n_i = W and sum n_i b_i = M.

    Args:
        feet: (..., N, 2) m.
        stiffness: (..., N) k_i of each foot, any unit; 0 for none.
        load: (...) N.
        moment: (..., 2) N m, the weight times the place of its resultant.
        touching: (..., N) which feet touched before.

    Returns:
        (..., N) N and (..., N).
    """
    basis = np.concatenate([np.ones((*feet.shape[:-1], 1)), feet / _SCALE], axis=-1)
    wanted = np.concatenate([load[..., None], moment / _SCALE], axis=-1)[..., None]
    for _ in range(_ROUNDS):
        weight = np.where(touching, stiffness, 0.0)
        system = basis.swapaxes(-1, -2) @ (basis * weight[..., None])
        system += 1e-9 * np.trace(system, axis1=-2, axis2=-1)[..., None, None] * np.eye(3)
        depth = (basis @ np.linalg.solve(system, wanted))[..., 0]
        found = (depth > 0.0) & (stiffness > 0.0)
        if np.array_equal(found, touching):
            break
        touching = found
    return np.where(depth > 0.0, weight * depth, 0.0), touching
