"""An effect whose wrench is given by formulas: fast functions of samples with derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np
import sympy
from scipy.optimize import least_squares

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.formula.quantities import (
    COM,
    MASS,
    Quantity,
    quantity_values,
)
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError

Exponents = tuple[int, ...]

_LOAD = (MASS, *COM)
"""Symbols of the load, kg and m, by which laws are differentiated too; in the order in which the
compiled laws take them."""
_TRIED, _SIZES = 200, (-2.0, 2.0)
"""Draws of all quantities with which a law is evaluated where it is not zero as it is written, and
the decimal logarithms of their sizes, SI: from 1 cm/s or 10 mN to 100 m/s or 100 N."""
_ZERO = 1e-6
"""Wrench, N or N m, that counts as none there: rounding of sums of 1e6, a cube of 100."""


@dataclass(frozen=True)
class Law:
    """One wrench [torque, force] about the body origin, body axes, of named quantities.

    Attributes:
        expressions: 6 sympy expressions.
        quantities: what each symbol of the expressions stands for.
        parameters: symbols of all parameters of the effect, k of them.
        each_contact: whether the wrenches of all contacts are summed.
    """

    expressions: tuple[Any, ...]
    quantities: dict[Any, Quantity]
    parameters: tuple[Any, ...]
    each_contact: bool

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Wrench (N, 6)."""
        return self._evaluate(self._value, samples, inertia, theta)

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Derivative by theta, (N, 6, k)."""
        flat = self._evaluate(self._by_parameters, samples, inertia, theta)
        return flat.reshape(len(flat), 6, -1)

    def load_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Derivative by mass and centre of mass, (N, 6, 4)."""
        if not self.depends_on_load:
            return np.zeros((len(samples.time), 6, 4))
        flat = self._evaluate(self._by_load, samples, inertia, theta)
        return flat.reshape(len(flat), 6, 4)

    def terms(
        self, samples: WrenchSamples, inertia: Array, theta: Array, linear: Sequence[int]
    ) -> dict[Exponents, Array]:
        """Wrenches (N, 6) that the powers of the linear parameters multiply, by exponents."""
        functions = self._terms(tuple(linear))
        return {e: self._evaluate(f, samples, inertia, theta) for e, f in functions.items()}

    @property
    def depends_on_load(self) -> bool:
        """Whether mass or centre of mass occurs."""
        return any(e.has(*_LOAD) for e in self.expressions)

    @property
    def reads_sensors(self) -> bool:
        """Whether measured forces or torques occur."""
        read = [s for s, q in self.quantities.items() if q.kind in ("f", "couple", "grip")]
        return any(expression.has(*read) for expression in self.expressions) if read else False

    def is_polynomial(self, indices: Sequence[int]) -> bool:
        """Whether the wrench is a polynomial in these parameters."""
        chosen = [self.parameters[i] for i in indices]
        return all(e.is_polynomial(*chosen) for e in self.expressions)

    def degree(self) -> int:
        """Highest total degree in the parameters, of a polynomial wrench."""
        return max(sum(e) for e in self._expand(tuple(range(len(self.parameters)))))

    def vanishes_at_absence(self) -> bool:
        """Whether the wrench is zero with all parameters zero, at quantities of all sizes."""
        zero = dict.fromkeys(self.parameters, 0)
        rest = [e.subs(zero) for e in self.expressions]
        if all(value == 0 for value in rest):
            return True
        rng = np.random.default_rng(0)
        size = (len(self.quantities) + len(_LOAD), _TRIED)
        drawn: Array = rng.choice([-1.0, 1.0], size) * 10.0 ** rng.uniform(*_SIZES, size)
        return not np.any(np.abs(self._at(rest, drawn)) > _ZERO)

    def has_value_at_absence(self) -> bool:
        """Whether the wrench is finite with all parameters zero, at unremarkable quantities."""
        ordinary: Array = 0.3 + 0.1 * np.arange(float(len(self.quantities) + len(_LOAD)))
        return bool(np.isfinite(self._at(self.expressions, ordinary[:, None])).all())

    def _at(self, expressions: Sequence[Any], quantities: Array) -> Array:
        """Values (6, N) of expressions at quantities (K, N), with all parameters zero."""
        with np.errstate(all="ignore"):
            found = self._compile(expressions)(*quantities, *np.zeros(len(self.parameters)))
        shape = quantities.shape[1:]
        return np.array([np.broadcast_to(np.asarray(value, float), shape) for value in found])

    @cached_property
    def _value(self) -> Callable[..., Any]:
        return self._compile(self.expressions)

    @cached_property
    def _by_parameters(self) -> Callable[..., Any]:
        return self._compile([e.diff(p) for e in self.expressions for p in self.parameters])

    @cached_property
    def _by_load(self) -> Callable[..., Any]:
        return self._compile([e.diff(p) for e in self.expressions for p in _LOAD])

    def _terms(self, linear: tuple[int, ...]) -> dict[Exponents, Callable[..., Any]]:
        if linear not in self._compiled:
            columns = self._expand(linear)
            self._compiled[linear] = {e: self._compile(column) for e, column in columns.items()}
        return self._compiled[linear]

    @cached_property
    def _compiled(self) -> dict[tuple[int, ...], dict[Exponents, Callable[..., Any]]]:
        """Functions of terms that were asked for, by the linear parameters."""
        return {}

    def _expand(self, linear: tuple[int, ...]) -> dict[Exponents, list[Any]]:
        chosen = [self.parameters[i] for i in linear]
        columns: dict[Exponents, list[Any]] = {}
        for row, expression in enumerate(self.expressions):
            for exponents, factor in _coefficients(expression, chosen).items():
                if factor != 0:
                    columns.setdefault(exponents, [sympy.Integer(0)] * 6)[row] = factor
        return columns

    def _compile(self, expressions: Sequence[Any]) -> Callable[..., Any]:
        smooth = [e.replace(sympy.DiracDelta, lambda *_: sympy.Integer(0)) for e in expressions]
        arguments = [*self.quantities, *_LOAD, *self.parameters]
        compiled: Callable[..., Any] = sympy.lambdify(arguments, smooth, "numpy", cse=True)
        return compiled

    def _evaluate(
        self, function: Callable[..., Any], samples: WrenchSamples, inertia: Array, theta: Array
    ) -> Array:
        """Values (N, number of expressions), summed over contacts where meant."""
        measured = [quantity_values(q, samples) for q in self.quantities.values()]
        load = [inertia[0], *(inertia[1:4] / inertia[0])]
        shape = samples.in_contact.shape if self.each_contact else (len(samples.time), 1)
        with np.errstate(all="ignore"):
            found = function(*measured, *load, *theta)
        values = np.stack([np.broadcast_to(np.asarray(v, float), shape) for v in found], axis=2)
        if self.each_contact:
            values = np.where(samples.in_contact[..., None], values, 0.0)
        return np.asarray(values.sum(axis=1))


