"""Forms of laws that may act on a held object: formulas with free exponents, places, rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.laws.documents import write_law
from tactile_dynamics_ros.core.discrepancy.laws.search import leeway
from tactile_dynamics_ros.core.effects.formula.effect import FormulaEffect
from tactile_dynamics_ros.core.effects.formula.file import read_effect, require_effect_name
from tactile_dynamics_ros.core.effects.geometry import AXES
from tactile_dynamics_ros.core.inertia.diagnosis.quick_fit import WhitenedModel

Values = dict[str, Any]

_REACHES = (0.0, 0.05, 0.1, 0.2, 0.4)
"""Distances of tried places from the mean position, m: a motion of 10 cm tells one at 5 cm from one
at 10 cm, and from 40 cm on a pull hardly changes. More cost time in proportion."""
_FARTHEST_POINT = 0.2
"""Distance, m, up to which a start may put the point where a law acts from the body origin: the
size of what a hand holds. It bounds starts only."""
_EXTENT = 0.03
"""Presumed extent of what pulls, m: a magnet of a few centimetres acts, from near, with a lower
exponent than a point would. Without it the exponent of a near magnet is off by more than its
interval; far more would leave exponents undetermined."""
_CENTRAL_EXPONENTS = (-4.0, -2.0, 0.0, 1.0, 3.0)
"""Exponents of distance at which central forces start; fits move between them. From the pull of a
magnet to a spring that stiffens."""
_SPEED_EXPONENTS = (0.0, 0.5, 1.0, 2.0, 3.0)
"""Exponents of speed at which drags start, from dry friction to one with the cube."""
_RATES = (1.0, 0.3, 0.1, 0.05)
"""Rates at which decays start, 1/s: with time constants from 1 s to 20 s, as a recording of 30 s
shows them."""


def _vector(unit: str, prior: float, text: str) -> Values:
    return {"unit": unit, "prior_std": prior, "description": text, "vector": True}


def _scalar(unit: str, prior: float, text: str) -> Values:
    return {"unit": unit, "prior_std": prior, "description": text}


_IN_WORLD = "{0}_x*world_x + {0}_y*world_y + {0}_z*world_z"
"""A vector with components along the axes of the world, in the axes of the law. No number."""
_POINT = _vector("m", 0.2, "point of the object where it acts, body axes")
"""Parameter of the point where a law acts, prior 0.2 m: what a hand holds is not larger. Smaller
pulls points to the body origin, which a recording outweighs."""
_EXPONENT = _scalar("1", 5.0, "exponent")
"""Parameter of an exponent, prior 5: laws of nature have -4 to 3. Smaller pulls exponents to zero;
a recording outweighs either."""
_SIZE = _scalar("N", 10.0, "force at the reference")
"""Parameter of a size, prior 10 N: as much as a hand that holds something bears. Smaller would pull
strong forces to zero."""


@dataclass(frozen=True)
class HeldForm:
    """A form of law.

    Attributes:
        name: of the form and of its effect.
        words: what the law is, with names of its parameters in braces.
        entry: its formula, as in a file of effects.
        grid: gives values of parameters from which fits start.
        linear: parameters whose columns are screened at each start.
        lever: parameters (a vector) that come as multiples of the first linear one.
        line: whether starts are at frequencies of the spectrum.
    """

    name: str
    words: str
    entry: Values
    grid: Callable[[WhitenedModel], list[Values]]
    linear: tuple[str, ...]
    lever: str = ""
    line: str = ""

    @cached_property
    def effect(self) -> FormulaEffect:
        """The law as an effect."""
        return read_effect(self.name, self.entry, "law")()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, vectors in components."""
        return tuple(p.name for p in self.effect.definition)

    def starts(self, model: WhitenedModel, frequencies: Sequence[float]) -> list[Array]:
        """Parameters from which fits may start."""
        grid = [{self.line: f} for f in sorted(set(frequencies))] if self.line else self.grid(model)
        return [self._theta(values) for values in grid]

    def columns(self, model: WhitenedModel, start: Array) -> Array:
        """White derivatives by the linear parameters and the lever."""
        picked = [self.names.index(name) for name in self._screened]
        parts = [
            np.nan_to_num(self.effect.jacobian(samples, model.phi, start)[..., picked])
            for samples in model.fitted.samples
        ]
        return model.whitening.whiten(parts)

    def completed(self, start: Array, coefficients: Array) -> Array:
        """Start with sizes, and the point as torque over force."""
        theta, count = start.copy(), len(self._screened) - 3 * bool(self.lever)
        places = [self.names.index(name) for name in self._screened]
        theta[places[:count]] = coefficients[:count]
        if self.lever and abs(coefficients[0]) > 0.0:
            point = coefficients[1:] / coefficients[0]
            far = max(1.0, float(np.linalg.norm(point)) / _FARTHEST_POINT)
            theta[places[count:]] = point / far
        return theta

    def require_name(self, name: str, where: str) -> None:
        """Check that a law may have a name.

        Raises:
            BadInputError: it is that of a known effect, or no name.
        """
        require_effect_name(name, where)

    def entry_of(self, found: Mapping[str, Mapping[str, Any]]) -> Values:
        """Entry of a file of effects: sizes free, the rest as learnt with what may change of it.

        Args:
            found: value, std and unit by parameter.
        """
        parameters: Values = {}
        constants: Values = dict(self.entry.get("constants", {}))
        learnt: Values = {}
        for name, declared in self.entry["parameters"].items():
            rows = [f"{name}_{axis}" for axis in AXES] if declared.get("vector") else [name]
            values = [float(found[row]["value"]) for row in rows]
            if rows[0] in self.linear:
                size = float(np.linalg.norm(values)) if len(values) > 1 else values[0]
                prior = max(declared["prior_std"], leeway(abs(size)))
                parameters[name] = {**declared, "prior_std": prior, "typical": size}
                continue
            std = leeway(*(float(found[row]["std"]) for row in rows))
            change = {**declared, "prior_std": std, "typical": std}
            change["description"] = f"change of the learnt {declared['description']}"
            parameters[f"{name}_change"] = change
            for row, value, suffix in zip(rows, values, ("_x", "_y", "_z"), strict=False):
                constants[f"{row}_learnt"] = {"value": value, "unit": declared["unit"]}
                changed = f"{name}_change{suffix}" if len(rows) > 1 else f"{name}_change"
                learnt[row] = f"{row}_learnt + {changed}"
            if len(rows) > 1:
                learnt[name] = rows
        return {
            **self.entry,
            "parameters": parameters,
            "constants": constants,
            "definitions": {**learnt, **self.entry.get("definitions", {})},
            "sentence": write_law(self, found),
            "looks_like": "A residual that follows the formula, learnt from a recording.",
        }

    def term_of(self, found: Mapping[str, Mapping[str, Any]]) -> Values:
        """Formula, axes and point of the law."""
        wrench = self.entry["wrench"]
        at = wrench.get("at", "origin")
        return {
            "formula": str(wrench.get("force") or wrench["torque"]),
            "frame": wrench["axes"],
            "acts_at": [found[f"point_{a}"]["value"] for a in AXES] if at == "point" else at,
        }

    @property
    def reference(self) -> tuple[float, str] | None:
        """Value and unit of the quantity at which the size is stated."""
        stated = self.entry.get("constants", {}).get("reference")
        return None if stated is None else (stated["value"], stated["unit"])

    @cached_property
    def _screened(self) -> tuple[str, ...]:
        lever = tuple(f"{self.lever}_{axis}" for axis in AXES) if self.lever else ()
        return (*self.linear, *lever)

    def _theta(self, values: Values) -> Array:
        theta = np.zeros(len(self.names))
        for name, value in values.items():
            if name in self.names:
                theta[self.names.index(name)] = value
            else:
                theta[[self.names.index(f"{name}_{axis}") for axis in AXES]] = value
        return theta


