"""Effects by name, one registry for each model, and what there is to say about each."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from tactile_dynamics_ros.core.effects.check import example_samples
from tactile_dynamics_ros.core.effects.conditions import gate_effect
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.fingers import FingerEffect
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.core.numerics.regime import Regime, split_label

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


ENTRY_POINT_GROUP = "tactile_dynamics_ros.effects"
"""Group of entry points under which installed packages name their effects of a held object. It is
API: installed packages are not found under another one."""

EFFECT_NAMES = (
    "viscous_drag",
    "quadratic_drag",
    "rotational_drag",
    "tether_spring",
    "hanging_cable",
    "unsensed_contact",
    "spinning_rotor",
    "sloshing_mass",
    "added_mass",
    "mass_change",
    "gravity_tilt",
    "contact_torsion",
    "contact_offset",
    "force_bias",
    "force_drift",
    "force_scale",
    "sensor_rotation",
    "sensor_lag",
    "time_offset",
    "sensor_zeroed",
    "payload_change",
    "grasp_shift",
)
"""Names of the effects of a held object in the order in which people see them; they are API."""

_PACKAGE = "tactile_dynamics_ros."
"""Beginning of the names of this package's modules, which define the effects of the catalogue."""

_REGISTRIES: list[EffectRegistry[Any]] = []
"""Registries of all models that were imported, so that a file of effects is asked of each. A list,
no number: models add themselves."""

EffectT = TypeVar("EffectT")
EffectClass = TypeVar("EffectClass", bound=Callable[[], object])


class EffectRegistry(Generic[EffectT]):
    """Effects that one kind of model may lack, by their names."""

    def __init__(
        self,
        model: str,
        first: Sequence[str] = (),
        modules: Iterable[str] = (),
        entry_point_group: str = "",
        gate: Callable[[EffectT, Regime], EffectT] | None = None,
    ) -> None:
        """Nothing is imported before the first effect is asked for.

        Args:
            model: what the effects belong to, as in `--model`.
            first: names that come first, in this order.
            modules: that register effects when they are imported.
            entry_point_group: where installed packages name effects of theirs; empty for none.
            gate: makes an effect act in a regime only; None where none can.
        """
        self.model = model
        self._first, self._modules, self._group = tuple(first), tuple(modules), entry_point_group
        self._known: dict[str, Callable[[], EffectT]] = {}
        self._gate = gate
        self._loaded = False
        _REGISTRIES.append(self)

    def register(self, effect: EffectClass) -> EffectClass:
        """Class decorator: make an effect known by its name.

        Raises:
            BadInputError: the class has no name, or that of an effect of the catalogue.
        """
        name = getattr(effect, "name", "")
        if not name:
            raise BadInputError(f"{effect}: an effect needs a class attribute `name`")
        if not _is_ours(effect) and (name in self._first or _is_ours(self._known.get(name))):
            raise BadInputError(
                f"effect '{name}' is in the catalogue already (model {self.model}); "
                "give yours another name"
            )
        self._known[name] = effect  # type: ignore[assignment]
        return effect

    def names(self) -> tuple[str, ...]:
        """Names of all effects known now."""
        self._load()
        return self._first + tuple(name for name in self._known if name not in self._first)

    def create(self, label: str) -> EffectT:
        """Effect of a name, ``name[regime]:reading``, where regime and reading may be missing.

        Raises:
            BadInputError: no effect of that name, the effect has no such reading, or the regime
                cannot be read.
        """
        self._load()
        everywhere, regime = split_label(label)
        if regime is not None:
            if self._gate is None:
                raise BadInputError(f"effect '{label}': no regimes in model {self.model}")
            return self._gate(self.create(everywhere), regime)
        name, _, reading = label.partition(":")
        if name not in self._known:
            known = ", ".join(self.names())
            raise BadInputError(
                f"effect '{name}' is unknown of model {self.model}: expected one of {known}"
                + nearest(name, self._known)
            )
        effect = self._known[name]()
        if not reading:
            return effect
        if not isinstance(effect, Effect):
            raise BadInputError(f"effect '{name}' has no reading '{reading}'")
        return effect.with_reading(reading)  # type: ignore[return-value]

    def create_all(self, labels: Sequence[str]) -> tuple[EffectT, ...]:
        """Effects of a model, in the order of their labels; each may be there once.

        Raises:
            BadInputError: an effect is unknown, has no such reading, or is named twice.
        """
        names = [label.partition(":")[0] for label in labels]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise BadInputError(
                f"effects = {list(labels)}: {', '.join(twice)} is named more than once; "
                "name it once"
            )
        return tuple(self.create(label) for label in labels)

    def expand(self, labels: Sequence[str]) -> list[str]:
        """See `expand_files`."""
        return expand_files(labels)

    def has_own(self, found: object) -> bool:
        """Whether it is an effect that was registered here and is none of the first names."""
        name = getattr(found, "name", None)
        return name not in self._first and self._known.get(str(name)) is found

    def _load(self) -> None:
        if self._loaded:
            return
        self._loaded = True
        for module in self._modules:
            import_module(module)
        for entry in entry_points(group=self._group) if self._group else ():
            try:
                self.register(entry.load())
            except BadInputError as error:
                raise BadInputError(
                    f"entry point '{entry.name}' ({entry.value}) of an installed package: {error}"
                ) from error


