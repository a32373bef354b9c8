"""Regimes: parts of a recording in which one or two scalars lie within an interval."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError

Mask = NDArray[np.bool_]
Gated = TypeVar("Gated")

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
"""A decimal number in the text of a gate. Another form would refuse numbers that people write."""
_ONE_SIDED = re.compile(rf"([A-Za-z_]\w*)\s*([<>])\s*({_NUMBER})")
"""`z<0.42` and `z>0.42`: the scalar comes first. It is API."""
_INTERVAL = re.compile(rf"({_NUMBER})\s*<\s*([A-Za-z_]\w*)\s*<\s*({_NUMBER})")
"""`12<t<20`: the scalar stands in the middle. It is API."""


@dataclass(frozen=True)
class Gate:
    """An interval of one scalar, open at an infinite end.

    Attributes:
        symbol: of the scalar, such as ``z``.
        low: lower end, in the unit of the scalar.
        high: upper end.
    """

    symbol: str
    low: float = -math.inf
    high: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Gate:
        """Gate written as ``z<0.42``, ``load_index>3`` or ``12<t<20``.

        Raises:
            BadInputError: the text has another form, or the interval is empty.
        """
        one, both = _ONE_SIDED.fullmatch(text.strip()), _INTERVAL.fullmatch(text.strip())
        if one:
            end = float(one[3])
            return cls(one[1], high=end) if one[2] == "<" else cls(one[1], low=end)
        if both and float(both[1]) < float(both[3]):
            return cls(both[2], float(both[1]), float(both[3]))
        raise BadInputError(f"regime '{text}': expected z<0.42, load_index>3 or 12<t<20")

    def __str__(self) -> str:
        """The text that `parse` reads."""
        if math.isinf(self.low):
            return f"{self.symbol}<{self.high:.5g}"
        if math.isinf(self.high):
            return f"{self.symbol}>{self.low:.5g}"
        return f"{self.low:.5g}<{self.symbol}<{self.high:.5g}"

    def inside(self, values: Array) -> Mask:
        """Where values of the scalar lie in the interval."""
        return np.asarray((values > self.low) & (values < self.high))


@dataclass(frozen=True)
class Regime:
    """Where all of one or two gates are open.

    Attributes:
        gates: of different scalars.
    """

    gates: tuple[Gate, ...]

    @classmethod
    def parse(cls, text: str) -> Regime:
        """Regime written as a gate, or as two with `&` between them.

        Raises:
            BadInputError: a gate has another form, or there are more than two.
        """
        gates = tuple(Gate.parse(part) for part in text.split("&"))
        if len(gates) > 2:
            raise BadInputError(f"regime '{text}': expected at most two conditions")
        return cls(gates)

    def __str__(self) -> str:
        """The text that `parse` reads."""
        return "&".join(map(str, self.gates))

    def inside(self, values: Callable[[str], Array]) -> Mask:
        """Where the scalars, given by their symbols, lie in all gates."""
        return np.asarray(np.all([g.inside(values(g.symbol)) for g in self.gates], axis=0))


_LABEL = re.compile(r"(?P<name>[^\[\]:]+)\[(?P<regime>[^\]]+)\](?P<reading>:.*)?")
"""`name[regime]:reading`, as effects that act in a regime are written everywhere. It is API."""


def split_label(label: str) -> tuple[str, Regime | None]:
    """Label of an effect without its regime, and the regime; None where it acts everywhere.

    Raises:
        BadInputError: the regime cannot be read.
    """
    found = _LABEL.fullmatch(label)
    if found is None:
        return label, None
    return found["name"] + (found["reading"] or ""), Regime.parse(found["regime"])


def gated(
    kind: type[Gated], inner: Any, regime: Regime, copied: Sequence[str], **own: Any
) -> Gated:
    """An effect that acts in a regime only, with the name ``name[regime]``.

    Args:
        kind: class of such effects, made from the inner effect and the regime.
        inner: effect that acts everywhere.
        regime: where it shall act.
        copied: attributes of the class that it has from the inner effect.
        own: further ones.
    """
    body = {name: getattr(type(inner), name) for name in copied}
    body |= own | {"name": f"{inner.name}[{regime}]"}
    made: Any = type(kind.__name__, (kind,), body)
    found: Gated = made(inner, regime)
    return found
