"""iSAM2 on one inertial variable and one summary of all data."""

from __future__ import annotations

import math

import gtsam
import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.least_squares import levenberg_marquardt
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_log_cholesky,
    log_cholesky,
    log_cholesky_factor,
    log_cholesky_factor_derivatives,
    log_cholesky_jacobian,
)

INERTIA_KEY = gtsam.symbol("x", 0)
"""Name of the one variable of the factor graph: the log-Cholesky coordinates. Any other name does
the same in a graph of one variable."""

_UPPER_ROWS = np.array([0, 1, 0, 0, 1, 2])
"""Rows of the entries above the diagonal of a 4 x 4 matrix, in the order of the coordinates. Fixed
by the order of the coordinates; elsewhere the prior would hold other entries than it states."""
_UPPER_COLUMNS = np.array([1, 2, 2, 3, 3, 3])
"""Columns of these entries. Fixed with the rows."""
_ROWS = np.concatenate([np.arange(4), _UPPER_ROWS])
"""Rows of the ten entries of an upper triangle: the diagonal, then those above it. They follow from
those above."""
_COLUMNS = np.concatenate([np.arange(4), _UPPER_COLUMNS])
"""Columns of these ten entries; they follow from those above."""
_NEAR_ONE = 1e-4
"""Distance from 1 within which sqrt(x^2 - 2 log x - 1) is taken from its series: it leaves out a
term of 1e-12, where the formula itself has lost eight of sixteen digits. At 1e-2 the series is off
by 1e-6; below 1e-8 the formula has lost all its digits."""
_SMALLEST_RATIO = 1e-150
"""Ratio of Cholesky entries that is taken at least, so that its square and logarithm exist (the
least double is 2e-308). Any number between the rounding of 1 and there has the same effect: such
bodies are far from every optimum."""
_MAXIMUM_ROUNDS = 8
"""Undamped steps after one exchange of the data, at most. What is then left is done in the next
update, or by the damped search if steps do not shrink. The bound limits the time of an update;
fewer let estimates lag behind the data where they move far."""
_STEP_TOLERANCE = 1e-3
"""Largest change of a coordinate (logarithms, m) after which the steps end: 0.1 % of a scale, or 1
mm. Near the optimum the step after is its square, and the next update goes on from there, so that
the rest does not add up. Smaller takes one more step for each update."""
_SHRINKING = 0.9
"""Largest ratio of an undamped step to the one before that promises an end. Steps of Gauss and
Newton near the optimum shrink far more; at 1 a circling search would go on to `_MAXIMUM_ROUNDS`."""
_ENOUGH = 1e-4
"""Relative fall of the cost below which the damped steps end. The next update goes on from there,
so that more digits only cost time."""
_MANY_STEPS, _FEW_STEPS = 15, 8
"""Damped steps at most: from a start far away, and to an optimum nearby. They end earlier by
`_ENOUGH`; the bound limits the time of an update. Fewer publish unfinished searches after a jump,
more make single updates late."""
_LARGEST_LOGARITHM = 40.0
"""Logarithm beyond which a body is out of all scales and the search has diverged: e^40 = 2e17,
whose square a double still holds with room for products."""
_ROUNDING = 1e-10
"""Share of the sum of second moments that is added to each of them, so that rounding cannot make a
published body impossible: a thickness of 1e-5 of its size. A hundred times less is within rounding
of large bodies and lets impossible ones out; from 1e-6 on thin plates would be reported too
thick."""


class _Diverged(Exception):
    """Undamped steps do not shrink, or led to a body beyond all scales."""


def _bounded(xi: Array) -> Array:
    """Coordinates with logarithms that can be exponentiated."""
    return np.concatenate([np.clip(xi[:4], -_LARGEST_LOGARITHM, _LARGEST_LOGARITHM), xi[4:]])


