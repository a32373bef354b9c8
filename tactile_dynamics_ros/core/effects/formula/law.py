"""Wrench of formulas as fast functions of samples, with derivatives and linear families."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.formula.quantities import (
    COM,
    MASS,
    Quantity,
    quantity_values,
)

Array = NDArray[np.float64]
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
