"""Gauss-Newton on a chain of nodes with a few numbers common to all."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from tactile_dynamics_ros.core.array import Array

_GROWTH, _SHRINK = 6.0, 0.15
"""By what damping grows after a step that failed and shrinks after one that succeeded; they change
the path, not the optimum."""
_LEAST_DAMPING = 1e-9
"""Damping below which steps are plain Gauss-Newton: a billionth of a pose's information; a
larger one slows the last steps."""
_HELD = (1e3, 1e6)
"""Multiples of the damping that are added in turn where equations are singular to double precision:
it happens far from the data, where a fit is no answer but must go on."""
_IDLE = 3
"""Damped steps in a row with immaterial falls that end the iteration; one may be small by
chance."""
_REJECTED = 12
"""Failures in a row that end the iteration: by then the damping has grown by 6^12."""

_OF_REJECTED = 0.2
"""What a step that failed counts of the iterations where its cost alone was computed: its time over
that of one with derivatives. At 1 first stages of objects that turn on the spot lead nowhere."""


@dataclass(eq=False)
class Cost:
    """Sum of squares of rows, whatever their derivatives; takes the same rows as the equations.

    Attributes:
        cost: of rows, and what is `linear` in the numbers. rows: count of them.
    """

    cost: float = field(default=0.0, init=False)
    linear: float = field(default=0.0, init=False)
    rows: int = field(default=0, init=False)

    def count(self, residual: Array) -> None:
        """Add the squares of rows of any shape."""
        self.cost += float(np.sum(residual * residual))
        self.rows += residual.size

    def add(
        self,
        middle: NDArray[np.intp],
        residual: Array,
        by_nodes: Array,
        by_common: Array | None = None,
    ) -> None:
        """Add rows.

        Args:
            middle: (R,) middle node of the three that each group of rows reads.
            residual: (R, r).
            by_nodes: (R, r, 3, b) derivative.
            by_common: (R, r, p) derivative, None for 0.
        """
        self.count(residual)

    def add_separate(
        self,
        middle: NDArray[np.intp],
        residual: Array,
        weights: Array,
        first: int = 0,
        by_common: Array | None = None,
    ) -> None:
        """Add rows each of which reads one number of three nodes in a row.

        Args:
            middle: (R,) middle node.
            residual: (R, r); the k-th reads the number `first` + k of each node.
            weights: (R, r, 3) derivative by it.
            first: number that the first row reads.
            by_common: (R, r, p) derivative, None for 0.
        """
        self.count(residual)

    def add_common(self, residual: Array, by_common: Array) -> None:
        """Add rows (R,) that read the common numbers alone, derivative (R, p)."""
        self.count(residual)

    def add_slope(self, slope: Array, common: Array) -> None:
        """Add -2 slope . common to the cost: a part of the log probability that is linear."""
        linear = 2.0 * float(slope @ common)
        self.cost, self.linear = self.cost - linear, self.linear - linear


@dataclass(eq=False)
class NormalEquations(Cost):
    """H = J^T J and g = J^T r of rows that read three nodes in a row and the common numbers.

    Attributes:
        nodes: N. size: b numbers of each node. common: p numbers.
    """

    nodes: int
    size: int
    common: int
    blocks: Array = field(init=False)
    border: Array = field(init=False)
    corner: Array = field(init=False)
    gradient: Array = field(init=False)
    common_gradient: Array = field(init=False)

    def __post_init__(self) -> None:
        b, p = self.size, self.common
        self.blocks = np.zeros((self.nodes, 3, b, b))
        self.border = np.zeros((self.nodes, b, p))
        self.corner = np.zeros((p, p))
        self.gradient = np.zeros((self.nodes, b))
        self.common_gradient = np.zeros(p)

    def add(
        self,
        middle: NDArray[np.intp],
        residual: Array,
        by_nodes: Array,
        by_common: Array | None = None,
    ) -> None:
        """Add rows that read three nodes in a row and the common numbers."""
        super().add(middle, residual, by_nodes, by_common)
        b = self.size
        flat = by_nodes.reshape(len(residual), residual.shape[1], 3 * b)
        left = np.ascontiguousarray(flat.swapaxes(1, 2))
        squares = left @ flat
        gradient = (left @ residual[..., None])[..., 0]
        border = None if by_common is None else left @ by_common
        for i in range(3):
            at = np.clip(middle + i - 1, 0, self.nodes - 1)
            rows = slice(i * b, (i + 1) * b)
            _add_at(self.gradient, at, gradient[:, rows])
            if border is not None:
                _add_at(self.border, at, border[:, rows])
            for j in range(i, 3):
                _add_at(self.blocks[:, j - i], at, squares[:, rows, j * b : (j + 1) * b])
        self._add_corner(residual, by_common)

    def add_separate(
        self,
        middle: NDArray[np.intp],
        residual: Array,
        weights: Array,
        first: int = 0,
        by_common: Array | None = None,
    ) -> None:
        """Add rows each of which reads one number of three nodes in a row."""
        super().add_separate(middle, residual, weights, first, by_common)
        read = slice(first, first + residual.shape[1])
        for i in range(3):
            at = np.clip(middle + i - 1, 0, self.nodes - 1)
            _add_at(self.gradient[:, read], at, weights[:, :, i] * residual)
            if by_common is not None:
                _add_at(self.border[:, read], at, weights[:, :, i, None] * by_common)
            for j in range(i, 3):
                diagonal = np.einsum("nkk->nk", self.blocks[:, j - i, read, read])
                _add_at(diagonal, at, weights[:, :, i] * weights[:, :, j])
        self._add_corner(residual, by_common)

    def _add_corner(self, residual: Array, by_common: Array | None) -> None:
        if by_common is None:
            return
        flat = by_common.reshape(-1, self.common)
        self.corner += flat.T @ flat
        self.common_gradient += flat.T @ residual.ravel()

    def add_common(self, residual: Array, by_common: Array) -> None:
        """Add rows (R,) that read the common numbers alone, derivative (R, p)."""
        super().add_common(residual, by_common)
        self.corner += by_common.T @ by_common
        self.common_gradient += by_common.T @ residual

    def add_slope(self, slope: Array, common: Array) -> None:
        """Add -2 slope . common to the cost: a part of the log probability that is linear."""
        super().add_slope(slope, common)
        self.common_gradient -= slope

    def log_determinant_of_nodes(self, damping: Array, kept: int) -> float:
        """Logarithm of det H of the nodes' first numbers alone.

        Args:
            damping: (N, b) added to the diagonal.
            kept: how many numbers of each node.
        """
        chain = self._factored_chain(damping, kept)
        return 2.0 * float(np.sum(np.log(chain[0])))

    def _factored_chain(self, damping: Array, b: int) -> Array:
        """Banded Cholesky factor of the nodes' first b numbers."""
        n = self.nodes
        blocks = self.blocks[:, :, :b, :b].copy()
        blocks[:, 0, np.arange(b), np.arange(b)] += damping[:, :b]
        band = np.zeros((3 * b, n, b))
        for lag in range(3):
            for row in range(b):
                for column in range(b):
                    below = lag * b + row - column
                    if below >= 0:
                        band[below, : n - lag, column] = blocks[: n - lag, lag, column, row]
        flat = band.reshape(3 * b, n * b)
        held = damping[:, :b].reshape(-1)
        for more in _HELD:
            with suppress(np.linalg.LinAlgError):
                return np.asarray(cholesky_banded(flat, lower=True, check_finite=False))
            flat[0] += more * held
        return np.asarray(cholesky_banded(flat, lower=True, check_finite=False))

    def factor(self, node_damping: Array, common_damping: Array) -> Factor:
        """Factor H with these added to its diagonal, (N, b) and (p,)."""
        n, b = self.nodes, self.size
        chain = self._factored_chain(node_damping, b)
        border = self.border.reshape(n * b, self.common)
        inner = cho_solve_banded((chain, True), border, check_finite=False)
        schur = self.corner + np.diag(common_damping) - border.T @ inner
        return Factor(self, chain, inner, 0.5 * (schur + schur.T))