class DivergencePrior:
    """Entropic prior weight * (tr(P0^-1 P) - log det(P0^-1 P) - 4) as a sum of squares.

    With P = U U^T, P0 = U0 U0^T and M = U0^-1 U (upper triangular) the divergence is
    sum_{i<j} M_ij^2 + sum_i (M_ii^2 - 2 log M_ii - 1); each term is the square of a smooth error.
    Source: Lee, Wensing, Park 2020, Eq. 17; paper A, Eq. 16 lacks the log det, without which the
    optimum is P = 0.

    Attributes:
        mean: (10,) log-Cholesky coordinates of P0.
        hold: (10, 10) rows that hold xi - mean where the data say nothing; zero where they do.
    """

    def __init__(self, mean: Array, weight: float) -> None:
        """Centre the prior at log-Cholesky coordinates `mean` (10,) with `weight` nats."""
        self.mean = np.asarray(mean, dtype=float)
        self.hold = np.zeros((10, 10))
        self._inverse = np.linalg.inv(log_cholesky_factor(self.mean))
        self._scale = math.sqrt(2.0 * weight)

    def cost(self, xi: Array) -> float:
        """Divergence, and half the square of what is held."""
        held = self.hold @ (xi - self.mean)
        return self.divergence(xi) + 0.5 * float(held @ held)

    def held_error(self, xi: Array) -> tuple[Array, Array]:
        """Error (20,) with `cost` = |error|^2 / 2, and its Jacobian (20, 10)."""
        error, jacobian = self.error(xi)
        held = self.hold @ (xi - self.mean)
        return np.concatenate([error, held]), np.concatenate([jacobian, self.hold])

    def divergence(self, xi: Array) -> float:
        """Prior cost: weight (tr(P0^-1 P) - log det(P0^-1 P) - 4)."""
        ratio = self._inverse @ log_cholesky_factor(xi)
        excess = (ratio * ratio).sum() - 2.0 * np.log(ratio.diagonal()).sum() - 4.0
        return float(0.5 * self._scale**2 * excess)

    def error(self, xi: Array) -> tuple[Array, Array]:
        """Error e (10,) with weight * divergence = |e|^2 / 2, and its Jacobian (10, 10)."""
        factor = log_cholesky_factor(xi)
        ratio = self._inverse @ factor
        derivatives = self._inverse @ log_cholesky_factor_derivatives(factor)
        value, slope = np.transpose([_root_excess(x) for x in ratio.diagonal().tolist()])
        error = np.concatenate([value, ratio[_UPPER_ROWS, _UPPER_COLUMNS]])
        jacobian = derivatives[:, _ROWS, _COLUMNS].T
        jacobian[:4] *= slope[:, None]
        return self._scale * error, self._scale * jacobian


def _root_excess(x: float) -> tuple[float, float]:
    """sign(x - 1) sqrt(x^2 - 2 log x - 1) and its derivative, smooth through x = 1."""
    gap = x - 1.0
    if abs(gap) < _NEAR_ONE:
        return math.sqrt(2.0) * (gap - gap**2 / 6.0), math.sqrt(2.0) * (1.0 - gap / 3.0)
    x = max(x, _SMALLEST_RATIO)
    root = math.copysign(math.sqrt(x * x - 2.0 * math.log(x) - 1.0), gap)
    return root, (x - 1.0 / x) / root


