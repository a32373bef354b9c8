"""What there is to say about an effect, for people and programs."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.fingers import FingerEffect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter

_SAMPLES = 50
"""Samples of the example that readings and parameters are listed for, half a second. Which they are
depends on the number of contacts, not on the motion: 25 and 100 list the same, 6 miss some."""


@dataclass(frozen=True)
class CatalogueEntry:
    """An effect in words.

    Attributes:
        name: as in `--effects`.
        model: what it belongs to, as in `--model`.
        family: group in the catalogue.
        formula: the law in one line.
        parameters: of the default reading; of one finger where `per_finger`.
        per_finger: whether every finger has the parameters for itself.
        looks_like: what the residual shows.
        sentence: clause for a verdict.
        remedy: what to do about it.
        readings: labels of all readings of the name, the default first.
        meaning: text of the class.
    """

    name: str
    model: str
    family: str
    formula: str
    parameters: tuple[EffectParameter, ...]
    per_finger: bool
    looks_like: str
    sentence: str
    remedy: str
    readings: tuple[str, ...]
    meaning: str

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {**asdict(self), "readings": list(self.readings)}


class DescribedEffect(Protocol):
    """What every effect of every model says of itself."""

    name: ClassVar[str]
    family: ClassVar[str]
    formula: ClassVar[str]
    looks_like: ClassVar[str]
    sentence: ClassVar[str]
    remedy: ClassVar[str]


def entry_of(
    effect: DescribedEffect,
    model: str,
    parameters: tuple[EffectParameter, ...],
    readings: tuple[str, ...],
    per_finger: bool = False,
) -> CatalogueEntry:
    """Entry of an effect of any model.

    Args:
        effect: described.
        model: what it belongs to.
        parameters: of its default reading.
        readings: labels of all readings.
        per_finger: whether every finger has the parameters for itself.
    """
    return CatalogueEntry(
        name=effect.name,
        model=model,
        family=effect.family,
        formula=effect.formula,
        parameters=parameters,
        per_finger=per_finger,
        looks_like=effect.looks_like,
        sentence=effect.sentence,
        remedy=effect.remedy,
        readings=readings,
        meaning=inspect.cleandoc(type(effect).__doc__ or ""),
    )


def describe_effect(effect: Effect) -> CatalogueEntry:
    """Entry of an effect of a held object, its parameters as for a hand of several fingers."""
    samples = example_samples(_SAMPLES)
    per_finger = isinstance(effect, FingerEffect)
    parameters = (
        effect.axis_parameters() if isinstance(effect, FingerEffect) else effect.parameters(samples)
    )
    readings = tuple(reading.label for reading in effect.readings(samples))
    return entry_of(effect, "held", parameters, readings, per_finger)


def group_parameters(parameters: Iterable[EffectParameter]) -> tuple[tuple[str, str, str], ...]:
    """Symbols, unit and description of parameters; the components of a vector in one row."""
    rows: dict[str, tuple[str, str, str]] = {}
    for p in parameters:
        stem, _, axis = p.name.rpartition("_")
        if axis in ("x", "y", "z") and p.description.endswith(f", {axis}"):
            text = p.description.removesuffix(f", {axis}")
            symbols = f"{rows[stem][0]}, {p.name}" if stem in rows else p.name
            rows[stem] = (symbols, p.unit, text)
        else:
            rows[p.name] = (p.name, p.unit, p.description)
    return tuple(rows.values())