def held_forms() -> tuple[HeldForm, ...]:
    """All forms that are tried; none reads sensors.

    An error of sensors that is learnt from what they read explains everything: noise of the forces
    stands on both sides.
    """
    return (
        _central(), _drag(), _rail(), _turning(), _lift(),
        _shaker("body"), _shaker("world"), _decay("body"), _decay("world"),
    )  # fmt: skip


def directions() -> Array:
    """Unit vectors (26, 3) to the faces, edges and corners of a cube."""
    found = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _central() -> HeldForm:
    entry = {
        "parameters": {
            "size": _SIZE, "power": _EXPONENT, "point": _POINT,
            "place": _vector("m", 3.0, "place in the world"),
            "extent": _scalar("m", _EXTENT, "how far the source or the part it acts on extends"),
        },
        "constants": {
            "reference": {"value": 0.1, "unit": "m"}, "nearest": {"value": 1e-3, "unit": "m"},
        },
        "definitions": {
            "gap": f"{_IN_WORLD.format('place')} - p - point",
            "distance": "sqrt(dot(gap, gap) + extent^2 + nearest^2)",
        },
        "wrench": {
            "axes": "body", "at": "point",
            "force": "size*exp(power*log(distance/reference))*gap/distance",
        },
    }  # fmt: skip

    def grid(model: WhitenedModel) -> list[Values]:
        middle = model.samples.position.mean(axis=0)
        offsets = [r * d for r in _REACHES for d in (directions() if r else np.zeros((1, 3)))]
        return [
            {"size": 1.0, "power": n, "place": middle + offset, "extent": 0.3 * _EXTENT}
            for n in _CENTRAL_EXPONENTS
            for offset in offsets
        ]

    words = "a force toward {place} m of the world, at {point} m of the object, ~ distance^{power}"
    return HeldForm("central_force", words, entry, grid, ("size",), "point")