class SummarySolver:
    """Keeps iSAM2 at the optimum while the one factor that summarises all data is replaced."""

    def __init__(self, prior: DivergencePrior) -> None:
        """Start at the prior."""
        self._prior = prior
        self._rounded: Array | None = None
        self._summary_index: list[int] = []
        self._start(prior.mean)

    @property
    def xi(self) -> Array:
        """Log-Cholesky coordinates (10,) of the present estimate.

        Its second moments grow by 1e-10 of their sum, so that rounding cannot make P indefinite.
        """
        if self._rounded is None:
            factor = log_cholesky_factor(self._xi)
            matrix = factor @ factor.T
            matrix[range(3), range(3)] += _ROUNDING * np.trace(matrix[:3, :3])
            self._rounded = log_cholesky(matrix)
        return self._rounded

    def replace_summary(self, factor: Array, target: Array) -> None:
        """Exchange the data's [R | d] on phi and iterate until the step is small."""
        start = self._xi
        graph = gtsam.NonlinearFactorGraph()
        graph.add(self._summary_factor(factor, target))
        try:
            if self._iterate(graph) == 0:
                return
            before, after = (self._cost(x, factor, target) for x in (start, self._xi))
        except (RuntimeError, _Diverged):
            before, after = 0.0, np.inf
        if not after <= before * (1.0 + 1e-9) + 1e-9:
            self._recover(start, factor, target)

    def nearby_optimum(self, factor: Array, target: Array) -> Array:
        """Coordinates xi (10,) of the optimum for another [R | d], a few damped steps away."""
        return self._damped(self._xi, factor, target, _FEW_STEPS)

    def hold(self, rows: Array) -> None:
        """Hold rows (10, 10) of xi - mean from now on; iSAM2 starts anew where it is."""
        self._prior.hold = rows
        self._start(self._xi)

    def prior_information(self, xi: Array) -> Array:
        """Information (10, 10) of the prior alone at coordinates xi (10,)."""
        _, jacobian = self._prior.error(xi)
        return np.asarray(jacobian.T @ jacobian)

    def _start(self, xi: Array) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(1e-9)
        parameters.findUnusedFactorSlots = True
        self._isam = gtsam.ISAM2(parameters)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(self._prior_factor())
        values.insert(INERTIA_KEY, xi)
        self._isam.update(graph, values)
        self._summary_index = []
        self._move(np.array(xi))

    def _iterate(self, graph: gtsam.NonlinearFactorGraph) -> int:
        """Exchange the factor; return the number of steps before one that is small."""
        removed = self._summary_index
        result = self._isam.update(graph, gtsam.Values(), removed)
        self._summary_index = list(result.getNewFactorsIndices())
        last = np.inf
        for count in range(_MAXIMUM_ROUNDS):
            previous = self._xi
            self._move(self._isam.calculateEstimateVector(INERTIA_KEY))
            step = float(np.abs(self._xi - previous).max())
            if step < _STEP_TOLERANCE:
                return count
            if step > _SHRINKING * last or np.abs(self._xi[:4]).max() > _LARGEST_LOGARITHM:
                raise _Diverged
            self._isam.update()
            last = step
        return _MAXIMUM_ROUNDS

    def _move(self, xi: Array) -> None:
        self._xi, self._rounded = xi, None

    def _recover(self, start: Array, factor: Array, target: Array) -> None:
        """Solve the same problem by damped steps from `start` and restart iSAM2 there."""
        best = self._damped(start, factor, target, _MANY_STEPS)
        self._start(best)
        graph = gtsam.NonlinearFactorGraph()
        graph.add(self._summary_factor(factor, target))
        try:
            result = self._isam.update(graph, gtsam.Values())
        except RuntimeError:
            self._start(best)
            return
        self._summary_index = list(result.getNewFactorsIndices())

    def _damped(self, start: Array, factor: Array, target: Array, steps: int) -> Array:
        """Coordinates xi (10,) after at most so many damped steps."""
        rows = len(target) + 20

        def evaluate(xi: Array) -> tuple[Array, Array]:
            if np.abs(xi[:4]).max() > _LARGEST_LOGARITHM:
                return np.full(rows, np.inf), np.zeros((rows, 10))
            return self._stacked(xi, factor, target)

        return levenberg_marquardt(evaluate, start, steps, _ENOUGH)[0]

    def _cost(self, xi: Array, factor: Array, target: Array) -> float:
        """Sum of squared errors of data and prior."""
        data = factor @ dynamic_parameters_from_log_cholesky(xi) - target
        return float(data @ data + 2.0 * self._prior.cost(xi))

    def _stacked(self, xi: Array, factor: Array, target: Array) -> tuple[Array, Array]:
        """Errors of data and prior, and their Jacobian by xi."""
        data, by_data = _summary_error(xi, factor, target)
        prior, by_prior = self._prior.held_error(xi)
        return np.concatenate([data, prior]), np.concatenate([by_data, by_prior])

    def _prior_factor(self) -> gtsam.CustomFactor:
        def error(
            _: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
        ) -> Array:
            value, jacobian = self._prior.held_error(_bounded(values.atVector(INERTIA_KEY)))
            if jacobians is not None:
                jacobians[0] = jacobian
            return value

        return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(20), [INERTIA_KEY], error)

    def _summary_factor(self, factor: Array, target: Array) -> gtsam.CustomFactor:
        def error(
            _: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Array] | None
        ) -> Array:
            xi = _bounded(values.atVector(INERTIA_KEY))
            value, jacobian = _summary_error(xi, factor, target)
            if jacobians is not None:
                jacobians[0] = jacobian
            return value

        noise = gtsam.noiseModel.Unit.Create(len(target))
        return gtsam.CustomFactor(noise, [INERTIA_KEY], error)


def _summary_error(xi: Array, factor: Array, target: Array) -> tuple[Array, Array]:
    """R phi(xi) - d and its derivative by xi."""
    phi = dynamic_parameters_from_log_cholesky(xi)
    return factor @ phi - target, factor @ log_cholesky_jacobian(xi)