def _add_at(target: Array, at: NDArray[np.intp], values: Array) -> None:
    """Add rows to those of a view, several to one where an index occurs more than once."""
    change = np.diff(at)
    if np.all(change == 1):
        target[at[0] : at[-1] + 1] += values
        return
    if np.any(change < 0):
        order = np.argsort(at, kind="stable")
        at, values = at[order], values[order]
        change = np.diff(at)
    if not np.all(change > 0):
        starts = np.flatnonzero(np.append(1, change))
        at, values = at[starts], np.add.reduceat(values, starts, axis=0)
    target[at] += values


@dataclass(eq=False)
class Factor:
    """Cholesky factor of the chain and Schur complement of the common numbers."""

    equations: NormalEquations
    chain: Array
    inner: Array
    schur: Array

    def step(self) -> tuple[Array, Array]:
        """Gauss-Newton step of nodes (N, b) and common numbers (p,)."""
        e = self.equations
        alone = cho_solve_banded((self.chain, True), e.gradient.ravel(), check_finite=False)
        border = e.border.reshape(-1, e.common)
        right = e.common_gradient - border.T @ alone
        common = -cho_solve(cho_factor(self.schur), right)
        return (-alone - self.inner @ common).reshape(e.nodes, e.size), common

    def moved_by(
        self, middle: NDArray[np.intp], rows: Array, by_nodes: Array, by_common: Array
    ) -> Array:
        """Changes (p, K) of the common numbers by small changes of residuals.

        Args:
            middle: (R,) middle node of the three that each group of rows reads.
            rows: (R, r, K) changes of the residuals.
            by_nodes: (R, r, 3, b) derivative.
            by_common: (R, r, p) derivative.
        """
        e = self.equations
        gradient = np.zeros((e.nodes, e.size, rows.shape[2]))
        for i in range(3):
            at = np.clip(middle + i - 1, 0, e.nodes - 1)
            _add_at(gradient, at, by_nodes[:, :, i].swapaxes(1, 2) @ rows)
        flat = gradient.reshape(e.nodes * e.size, -1)
        right = np.einsum("rip,rik->pk", by_common, rows) - self.inner.T @ flat
        return np.asarray(-cho_solve(cho_factor(self.schur), right))

    @property
    def covariance(self) -> Array:
        """(p, p) of the common numbers."""
        return np.asarray(np.linalg.inv(self.schur))

    @property
    def log_determinant(self) -> float:
        """Logarithm of det H."""
        return 2.0 * float(np.sum(np.log(self.chain[0]))) + float(np.linalg.slogdet(self.schur)[1])