def _is_ours(effect: object) -> bool:
    """Whether a class is defined in this package."""
    return str(getattr(effect, "__module__", "")).startswith(_PACKAGE)


_KINDS = (
    *("drag", "elastic", "internal", "gravity", "contact", "torsion", "sensor", "timing"),
    "events",
)
"""Modules of `held`, one for each kind of effect. Effects of a module that is not named here do not
exist for anybody."""

HELD: EffectRegistry[Effect] = EffectRegistry(
    "held",
    EFFECT_NAMES,
    [f"tactile_dynamics_ros.core.effects.held.{kind}" for kind in _KINDS],
    ENTRY_POINT_GROUP,
    gate_effect,
)
"""Effects of an object that a hand holds."""


def is_registered(found: object) -> bool:
    """Whether something is a user's effect of any model, as `@register_effect` makes one known."""
    return any(registry.has_own(found) for registry in _REGISTRIES)


def register_effect(effect: EffectClass) -> EffectClass:
    """Class decorator: make an effect of a held object known by its name.

    Raises:
        BadInputError: the class has no name, or that of an effect of the catalogue.
    """
    return HELD.register(effect)


def registered_names() -> tuple[str, ...]:
    """Names of all effects of a held object known now, the catalogue first."""
    return HELD.names()


def create_effect(label: str) -> Effect:
    """Effect of a held object by its name, ``name[regime]:reading``; both may be missing.

    Raises:
        BadInputError: no effect of that name, no such reading, or no such regime.
    """
    return HELD.create(label)


def create_effects(labels: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of a held object, in the order of their labels; each may be there once.

    Args:
        labels: of effects, or files of effects, which stand for all that are in them.

    Raises:
        BadInputError: an effect is unknown, has no such reading, or is named twice, or a file
            cannot be read.
    """
    return HELD.create_all(expand_files(labels))


def expand_files(labels: Sequence[str]) -> list[str]:
    """Labels in which a file of effects (.yaml or .py) is replaced by the names of its effects.

    Raises:
        BadInputError: a file cannot be read.
    """
    names: list[str] = []
    for label in labels:
        path = Path(label)
        if path.suffix in (".yaml", ".py"):
            names += _names_in(path, path.stat().st_mtime_ns if path.exists() else 0)
        else:
            names.append(label)
    return names


@cache
def _names_in(path: Path, changed: int) -> tuple[str, ...]:
    """Names of the effects of a file, which is read once until it is changed."""
    files = import_module(f"{_PACKAGE}core.effects.formula.file")
    return tuple(effect.name for effect in files.load_effects(path))