def _drag() -> HeldForm:
    entry = {
        "parameters": {"size": _SIZE, "power": _EXPONENT, "point": _POINT},
        "constants": {
            "reference": {"value": 0.1, "unit": "m/s"}, "slowest": {"value": 5e-3, "unit": "m/s"},
        },
        "definitions": {
            "moving": "v + cross(omega, point)",
            "pace": "sqrt(dot(moving, moving) + slowest^2)",
        },
        "wrench": {
            "axes": "body", "at": "point",
            "force": "-size*exp(power*log(pace/reference))*moving/pace",
        },
    }  # fmt: skip
    words = "a drag at {point} m of the object, ~ speed^{power}"
    return HeldForm("drag", words, entry, _powers(_SPEED_EXPONENTS, 1.0), ("size",), "point")


def _rail() -> HeldForm:
    entry = {
        "parameters": {
            "size": _SIZE, "power": _EXPONENT, "point": _POINT,
            "azimuth": _scalar("rad", 3.0, "of the axis, about z of the world from x"),
            "elevation": _scalar("rad", 3.0, "of the axis, over the plane z = 0 of the world"),
        },
        "constants": {
            "reference": {"value": 0.1, "unit": "m/s"}, "slowest": {"value": 5e-3, "unit": "m/s"},
        },
        "definitions": {
            "level": "cos(azimuth)*world_x + sin(azimuth)*world_y",
            "axis": "cos(elevation)*level + sin(elevation)*world_z",
            "along": "dot(axis, v + cross(omega, point))",
            "pace": "sqrt(along^2 + slowest^2)",
        },
        "wrench": {
            "axes": "body", "at": "point",
            "force": "-size*exp(power*log(pace/reference))*along/pace*axis",
        },
    }  # fmt: skip

    def grid(model: WhitenedModel) -> list[Values]:
        half = directions()[:13]
        azimuth, elevation = np.arctan2(half[:, 1], half[:, 0]), np.arcsin(half[:, 2])
        return [
            {"size": 1.0, "power": n, "azimuth": a, "elevation": e}
            for n in _SPEED_EXPONENTS
            for a, e in zip(azimuth, elevation, strict=True)
        ]

    words = (
        "a drag along one axis of the world only (azimuth {azimuth}, elevation {elevation} rad), "
        "at {point} m of the object, ~ speed^{power}"
    )
    return HeldForm("drag_along_axis", words, entry, grid, ("size",), "point")


