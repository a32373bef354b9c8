"""What a joint's model may lack: the base of all effects, those in a regime, all by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Family
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.effects.registry import CatalogueEntry, EffectRegistry, entry_of
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.situation import Situation, values_of
from tactile_dynamics_ros.core.numerics.regime import Regime, gated

_CHANCE = 2.0
"""Standard deviations by which a parameter may be beyond what is possible: noise moves one of zero
so far in 2 % of recordings."""


_COPIED = ("family", "formula", "looks_like", "sentence", "remedy")
"""What an effect in a regime says of itself as the effect does that acts everywhere; no number."""


@dataclass(frozen=True)
class JointReading:
    """A reading of an effect with the linear columns that it has near absence.

    Attributes:
        effect: the reading.
        label: name, reading and restriction.
        kept: columns that it keeps of those that all of its group share.
    """

    effect: JointEffect
    label: str
    kept: tuple[int, ...]


@dataclass(frozen=True)
class ReadingGroup:
    """Readings of an effect that share columns.

    Attributes:
        columns: (K, n, m) torques, N m, per coefficient.
        readings: with the columns that each keeps.
        reading: what they have in common, such as a shape.
    """

    columns: Array
    readings: tuple[JointReading, ...]
    reading: str


@dataclass(frozen=True)
class JointEffect(ABC):
    """Torque Delta(theta) of the drives beside rigid bodies and plain friction; theta = 0: absent.

    Attributes:
        name: API name. family: group in the catalogue.
        formula: the law in one line.
        looks_like: one plain sentence on the residual that it leaves.
        sentence: subject and verb for a verdict.
        remedy: what to do about it.
        regional: whether it may act in a regime only.
        searched: number of columns that each of its groups was the best of.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    formula: ClassVar[str]
    looks_like: ClassVar[str]
    sentence: ClassVar[str]
    remedy: ClassVar[str]
    regional: ClassVar[bool] = False
    searched: ClassVar[int] = 1

    @property
    def label(self) -> str:
        """Name with the reading."""
        return self.name

    @property
    def can_be_gated(self) -> bool:
        """Whether this reading is tried in regimes."""
        return self.regional

    @abstractmethod
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Parameters theta of this reading."""

    @abstractmethod
    def torque(self, situation: Situation, theta: Array) -> Array:
        """(K, n) mean torque of each block, N m, for parameters (k,)."""

    @abstractmethod
    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """(K, n, k) derivative of `torque`."""

    @abstractmethod
    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """All readings that a recording can have, in groups that share columns."""

    def groups_for(self, situation: Situation, residual: Array) -> list[ReadingGroup]:
        """Groups that are worth a try where a residual (K, n) is left; all by default."""
        return self.groups(situation)

    def start(self, coefficients: Array) -> Array:
        """Parameters from which a fit begins, given the coefficients of its columns."""
        return coefficients

    def scales(self) -> dict[str, tuple[str, float, str]]:
        """What the logarithms among the parameters are of: name, value at zero, and unit."""
        return {}

    def where(self, names: Sequence[str]) -> str:
        """Where it acts, in words; empty for everywhere."""
        return ""


@dataclass(frozen=True)
class LinearJointEffect(JointEffect):
    """An effect with columns (K, n, k) that theta multiplies."""

    @abstractmethod
    def columns(self, situation: Situation) -> Array:
        """(K, n, k) torques per parameter."""

    def torque(self, situation: Situation, theta: Array) -> Array:
        """Columns times theta."""
        return np.asarray(self.columns(situation) @ theta)

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """The columns."""
        return self.columns(situation)

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """One reading with all columns."""
        columns = self.columns(situation)
        own = JointReading(self, self.label, tuple(range(columns.shape[2])))
        return [ReadingGroup(columns, (own,), self.label)]


@dataclass(frozen=True)
class GatedJointEffect(JointEffect):
    """Torque of another effect in blocks where its regime holds, none elsewhere; see `gate_effect`.

    Attributes:
        inner: the effect.
        regime: where it acts.
    """

    inner: JointEffect
    regime: Regime

    def __reduce__(self) -> tuple[Any, ...]:
        return gate_effect, (self.inner, self.regime)

    @property
    def label(self) -> str:
        """Name with the regime, then the reading."""
        return self.name + self.inner.label[len(self.inner.name) :]

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Those of the inner effect."""
        return self.inner.parameters()

    def torque(self, situation: Situation, theta: Array) -> Array:
        """That of the inner effect inside."""
        return self._gated(situation, self.inner.torque(situation, theta))

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """That of the inner effect inside."""
        return self._gated(situation, self.inner.jacobian(situation, theta))

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """Those of the inner effect inside."""
        found = []
        for group in self.inner.groups(situation):
            effects = [gate_effect(r.effect, self.regime) for r in group.readings]
            readings = tuple(
                JointReading(effect, effect.label, reading.kept)
                for effect, reading in zip(effects, group.readings, strict=True)
            )
            columns = self._gated(situation, group.columns)
            found.append(ReadingGroup(columns, readings, f"{group.reading}[{self.regime}]"))
        return found

    def start(self, coefficients: Array) -> Array:
        """That of the inner effect."""
        return self.inner.start(coefficients)

    def scales(self) -> dict[str, tuple[str, float, str]]:
        """Those of the inner effect."""
        return self.inner.scales()

    def where(self, names: Sequence[str]) -> str:
        """That of the inner effect."""
        return self.inner.where(names)

    def _gated(self, situation: Situation, values: Array) -> Array:
        inside = self.regime.inside(lambda symbol: values_of(situation.samples, symbol))
        return np.asarray(values * inside.reshape(-1, *[1] * (values.ndim - 1)))


