"""What every parameter of every effect states, and units as exponents of kg, m and s."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError

Dimension = tuple[Fraction, Fraction, Fraction]

_BASE: dict[str, tuple[int, int, int]] = {
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "N": (1, 1, -2),
    "Hz": (0, 0, -1),
    "rad": (0, 0, 0),
    "Pa": (1, -1, -2),
    "J": (1, 2, -2),
    "W": (1, 2, -3),
    "1": (0, 0, 0),
}
"""Exponents of kg, m and s of the units that are understood; an angle has none. They are
definitions; a unit that is missing here is refused in files of effects."""
_TERM = re.compile(r"([A-Za-z]+|1)(?:\^(-?\d+(?:/\d+)?))?$")
"""A unit with a power, which may be a fraction: ``m^3/2``."""

DIMENSIONLESS: Dimension = (Fraction(0), Fraction(0), Fraction(0))
"""Dimension of a plain number. Fixed by what the exponents mean."""


def dimension(kg: int = 0, m: int = 0, s: int = 0) -> Dimension:
    """Dimension of integer exponents."""
    return (Fraction(kg), Fraction(m), Fraction(s))


def parse_unit(text: str) -> Dimension:
    """Dimension of a unit such as ``N s^2/m^2`` or ``kg m^2/s``; every factor after / divides.

    Raises:
        BadInputError: a factor is not a known unit.
    """
    result = list(DIMENSIONLESS)
    parts = text.strip().split("/")
    for index, part in enumerate(parts):
        for factor in part.replace("*", " ").split():
            found = _TERM.match(factor.strip("()"))
            if found is None or found[1] not in _BASE:
                raise BadInputError(
                    f"unit '{text}': '{factor}' is unknown; expected factors of {', '.join(_BASE)}"
                )
            exponent = Fraction(found[2] or 1) * (-1 if index else 1)
            result = [r + exponent * b for r, b in zip(result, _BASE[found[1]], strict=True)]
    return (result[0], result[1], result[2])


def format_dimension(value: Dimension) -> str:
    """Readable form, for messages."""
    names = ("kg", "m", "s")
    terms = [f"{n}^{e}" if e != 1 else n for n, e in zip(names, value, strict=True) if e != 0]
    return " ".join(terms) or "1"


@dataclass(frozen=True)
class EffectParameter:
    """One scalar parameter of an effect.

    Attributes:
        name: short symbol, as in the formula of the effect.
        unit: SI.
        prior_std: scale of plausible values about zero; weak, for conditioning.
        description: one phrase.
        typical: a value at which the effect is plainly present; for checks and pictures.
        least: value below which the effect cannot exist, such as a spring that pushes.
        most: value above which it cannot, or is another, such as damping without any ringing.
    """

    name: str
    unit: str
    prior_std: float
    description: str
    typical: float = 0.0
    least: float = -math.inf
    most: float = math.inf

    def __post_init__(self) -> None:
        """Fill the typical value."""
        if self.typical == 0.0:
            object.__setattr__(self, "typical", 0.2 * self.prior_std)

    def allows(self, value: float) -> bool:
        """Whether the effect can exist with a value."""
        return self.least <= value <= self.most


@dataclass(frozen=True)
class ParameterSum:
    """A sum of parameters that data may tell although they do not tell the summands.

    Attributes:
        name: symbol.
        unit: SI.
        members: names of the parameters that are added up.
    """

    name: str
    unit: str
    members: tuple[str, ...]

    def entry(
        self, names: Sequence[str], theta: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Value and standard deviation.

        Args:
            names: of the k parameters.
            theta: (k,) their values.
            covariance: (k, k) of them.
        """
        row = np.array([float(name in self.members) for name in names])
        return float(row @ theta), float(np.sqrt(max(row @ covariance @ row, 0.0)))