def _turning() -> HeldForm:
    entry = {
        "parameters": {"size": _scalar("N m", 1.0, "torque at the reference"), "power": _EXPONENT},
        "constants": {
            "reference": {"value": 1.0, "unit": "rad/s"},
            "slowest": {"value": 0.05, "unit": "rad/s"},
        },
        "definitions": {"pace": "sqrt(dot(omega, omega) + slowest^2)"},
        "wrench": {
            "axes": "body", "torque": "-size*exp(power*log(pace/reference))*omega/pace",
        },
    }  # fmt: skip
    words = "a torque against the rotation, ~ rate^{power}"
    return HeldForm("turning_drag", words, entry, _powers(_SPEED_EXPONENTS, 1.0), ("size",))


def _lift() -> HeldForm:
    entry = {
        "parameters": {
            "size": _scalar("N s^2/m/rad", 5.0, "force over rate and speed"), "point": _POINT,
        },
        "wrench": {
            "axes": "body", "at": "point", "force": "size*cross(omega, v + cross(omega, point))",
        },
    }  # fmt: skip
    words = "a force across velocity and rotation, size {size} N s^2/m/rad, at {point} m"
    return HeldForm("side_force", words, entry, lambda _: [{"size": 1.0}], ("size",), "point")


def _shaker(axes: str) -> HeldForm:
    cosine, sine = (
        (_IN_WORLD.format(name) if axes == "world" else name) for name in ("cosine", "sine")
    )
    entry = {
        "parameters": {
            "frequency": _scalar("Hz", 30.0, "frequency"), "point": _POINT,
            "cosine": _vector("N", 10.0, "force in phase with the cosine"),
            "sine": _vector("N", 10.0, "force in phase with the sine"),
        },
        "definitions": {"phase": "2*pi*frequency*t"},
        "wrench": {
            "axes": "body", "at": "point",
            "force": f"({cosine})*cos(phase) + ({sine})*sin(phase)",
        },
    }  # fmt: skip
    words = f"a force that swings at {{frequency}} Hz in {axes} axes, at {{point}} m of the object"
    linear = tuple(f"{name}_{axis}" for name in ("cosine", "sine") for axis in AXES)
    name = f"{axes}_shaker"
    return HeldForm(name, words, entry, lambda _: [], linear, line="frequency")


def _decay(axes: str) -> HeldForm:
    point = axes == "world"
    parameters = {
        "rate": _scalar("1/s", 3.0, "rate of decay"),
        "push": _vector("N", 10.0, "force at the start"),
    }
    wrench = {"axes": axes, "force": "push*exp(-rate*t)"}
    if not point:
        parameters["twist"] = _vector("N m", 1.0, "torque at the start")
        wrench["torque"] = "twist*exp(-rate*t)"
    entry = {"parameters": parameters, "wrench": wrench}
    words = f"a wrench in {axes} axes that decays at {{rate}} 1/s"
    names = ("push",) if point else ("push", "twist")
    linear = tuple(f"{name}_{axis}" for name in names for axis in AXES)
    return HeldForm(f"{axes}_decay", words, entry, lambda _: [{"rate": r} for r in _RATES], linear)


def _powers(exponents: Sequence[float], size: float) -> Callable[[WhitenedModel], list[Values]]:
    """Starts at exponents."""
    return lambda model: [{"size": size, "power": n} for n in exponents]
