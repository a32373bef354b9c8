"""Reads files of user effects: formulas in yaml, classes in Python."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, cast

import sympy

from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.formula.effect import FormulaEffect, Law
from tactile_dynamics_ros.core.effects.formula.expression import (
    LARGEST_NUMBER,
    ExpressionReader,
    Term,
)
from tactile_dynamics_ros.core.effects.formula.quantities import (
    COM,
    FRAMES,
    QuantityTable,
    is_reserved,
    unknown_name,
)
from tactile_dynamics_ros.core.effects.geometry import AXES, vector_parameters
from tactile_dynamics_ros.core.effects.parameter import (
    EffectParameter,
    format_dimension,
    parse_unit,
)
from tactile_dynamics_ros.core.effects.registry import (
    EFFECT_NAMES,
    create_effect,
    is_registered,
    register_effect,
    registered_names,
)
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_yaml, require_file

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*$")
"""Names of parameters and definitions, as formulas can spell them; any other is refused."""
_PUSHED_LAWS = ".".join([*__name__.split(".")[:2], "planar", "diagnosis", "law_forms"])
"""Module that reads laws of pushed objects, imported where a file has one. No number."""
_EFFECT_NAME = re.compile(r"[a-z][a-z0-9_]*$")
"""Names of effects, as those of the catalogue are spelt: they stand in `--effects a,b`. Capitals
are refused, so that no two differ by them alone."""
_EFFECT_FIELDS = (
    "formula", "sentence", "looks_like", "remedy", "parameters", "constants", "definitions",
    "wrench", "external",
)  # fmt: skip
"""Fields of an effect in a file; any other is refused with this list."""
_PARAMETER_FIELDS = ("unit", "prior_std", "typical", "description", "vector")
"""Fields of a parameter; any other is refused, so that a misspelt one is not ignored."""
_WRENCH_FIELDS = ("axes", "at", "force", "torque")
"""Fields of a wrench; any other is refused, so that a misspelt one is not ignored."""
_MOST_ENTRIES = 50
"""Entries of one table of such a file: laws of ten parameters are already more than a recording
determines, and each takes derivatives by all others."""
_TEXTS = {
    "sentence": "the effect '{}' acts on the object",
    "looks_like": "A residual that follows the formula.",
    "remedy": "Remove its cause, or keep it in the model.",
}
"""What is said of an effect whose author says nothing. Words for people, no number."""


def load_effects(path: str | Path) -> tuple[Effect, ...]:
    """Make the effects of a file known by name and return those of a held object.

    Args:
        path: a .yaml file of formulas, or a .py file of classes with `@register_effect`, or with
            the `register` of another model's registry.

    Raises:
        BadInputError: names file, field, and what to do.
    """
    path = Path(path)
    require_file(path, "effects in .yaml or .py")
    if path.suffix == ".py":
        return _load_classes(path)
    effects = _read_table(read_yaml(path, "effects in yaml"), str(path), ("effects",))
    entries = _read_table(effects.get("effects"), f"{path}: effects")
    if not entries:
        raise BadInputError(f"{path}: effects: expected at least one effect by name")
    return tuple(_load_entry(str(name), entry, path) for name, entry in entries.items())


def _load_entry(name: str, entry: object, path: Path) -> Effect:
    """An effect of a file, made known; laws of pushed objects as their model reads them."""
    if isinstance(entry, Mapping) and "law_of_pushed" in entry:
        forms = import_module(_PUSHED_LAWS)
        return cast(Effect, forms.read_law(name, entry, f"{path}: {name}")())
    return register_effect(_EffectFile(name, entry, path).read())()


def read_effect(name: str, entry: Mapping[str, Any], where: str) -> type[FormulaEffect]:
    """Class of an effect that is given as an entry of a file would be; it is not made known.

    Args:
        name: of the effect.
        entry: formula, parameters, constants, definitions and wrench, as in a file.
        where: what messages name in place of the file.

    Raises:
        BadInputError: names the field, and what to do.
    """
    return _EffectFile(name, entry, Path(where)).read()


def require_effect_name(name: str, where: str) -> None:
    """Check the name of an effect of a file.

    Args:
        name: of the effect.
        where: what the message names.

    Raises:
        BadInputError: it is that of an effect of the catalogue, or cannot be spelt in a label.
    """
    if not _EFFECT_NAME.match(name) or name in EFFECT_NAMES:
        reason = "taken by the catalogue" if name in EFFECT_NAMES else "not a name"
        raise BadInputError(f"{where}: {reason}; use letters, digits and _")


def _load_classes(path: Path) -> tuple[Effect, ...]:
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise BadInputError(f"{path}: cannot be read as Python")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except Exception as error:  # whatever a user's file raises is reported in one line
        raise BadInputError(f"{path}: {type(error).__name__}: {error}") from error
    classes = (v for v in vars(module).values() if isinstance(v, type) and issubclass(v, Effect))
    names = {found.name for found in classes} - set(EFFECT_NAMES)
    added = [name for name in registered_names() if name in names]
    own = [v for v in vars(module).values() if getattr(v, "__module__", "") == path.stem]
    if not added and not any(is_registered(found) for found in own):
        raise BadInputError(f"{path}: registers no effect: decorate a class with @register_effect")
    return tuple(create_effect(name) for name in added)


def _read_table(value: object, where: str, fields: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return a mapping, empty for None; other keys than `fields` are refused."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise BadInputError(f"{where}: {str(value)[:40]!r} is not a table of names and values")
    if len(value) > _MOST_ENTRIES:
        raise BadInputError(f"{where}: {len(value)} entries, at most {_MOST_ENTRIES}")
    unknown = [str(key) for key in value if fields and key not in fields]
    if unknown:
        hint = "; a formula with commas needs quotes between braces" if ")" in unknown[0] else ""
        expected = ", ".join(fields)
        raise BadInputError(f"{where}: '{unknown[0]}' is unknown, expected {expected}{hint}")
    return {str(key): entry for key, entry in value.items()}


class _EffectFile:
    """One effect of a file."""

    def __init__(self, name: str, entry: object, path: Path) -> None:
        self._name, self._where, self._module = name, f"{path}: {name}", path.stem
        require_effect_name(name, self._where)
        self._entry = _read_table(entry, self._where, _EFFECT_FIELDS)
        self._declared: dict[str, Term] = {}
        self._parameters: list[EffectParameter] = []
        self._symbols: list[Any] = []

    def read(self) -> type[FormulaEffect]:
        """Class of the effect."""
        for kind, declare in (("parameters", self._parameter), ("constants", self._constant)):
            where = f"{self._where}.{kind}"
            for name, value in _read_table(self._entry.get(kind), where).items():
                self._require_free(name, f"{where}.{name}")
                declare(name, value, f"{where}.{name}")
        if not self._parameters:
            raise BadInputError(f"{self._where}.parameters: expected at least one parameter")
        wrenches = self._entry.get("wrench")
        pieces = wrenches if isinstance(wrenches, list) else [wrenches]
        if len(pieces) > _MOST_ENTRIES:
            raise BadInputError(f"{self._where}.wrench: {len(pieces)}, at most {_MOST_ENTRIES}")
        laws = tuple(
            self._law(piece, f"{self._where}.wrench" + (f"[{i}]" if len(pieces) > 1 else ""))
            for i, piece in enumerate(pieces)
        )
        texts = {key: self._text(key) for key in _TEXTS}
        body = {
            "__doc__": f"Effect '{self._name}' of a file.",
            "__module__": self._module,
            "name": self._name,
            "family": "user",
            "formula": str(self._entry.get("formula") or self._written(pieces)),
            "laws": laws,
            "external": self._external(laws),
            "definition": tuple(self._parameters),
            **texts,
        }
        return type(self._name, (FormulaEffect,), body)

    def _external(self, laws: tuple[Law, ...]) -> bool:
        """Whether it is a wrench on the object: as stated, else if no sensor reading occurs."""
        stated = self._entry.get("external")
        if stated is None:
            return not any(law.reads_sensors for law in laws)
        if not isinstance(stated, bool):
            raise BadInputError(f"{self._where}.external: {stated!r} is neither true nor false")
        return stated

    def _text(self, key: str) -> str:
        return str(self._entry.get(key) or _TEXTS[key].format(self._name)).strip()

    def _written(self, pieces: list[Any]) -> str:
        """The formulas as they stand in the file."""
        parts = [
            f"{kind} = {_plain(piece[kind])} ({piece.get('axes', 'body')} axes, "
            f"at {_plain(piece.get('at', 'origin'))})"
            for piece in pieces
            for kind in ("force", "torque")
            if kind in piece
        ]
        return "; ".join(parts)

    def _require_free(self, name: str, where: str) -> None:
        if not _NAME.match(name) or name in self._declared:
            raise BadInputError(f"{where}: not a free name: use letters, digits and _, once")
        if is_reserved(name):
            raise BadInputError(f"{where}: '{name}' is a measured quantity, choose another name")

    def _parameter(self, name: str, value: object, where: str) -> None:
        entry = _read_table(value, where, _PARAMETER_FIELDS)
        missing = [key for key in ("unit", "prior_std") if key not in entry]
        if missing:
            raise BadInputError(f"{where}: '{missing[0]}' is missing, expected unit and prior_std")
        prior = _read_number(entry["prior_std"], f"{where}.prior_std")
        typical = _read_number(entry.get("typical", 0.2 * prior), f"{where}.typical")
        if prior <= 0.0 or typical == 0.0:
            raise BadInputError(f"{where}: expected prior_std above zero and typical unlike zero")
        unit, text = str(entry["unit"]), str(entry.get("description") or name)
        if entry.get("vector"):
            added = vector_parameters(name, unit, prior, text, typical)
        else:
            added = (EffectParameter(name, unit, prior, text, typical),)
        self._declare(name, added, where)

    def _declare(self, name: str, added: tuple[EffectParameter, ...], where: str) -> None:
        dimension = _read_unit(added[0].unit, where)
        symbols = [sympy.Symbol(f"theta_{p.name}", real=True) for p in added]
        for parameter, symbol in zip(added, symbols, strict=True):
            if parameter.name in self._declared or is_reserved(parameter.name):
                raise BadInputError(f"{where}: component '{parameter.name}' is not a free name")
            self._declared[parameter.name] = Term(symbol, dimension)
        if len(added) == len(AXES):
            self._declared[name] = Term(sympy.Matrix(symbols), dimension)
        self._parameters += added
        self._symbols += symbols

    def _constant(self, name: str, value: object, where: str) -> None:
        entry = _read_table(value, where, ("value", "unit"))
        number = _read_number(entry.get("value"), f"{where}.value")
        dimension = _read_unit(str(entry.get("unit", "1")), where)
        self._declared[name] = Term(sympy.Float(number), dimension)

    def _law(self, piece: object, where: str) -> Law:
        entry = _read_table(piece, where, _WRENCH_FIELDS)
        frame, place = entry.get("axes", "body"), entry.get("at", "origin")
        if frame not in FRAMES:
            raise BadInputError(f"{where}.axes: '{frame}', expected {', '.join(FRAMES)}")
        if "force" not in entry and "torque" not in entry:
            raise BadInputError(f"{where}: expected force, torque or both")
        table = QuantityTable(str(frame), place == "contacts")
        lookup = self._lookup(table)
        turn = self._turn(table, where)
        parts = {}
        for kind, unit in (("force", "N"), ("torque", "N m")):
            term = ExpressionReader(lookup, f"{where}.{kind}").read_vector(entry.get(kind, "0"))
            _require_unit(term, unit, f"{where}.{kind}")
            parts[kind] = turn * term.value
        point = self._point(place, table, where)
        torque = parts["torque"] + point.cross(parts["force"])
        law = Law(
            (*torque, *parts["force"]), dict(table.used), tuple(self._symbols), table.each_contact
        )
        self._require_absence(law, where)
        return law

    def _turn(self, table: QuantityTable, where: str) -> Any:
        try:
            return table.rotation(table.frame)
        except BadInputError as error:
            raise BadInputError(f"{where}.axes: {error}") from error

    def _lookup(self, table: QuantityTable) -> Callable[[str], Term]:
        """Names of this wrench; definitions see those above them and the axes of the wrench."""
        known = dict(self._declared)

        def lookup(name: str) -> Term:
            found = known.get(name) or table.find(name)
            if found is None:
                raise unknown_name(name, known)
            return found

        where = f"{self._where}.definitions"
        for name, text in _read_table(self._entry.get("definitions"), where).items():
            self._require_free(name, f"{where}.{name}")
            reader = ExpressionReader(lookup, f"{where}.{name}")
            vector = isinstance(text, list)
            known[name] = reader.read_vector(text) if vector else reader.read(str(text))
        return lookup

    def _point(self, place: object, table: QuantityTable, where: str) -> Any:
        """Where the force acts, body axes."""
        if place == "origin":
            return sympy.zeros(3, 1)
        if place == "com":
            return COM
        inner = QuantityTable("body", table.each_contact)
        reader = ExpressionReader(self._lookup(inner), f"{where}.at")
        term = reader.read_vector("r" if place == "contacts" else place)
        _require_unit(term, "m", f"{where}.at")
        table.used.update(inner.used)
        return term.value

    def _require_absence(self, law: Law, where: str) -> None:
        if not law.has_value_at_absence():
            raise BadInputError(
                f"{where}: has no value where all parameters are 0 (absent): keep divisors "
                "away from 0, for example max(abs(w_0), w_least) with a constant w_least"
            )
        if not law.vanishes_at_absence():
            raise BadInputError(
                f"{where}: does not vanish where all parameters are 0 (absent): multiply it "
                "by a parameter"
            )


def _plain(value: object) -> str:
    """A formula as text; components in brackets."""
    return f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)


def _read_number(value: object, where: str) -> float:
    """Return a number; yaml reads 1e-3 as text."""
    try:
        number = float(str(value))
    except ValueError as error:
        raise BadInputError(f"{where}: {str(value)[:40]!r} is not a number") from error
    if number != 0.0 and not 1.0 / LARGEST_NUMBER <= abs(number) <= LARGEST_NUMBER:
        raise BadInputError(f"{where}: {number:g}, expected at most {LARGEST_NUMBER:g}")
    return number


def _read_unit(unit: str, where: str) -> Any:
    try:
        return parse_unit(unit)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error


def _require_unit(term: Term, unit: str, where: str) -> None:
    if term.dimension is not None and term.dimension != parse_unit(unit):
        raise BadInputError(
            f"{where}: has the unit {format_dimension(term.dimension)}, expected {unit} "
            f"({format_dimension(parse_unit(unit))}): check the units of the parameters"
        )