def _coefficients(expression: Any, chosen: Sequence[Any]) -> dict[Exponents, Any]:
    """Factors of the powers of some parameters; of linear ones without multiplying out."""
    if not chosen:
        return {(): expression}
    slopes = [expression.diff(p) for p in chosen]
    if any(slope.has(*chosen) for slope in slopes):
        found: dict[Exponents, Any] = sympy.Poly(expression, *chosen).as_dict()
        return found
    units = [tuple(int(i == k) for i in range(len(chosen))) for k in range(len(chosen))]
    rest = expression.subs(dict.fromkeys(chosen, 0))
    return {(0,) * len(chosen): rest, **dict(zip(units, slopes, strict=True))}


_SCREENED = (0.3, 1.0, 3.0)
"""Multiples of typical values at which parameters are tried in which a law is no polynomial: a
decade about what the author of the formula holds for typical. A wider span finds values farther
from it; more multiples cost a column, and so evidence, each."""
_TORQUE_WEIGHT = 20.0
"""Weight of torques against forces in the start of a fit, 1/m: a force of 1 N at 5 cm from the body
origin, half the width of what a hand holds, counts as much as its torque. It moves the start only:
with more torques decide, with less forces."""
_PRIOR_WEIGHT = 1e-2
"""Weight of the priors in the start of a fit, against a misfit of 1 where nothing is explained: it
only settles parameters that the wrench does not determine. Far more would start fits too near to
zero, none would leave such parameters to chance."""
_MOST_STEPS = 40
"""Evaluations of each of the four starts at most; a fit at the whitening of the data follows. Fewer
leave it to begin farther off, more cost time."""