@dataclass(frozen=True, eq=False)
class Solution:
    """Best nodes and common numbers, equations there, and whether the iteration ended itself."""

    nodes: Array
    common: Array
    equations: NormalEquations
    settled: bool

    @property
    def misfit(self) -> float:
        """Root of the cost over rows less unknowns: error of one-step predictions over its std."""
        unknowns = self.nodes.size + len(self.common)
        squares = self.equations.cost - self.equations.linear
        return float(np.sqrt(squares / max(self.equations.rows - unknowns, 1)))


def minimise(
    linearise: Callable[[Array, Array], NormalEquations],
    nodes: Array,
    common: Array,
    node_scale: Array,
    common_scale: Array,
    iterations: int,
    tolerance: float,
    cost: Callable[[Array, Array], float] | None = None,
) -> Solution:
    """Minimise the cost by damped Gauss-Newton steps.

    Args:
        linearise: equations at nodes (N, b) and common numbers (p,).
        nodes: (N, b) start.
        common: (p,) start.
        node_scale: (b,) sizes in whose inverse squares damping is counted.
        common_scale: (p,) likewise.
        iterations: steps at most; those that fail count less where `cost` is given.
        tolerance: fall of the cost below which it has converged.
        cost: of the equations, where that is cheaper without derivatives: half of all steps fail.
    """
    best = linearise(nodes, common)
    damping, failures, idle, settled = 1e-3, 0, 0, False
    left = float(iterations)
    while left > 0.0:
        at_nodes = np.broadcast_to(damping / np.square(node_scale), nodes.shape)
        try:
            step, common_step = best.factor(at_nodes, damping / np.square(common_scale)).step()
        except np.linalg.LinAlgError:
            damping, failures = max(damping, 1e-6) * _GROWTH, failures + 1
            left -= 1.0
            continue
        ahead = nodes + step, common + common_step
        trial = None
        with np.errstate(all="ignore"):  # what a step too far makes is no number, and refused
            if cost:
                there = cost(*ahead)
            else:
                trial = linearise(*ahead)
                there = trial.cost
        if np.isfinite(there) and there <= best.cost:
            idle = idle + 1 if best.cost - there <= tolerance else 0
            settled = idle > 0 and (damping <= 1e-2 or idle >= _IDLE)
            nodes, common = ahead
            best = trial or linearise(*ahead)
            left -= 1.0
            damping, failures = max(damping * _SHRINK, _LEAST_DAMPING), 0
            if settled:
                break
        else:
            damping, failures = max(damping, 1e-6) * _GROWTH, failures + 1
            left -= _OF_REJECTED if cost else 1.0
            settled = failures >= _REJECTED
            if settled:
                break
    return Solution(nodes, common, best, settled)
