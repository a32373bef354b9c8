"""Expectation maximisation of mixtures of superquadrics, many starts at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.shape.superquadric.chart import SHAPE_NAMES, Chart, Placed
from tactile_dynamics_ros.core.shape.superquadric.gauge import areas
from tactile_dynamics_ros.core.shape.superquadric.mixture import PRIOR_STD, Mixture

_LEAST_STRAYS, _MOST_STRAYS = 1e-3, 0.9
"""Between which the share of strays is estimated: with none at all one stray would count like any
number of points, and with nothing but strays no part would be left to estimate. Wider bounds let
one stray pull a surface or a fit give all points up; narrower ones bend the share of clean or
cluttered clouds."""
_LEAST_NOISE = 1e-4
"""Least standard deviation of points across the surface, as a share of the cloud's size: 10 um on
10 cm, less than any camera has. At zero the likelihood of exact points has no maximum. A thousandth
and more would be the noise of good cameras and make intervals too wide."""
_DAMPING = 1e-3
"""First damping of Levenberg-Marquardt, as a share of the diagonal; from 1e-4 to 1e-2 the same
optima are found. Far more begins with short steps, far less with ones that are refused."""
_USUAL = np.array([0.5, 0.7, 0.0, 0.0])
"""Centre of the prior: between box and cylinder, not tapered; exponents and tapers. Another centre
moves what few points show, by their share of the information beside `PRIOR_STD`."""
CONVERGED = 1e-6
"""Move of a surface over the cloud's size below which a fit has converged: 0.1 um of 10 cm. Steps
shrink by a third to a tenth each, so that what is left is not much more. Ten times as much ends
fits while they still move by more than intervals of many points allow; less takes steps at
rounding."""
_SETTLED = 1e-3
"""Relative change of the noise from which it counts as settled: 0.1 %, far below what its own
uncertainty is with a thousand points (2 %). Larger ends fits whose noise still falls, smaller goes
on for what no interval shows."""


def maximise(mixture: Mixture, points: Array, steps: int, tolerance: float = CONVERGED) -> Mixture:
    """Raise the likelihood of one mixture; as `maximise_all`."""
    return maximise_all([mixture], points[None], steps, tolerance)[0]


def maximise_all(
    mixtures: Sequence[Mixture],
    points: Array,
    steps: int,
    tolerance: float = CONVERGED,
    weights: Array | None = None,
) -> list[Mixture]:
    """Raise likelihoods by expectation maximisation, one damped step of all parts at a time.

    Args:
        mixtures: B starts of K parts each, with one chart.
        points: (B, N, 3) world, m, or (1, N, 3) for all.
        steps: at most.
        tolerance: move of the surface over the cloud's size below which it has converged.
        weights: (B, N) of the points, 0 where a row has fewer; 1 by default.
    """
    points = np.broadcast_to(points, (len(mixtures), *points.shape[1:]))
    size = np.ptp(points, axis=1).max(axis=1)
    weights = np.ones(points.shape[:2]) if weights is None else weights
    climb = _Climb.begin(mixtures, np.swapaxes(points, 1, 2)[:, None], weights, size)
    ends: list[Mixture] = list(mixtures)
    left = np.arange(len(mixtures))
    for step in range(steps):
        moved = climb.step()
        done = (moved < tolerance * size[left]) | (step == steps - 1)
        for row in np.flatnonzero(done):
            ends[left[row]] = climb.end(int(row), mixtures[left[row]])
        if done.all():
            break
        if done.any():
            left, climb = left[~done], climb.only(~done)
    return ends


@dataclass
class _Climb:
    """B mixtures of K parts on their way, linearised where they are.

    Attributes:
        chart: coordinates.
        points: (B, 1, 3, N) world, m. weights, scale: (B, N).
        shapes: (B, K). log_area, area_slope: (B, K), (B, K, 7) of it.
        distance, jacobian: (B, K, N), (B, K, P, N).
        shares: (B, K). strays, noise, least, volume: (B,). damping: (B, K).
    """

    chart: Chart
    points: Array
    weights: Array
    scale: Array
    shapes: Placed
    log_area: Array
    area_slope: Array
    distance: Array
    jacobian: Array
    shares: Array
    strays: Array
    noise: Array
    least: Array
    volume: Array
    damping: Array

    @classmethod
    def begin(
        cls, mixtures: Sequence[Mixture], points: Array, weights: Array, size: Array
    ) -> _Climb:
        chart = mixtures[0].chart
        shapes = Placed.of([mixture.shapes for mixture in mixtures])
        area, slope = areas(shapes.shape)
        return cls(
            chart,
            points,
            weights,
            np.array([mixture.scale for mixture in mixtures]),
            shapes,
            np.log(area),
            slope,
            *chart.linearise(shapes, points),
            np.array([mixture.shares for mixture in mixtures]),
            np.array([mixture.strays for mixture in mixtures]),
            np.array([mixture.noise for mixture in mixtures]),
            np.maximum([mixture.least for mixture in mixtures], _LEAST_NOISE * size),
            np.array([mixture.volume for mixture in mixtures]),
            np.full(area.shape, _DAMPING),
        )

    def only(self, rows: NDArray[np.bool_]) -> _Climb:
        """Return some of the mixtures."""
        own = {name: value[rows] for name, value in vars(self).items() if name != "chart"}
        return replace(self, **own)

    def end(self, row: int, start: Mixture) -> Mixture:
        """Return one mixture."""
        return replace(
            start,
            shapes=self.shapes[row].unstacked(),
            shares=self.shares[row],
            strays=float(self.strays[row]),
            noise=float(self.noise[row]),
        )

    def step(self) -> Array:
        """Take a step of everything; return how far (B,), m, surfaces were to move."""
        member = self._members()
        moved = self._move(member)
        inliers = member[:, :-1].sum(axis=-1)
        squares = np.sum(member[:, :-1] * (self.distance / self.scale[:, None]) ** 2, axis=(1, 2))
        noise = np.maximum(np.sqrt(squares / np.maximum(inliers.sum(axis=1), 1.0)), self.least)
        settled = np.abs(np.log(noise / self.noise)) < _SETTLED
        believed = np.maximum(inliers, 1.0)
        self.shares = believed / believed.sum(axis=1, keepdims=True)
        strays = member[:, -1].sum(axis=-1) / self.weights.sum(axis=-1)
        self.strays = np.clip(strays, _LEAST_STRAYS, _MOST_STRAYS)
        self.noise = noise
        return np.where(settled, moved, np.inf)

    def _members(self) -> Array:
        """Probabilities (B, K + 1, N), strays last, times the weights."""
        noise = self.noise[:, None]
        std = noise * self.scale
        layer = np.exp(self.log_area) + 4.0 * np.pi * noise**2
        heads = np.log((1.0 - self.strays[:, None]) * self.shares / layer)
        logs = np.empty((len(std), self.shares.shape[1] + 1, std.shape[1]))
        logs[:, :-1] = heads[..., None] - 0.5 * (self.distance / std[:, None]) ** 2
        logs[:, :-1] -= np.log(std * np.sqrt(2.0 * np.pi))[:, None]
        logs[:, -1] = np.log(self.strays / self.volume)[:, None]
        logs -= logs.max(axis=1, keepdims=True)
        np.exp(logs, out=logs)
        return np.asarray(logs * (self.weights / logs.sum(axis=1))[:, None])

    def _move(self, member: Array) -> Array:
        """Move each part by a Levenberg-Marquardt step if that lowers its objective."""
        count = len(SHAPE_NAMES)
        weight = member[:, :-1] / (self.noise[:, None] * self.scale)[:, None] ** 2
        inliers = member[:, :-1].sum(axis=-1)
        weighted = self.jacobian * weight[:, :, None]
        curvature = weighted @ np.swapaxes(self.jacobian, -1, -2)
        slope = (weighted @ self.distance[..., None])[..., 0]
        slope[..., :count] += inliers[..., None] * self.area_slope
        slope[..., 3:count] += (_coordinates(self.shapes) - _USUAL) / PRIOR_STD[3:] ** 2
        curvature[..., np.arange(count), np.arange(count)] += 1.0 / PRIOR_STD**2
        held = self.chart.held(self.shapes.shape, slope)
        move = _damped(curvature, np.where(held, 0.0, slope), held, self.damping)
        moved: Array = np.abs(np.swapaxes(self.jacobian, -1, -2) @ move[..., None]).max(
            axis=(1, 2, 3)
        )
        shapes = self.chart.moved(self.shapes, move)
        area, area_slope = areas(shapes.shape)
        distance, jacobian = self.chart.linearise(shapes, self.points)
        before = _objective(self.shapes, self.distance, self.log_area, weight, inliers)
        after = _objective(shapes, distance, np.log(area), weight, inliers)
        better = after <= before
        self.damping = np.where(
            better, np.maximum(0.2 * self.damping, 1e-9), np.minimum(10.0 * self.damping, 1e6)
        )
        self.shapes = shapes.where(better, self.shapes)
        for name, value in (
            ("log_area", np.log(area)),
            ("area_slope", area_slope),
            ("distance", distance),
            ("jacobian", jacobian),
        ):
            chosen = better.reshape(better.shape + (1,) * (value.ndim - 2))
            setattr(
                self, name, value if better.all() else np.where(chosen, value, getattr(self, name))
            )
        return moved


def _objective(
    shapes: Placed, distance: Array, log_area: Array, weight: Array, inliers: Array
) -> Array:
    """What a step lowers (B, K): squares, the logarithm of the area, the prior."""
    apart = (_coordinates(shapes) - _USUAL) / PRIOR_STD[3:]
    squares = np.sum(weight * distance**2, axis=-1)
    return np.asarray(0.5 * squares + inliers * log_area + 0.5 * np.sum(apart**2, axis=-1))


def _coordinates(shapes: Placed) -> Array:
    """Exponents and tapers (..., 4)."""
    return np.concatenate([shapes.shape.exponents, shapes.shape.taper], axis=-1)


def _damped(curvature: Array, slope: Array, held: NDArray[np.bool_], damping: Array) -> Array:
    """Return steps (..., P) against slopes; those that are held are zero."""
    free = ~held
    system = curvature * (free[..., :, None] & free[..., None, :])
    diagonal = np.where(held, 1.0, np.einsum("...ii->...i", curvature))
    index = np.arange(slope.shape[-1])
    system[..., index, index] = diagonal * (1.0 + damping[..., None])
    return np.asarray(-np.linalg.solve(system, slope[..., None])[..., 0])