class FormulaEffect(Effect):
    """Sum of wrenches given by formulas; each formula makes a subclass.

    Derivatives come from the formulas. Parameters in which the wrench is a polynomial give the
    screening family exactly; the others are tried at a third, once and three times their typical
    value. Derivatives without a finite value (at corners, as of |v| at rest) count as zero.

    Attributes:
        laws: the wrenches.
        definition: parameters.
    """

    rings = True
    laws: ClassVar[tuple[Law, ...]] = ()
    definition: ClassVar[tuple[EffectParameter, ...]] = ()

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Parameters that the file declares."""
        return self.definition

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum of the wrenches.

        Raises:
            BadInputError: a formula has no finite value at some sample.
        """
        total = self._sum(samples, inertia, theta)
        bad = ~np.isfinite(total).all(axis=1)
        if bad.any():
            named = zip(self.definition, theta, strict=True)
            values = ", ".join(f"{p.name} = {x:.3g}" for p, x in named)
            raise BadInputError(
                f"effect '{self.name}': the formula has no finite value at "
                f"t = {samples.time[bad][0]:.3f} s with {values}; keep roots, logarithms and "
                "divisors positive with max(.., ..)"
            )
        return total

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By theta."""
        parts = [law.jacobian(samples, inertia, theta) for law in self.laws]
        return _finite(np.sum(parts, axis=0))

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """By mass and first moment, through m and com = moment / m."""
        parts = [law.load_jacobian(samples, inertia, theta) for law in self.laws]
        by_load = _finite(np.sum(parts, axis=0))
        mass, com = inertia[0], inertia[1:4] / inertia[0]
        result = np.zeros((len(by_load), 6, 10))
        result[..., 0] = by_load[..., 0] - by_load[..., 1:] @ com / mass
        result[..., 1:4] = by_load[..., 1:] / mass
        return result

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Columns of the powers of the linear parameters, the others at screened values."""
        if self._is_linear():
            return self.jacobian(samples, inertia, self.zero(samples))
        linear = self._linear()
        columns: list[Array] = []
        for theta in self._screened(linear):
            columns += self._powers(samples, inertia, theta, linear).values()
            columns += self._tangents(samples, inertia, theta, linear)
        return _finite(np.stack([c for c in columns if np.any(_finite(c))], axis=2))

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Parameters whose wrench comes nearest to the screened one."""
        if self._is_linear():
            return np.asarray(coefficients, dtype=float)
        target = self.screening_basis(samples, inertia) @ coefficients
        typical = self.typical(samples)
        scale = np.array([p.prior_std for p in self.definition])
        weight = np.array([_TORQUE_WEIGHT] * 3 + [1.0] * 3)
        size = max(float(np.sqrt(np.mean((weight * target) ** 2))), 1e-12)
        weight = weight / (size * np.sqrt(target.size))

        def misfit(theta: Array) -> Array:
            found = _finite(self._sum(samples, inertia, theta))
            return np.append(((found - target) * weight).ravel(), _PRIOR_WEIGHT * theta / scale)

        def slope(theta: Array) -> Array:
            found = self.jacobian(samples, inertia, theta) * weight[:, None]
            flat = found.reshape(-1, len(theta))
            return np.concatenate([flat, np.diag(_PRIOR_WEIGHT / scale)])

        starts = [sign * typical * size for sign in (1, -1) for size in (1.0, 0.1)]
        fits = [
            least_squares(misfit, s, slope, x_scale=scale, max_nfev=_MOST_STEPS) for s in starts
        ]
        return np.asarray(min(fits, key=lambda fit: fit.cost).x)

    def _sum(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        return np.asarray(
            np.sum([law.wrench(samples, inertia, theta) for law in self.laws], axis=0)
        )

    @classmethod
    @cache
    def _linear(cls) -> tuple[int, ...]:
        """Indices of the parameters in which every wrench is a polynomial."""
        indices = range(len(cls.definition))
        return tuple(i for i in indices if all(law.is_polynomial([i]) for law in cls.laws))

    @classmethod
    @cache
    def _is_linear(cls) -> bool:
        everything = len(cls._linear()) == len(cls.definition)
        return everything and all(law.degree() <= 1 for law in cls.laws)

    def _screened(self, linear: tuple[int, ...]) -> list[Array]:
        """Values of the parameters about which the wrench is expanded.

        Scalars in which it is not a polynomial take several values, components of vectors zero
        (their directions must not depend on the choice of axes).
        """
        typical = np.array([p.typical for p in self.definition])
        bent = [i for i in range(len(typical)) if i not in linear and not self._in_vector(i)]
        start = np.zeros_like(typical)
        start[list(linear)] = typical[list(linear)]
        if not bent:
            return [start]
        found = []
        for share in _SCREENED:
            theta = start.copy()
            theta[bent] = share * typical[bent]
            found.append(theta)
        return found

    def _in_vector(self, index: int) -> bool:
        """Whether a parameter is a component of a vector."""
        name = self.definition[index].name
        names = {p.name for p in self.definition}
        return all(f"{name[:-2]}_{axis}" in names for axis in "xyz")

    def _powers(
        self, samples: WrenchSamples, inertia: Array, theta: Array, linear: tuple[int, ...]
    ) -> dict[Exponents, Array]:
        found: dict[Exponents, Array] = {}
        for law in self.laws:
            for exponents, column in law.terms(samples, inertia, theta, linear).items():
                found[exponents] = found[exponents] + column if exponents in found else column
        return found

    def _tangents(
        self, samples: WrenchSamples, inertia: Array, theta: Array, linear: tuple[int, ...]
    ) -> list[Array]:
        """Derivatives by the components of vectors in which the wrench is not a polynomial."""
        bent = [i for i in range(len(theta)) if i not in linear and self._in_vector(i)]
        if not bent:
            return []
        jacobian = self.jacobian(samples, inertia, theta)
        return [jacobian[..., i] for i in bent]


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, 0.0)
