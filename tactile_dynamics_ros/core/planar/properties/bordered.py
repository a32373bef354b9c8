"""Gauss-Newton on a chain of nodes with a few numbers common to all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

Array = NDArray[np.float64]

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


@dataclass(eq=False)
class NormalEquations:
    """H = J^T J and g = J^T r of rows that read three nodes in a row and the common numbers.

    Attributes:
        nodes: N. size: b numbers of each node. common: p numbers.
    """

    nodes: int
    size: int
    common: int
    cost: float = 0.0
    rows: int = 0
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
        """Add rows.

        Args:
            middle: (R,) middle node of the three that each group of rows reads.
            residual: (R, r).
            by_nodes: (R, r, 3, b) derivative.
            by_common: (R, r, p) derivative, None for 0.
        """
        self.cost += float(np.sum(residual * residual))
        self.rows += residual.size
        for i in range(3):
            left = by_nodes[:, :, i].swapaxes(1, 2)
            at = np.clip(middle + i - 1, 0, self.nodes - 1)
            _add_at(self.gradient, at, (left @ residual[..., None])[..., 0])
            if by_common is not None:
                _add_at(self.border, at, left @ by_common)
            for j in range(i, 3):
                _add_at(self.blocks[:, j - i], at, left @ by_nodes[:, :, j])
        if by_common is None:
            return
        flat = by_common.reshape(-1, self.common)
        self.corner += flat.T @ flat
        self.common_gradient += flat.T @ residual.ravel()

    def add_common(self, residual: Array, by_common: Array) -> None:
        """Add rows (R,) that read the common numbers alone, derivative (R, p)."""
        self.cost += float(residual @ residual)
        self.rows += len(residual)
        self.corner += by_common.T @ by_common
        self.common_gradient += by_common.T @ residual

    def add_slope(self, slope: Array, common: Array) -> None:
        """Add -2 slope . common to the cost: a part of the log probability that is linear."""
        self.cost -= 2.0 * float(slope @ common)
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
    if np.all(np.diff(at) > 0):
        target[at] += values
        return
    rows = np.arange(len(at))
    gather = csr_array((np.ones(len(at)), (at, rows)), shape=(len(target), len(at)))
    target += (gather @ values.reshape(len(at), -1)).reshape(target.shape)


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
        return float(np.sqrt(self.equations.cost / max(self.equations.rows - unknowns, 1)))


@dataclass(frozen=True, eq=False)
class Optimum:
    """Best nodes and numbers at one variation of friction.

    Attributes:
        solution: of the fit. covariance: (p, p) of the common numbers, with the step still to go.
        evidence: log probability of the data. pending: that step, in standard deviations.
        variation: relative, of friction from place to place.
    """

    solution: Solution
    covariance: Array
    evidence: float
    pending: float
    variation: float

    @classmethod
    def of(cls, found: Solution, factor: Factor, evidence: float, variation: float) -> Optimum:
        """Take the covariance from a factor of the solution's equations."""
        covariance = factor.covariance
        _, step = factor.step()
        pending = float(np.sqrt(step @ np.linalg.solve(covariance, step)))
        return cls(found, covariance + np.outer(step, step), evidence, pending, variation)

    @property
    def misfit(self) -> float:
        """Error of one-step predictions over its std, of the solution."""
        return self.solution.misfit


def average(trials: Sequence[Optimum]) -> tuple[Optimum, Array, Array]:
    """Mean over variations by their evidence: the likeliest, numbers (p,) and covariance (p, p).

    Covariances are widened by the misfit, and by how the optima differ.
    """
    evidence = np.array([trial.evidence for trial in trials])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    common = np.sum([w * t.solution.common for w, t in zip(weight, trials, strict=True)], axis=0)
    covariance = np.zeros((len(common), len(common)))
    for w, trial in zip(weight, trials, strict=True):
        away = trial.solution.common - common
        covariance += w * (max(1.0, trial.misfit**2) * trial.covariance + np.outer(away, away))
    return trials[int(np.argmax(weight))], np.asarray(common), covariance


def minimise(
    linearise: Callable[[Array, Array], NormalEquations],
    nodes: Array,
    common: Array,
    node_scale: Array,
    common_scale: Array,
    iterations: int,
    tolerance: float,
) -> Solution:
    """Minimise the cost by damped Gauss-Newton steps.

    Args:
        linearise: equations at nodes (N, b) and common numbers (p,).
        nodes: (N, b) start.
        common: (p,) start.
        node_scale: (b,) sizes in whose inverse squares damping is counted.
        common_scale: (p,) likewise.
        iterations: evaluations at most.
        tolerance: fall of the cost below which it has converged.
    """
    best = linearise(nodes, common)
    damping, failures, idle, settled = 1e-3, 0, 0, False
    for _ in range(iterations):
        at_nodes = np.broadcast_to(damping / np.square(node_scale), nodes.shape)
        try:
            step, common_step = best.factor(at_nodes, damping / np.square(common_scale)).step()
        except np.linalg.LinAlgError:
            damping, failures = max(damping, 1e-6) * _GROWTH, failures + 1
            continue
        trial = linearise(nodes + step, common + common_step)
        if np.isfinite(trial.cost) and trial.cost <= best.cost:
            idle = idle + 1 if best.cost - trial.cost <= tolerance else 0
            settled = idle > 0 and (damping <= 1e-2 or idle >= _IDLE)
            nodes, common, best = nodes + step, common + common_step, trial
            damping, failures = max(damping * _SHRINK, _LEAST_DAMPING), 0
            if settled:
                break
        else:
            damping, failures = max(damping, 1e-6) * _GROWTH, failures + 1
            settled = failures >= _REJECTED
            if settled:
                break
    return Solution(nodes, common, best, settled)