def gate_effect(effect: JointEffect, regime: Regime) -> JointEffect:
    """An effect that acts in a regime only, with the name ``name[regime]``.

    Raises:
        BadInputError: the effect acts always or never.
    """
    name = f"{effect.name}[{regime}]"
    if not effect.regional:
        raise BadInputError(
            f"effect '{name}': it acts everywhere or not at all; leave the regime out"
        )
    return gated(GatedJointEffect, effect, regime, _COPIED)


JOINT_EFFECT_NAMES = (
    "stribeck_friction",
    "load_dependent_friction",
    "friction_warming",
    "directional_friction",
    "rotor_inertia",
    "joint_elasticity",
    "backlash",
    "joint_coupling",
    "link_cable",
    "base_tilt",
    "torque_drift",
    "torque_gain",
    "torque_ripple",
    "torque_delay",
)
"""Names of the effects of joints in the order in which people see them; they are API. Coulomb and
viscous friction and a torque's offset are no effects: every model of a joint has them."""

JOINTS: EffectRegistry[JointEffect] = EffectRegistry(
    "joints",
    JOINT_EFFECT_NAMES,
    (
        "tactile_dynamics_ros.core.joints.drive_effects",
        "tactile_dynamics_ros.core.joints.arm_effects",
    ),
    gate=gate_effect,
)
"""Effects of an arm's joints, drives and torque sensors."""


def describe_joint_effect(name: str) -> CatalogueEntry:
    """Entry of an effect in the catalogue."""
    effect = JOINTS.create(name)
    entry = entry_of(effect, JOINTS.model, effect.parameters(), (name,))
    return replace(entry, meaning=entry.meaning.partition("\n\nAttributes:")[0])


def families_in(
    effect: JointEffect, situation: Situation, residual: Array, whiten: Callable[[Array], Array]
) -> list[Family]:
    """Families of all readings of an effect; those of one group share columns.

    Args:
        effect: of any reading.
        situation: that it acts on.
        residual: (K, n) torques that the model leaves, N m.
        whiten: makes rows (K n, m) white.
    """
    groups = effect.groups_for(situation, residual)
    alike = [len(reading.kept) for one in groups for reading in one.readings]
    found = []
    for group in groups:
        columns = whiten(group.columns.reshape(residual.size, -1))
        found += [
            Family(
                effect.name,
                reading.label,
                group.reading,
                columns,
                reading.kept,
                alike.count(len(reading.kept)) * effect.searched,
                reading.effect,
                regional=reading.effect.can_be_gated,
            )
            for reading in group.readings
        ]
    return found


def in_units(entry: dict[str, Any], scale: tuple[str, float, str] | None) -> dict[str, Any]:
    """A parameter's value; that of a logarithm as a number with its unit."""
    if scale is None:
        return entry
    value = scale[1] * float(np.exp(entry["value"]))
    return {"value": value, "std": value * float(entry["std"]), "unit": scale[2]}


def are_allowed(parameters: Sequence[EffectParameter], entries: Sequence[dict[str, Any]]) -> bool:
    """Whether all values are within the bounds of their parameters, or chance from them.

    Args:
        parameters: with bounds.
        entries: value and std of each.
    """
    return all(
        abs(e["value"] - np.clip(e["value"], p.least, p.most)) <= _CHANCE * e["std"]
        for p, e in zip(parameters, entries, strict=True)
    )
