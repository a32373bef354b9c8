"""Units as exponents of kg, m and s, parsed from short strings."""

from __future__ import annotations

import re
from fractions import Fraction

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
