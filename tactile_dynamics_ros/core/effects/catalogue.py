"""What there is to say about an effect, for people and programs."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.effects.effect import Effect, EffectParameter
from tactile_dynamics_ros.core.effects.fingers import FingerEffect

_SAMPLES = 50


@dataclass(frozen=True)
class CatalogueEntry:
    """An effect in words.

    Attributes:
        name: as in `--effects`.
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


def describe_effect(effect: Effect) -> CatalogueEntry:
    """Entry of an effect, its parameters as for a hand of several fingers."""
    samples = example_samples(_SAMPLES)
    per_finger = isinstance(effect, FingerEffect)
    parameters = (
        effect.axis_parameters() if isinstance(effect, FingerEffect) else effect.parameters(samples)
    )
    return CatalogueEntry(
        name=effect.name,
        family=effect.family,
        formula=effect.formula,
        parameters=parameters,
        per_finger=per_finger,
        looks_like=effect.looks_like,
        sentence=effect.sentence,
        remedy=effect.remedy,
        readings=tuple(reading.label for reading in effect.variants(samples)),
        meaning=inspect.cleandoc(type(effect).__doc__ or ""),
    )


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
