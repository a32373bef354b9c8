"""Named physical quantities of held objects, for formulas: symbols, units and values."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
import sympy

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.formula.expression import Term
from tactile_dynamics_ros.core.effects.geometry import AXES, body_from_world, to_body
from tactile_dynamics_ros.core.effects.parameter import parse_unit
from tactile_dynamics_ros.core.errors import BadInputError

SCALARS = {
    "t": ("s", "time from the start of the recording"),
    "m": ("kg", "mass of the object"),
    "speed": ("m/s", "speed of the body origin"),
    "turn_rate": ("rad/s", "magnitude of the angular velocity"),
}
"""Unit and meaning of the scalars that formulas can name; names are API."""
VECTORS = {
    "p": ("m", "position of the body origin from the world origin"),
    "v": ("m/s", "velocity of the body origin"),
    "a": ("m/s^2", "acceleration of the body origin"),
    "g": ("m/s^2", "gravity"),
    "omega": ("rad/s", "angular velocity"),
    "alpha": ("rad/s^2", "angular acceleration"),
    "com": ("m", "centre of mass from the body origin"),
    **{f"world_{axis}": ("1", f"unit vector along {axis} of the world") for axis in AXES},
}
"""Unit and meaning of the vectors that formulas can name; names are API."""
CONTACT_SCALARS = {
    "grip": ("N", "normal force of a contact, never negative"),
    "spin": ("rad/s", "angular velocity of the object about the contact normal"),
}
"""Unit and meaning of the scalars that every contact has; names are API."""
CONTACT_VECTORS = {
    "f": ("N", "force of a contact on the object"),
    "couple": ("N m", "torque of a contact about its point"),
    "r": ("m", "contact point from the body origin"),
    "n": ("1", "normal of a contact, into the object"),
}
"""Unit and meaning of the vectors that every contact has; names are API."""
FRAMES = ("world", "body", "contact")
"""Axes in which a law can be written; names are API."""

_VECTOR = re.compile(rf"({'|'.join(VECTORS)})(?:_([xyz]))?(?:_(world|body|contact))?$")
"""A vector or its component, in axes that may be named: ``v_x_world``."""
_CONTACT_VECTOR = re.compile(
    rf"({'|'.join(CONTACT_VECTORS)})(?:_([xyz]))?(?:_(?!(?:world|body|contact)$)(\w+?))?"
    r"(?:_(world|body|contact))?$"
)
"""A vector of a contact that may be named, or its component: ``f_x_thumb_body``."""
_CONTACT_SCALAR = re.compile(rf"({'|'.join(CONTACT_SCALARS)})(?:_(\w+))?$")
"""A scalar of a contact that may be named: ``grip_thumb``."""

EACH = ""
"""Name of the contact in quantities that leave it open: a law is summed over all of them. Any other
text could be the name of a contact."""
MASS = sympy.Symbol("m", real=True)
"""Symbol of the mass, kg. Real, so that formulas of it simplify; another name breaks files that use
it."""
COM = sympy.Matrix([sympy.Symbol(f"com_{axis}", real=True) for axis in AXES])
"""Symbols of the centre of mass, m. Real, so that formulas of it simplify; other names break files
that use them."""


@dataclass(frozen=True)
class Quantity:
    """One measured number per sample (and contact).

    Attributes:
        kind: name of the scalar or vector; `axes` for an entry of the rotation of a frame.
        index: component, or (row, column) of `axes`.
        frame: axes of the vector.
        contact: name, EACH for every contact in turn, None where no contact matters.
    """

    kind: str
    index: tuple[int, ...] = ()
    frame: str = ""
    contact: str | None = None

    @property
    def symbol(self) -> Any:
        """Its symbol in formulas."""
        place = "".join(map(str, self.index))
        return sympy.Symbol(f"q_{self.kind}{place}_{self.frame}_{self.contact}", real=True)


class QuantityTable:
    """Resolves names in one wrench and remembers which quantities it uses."""

    def __init__(self, frame: str, each_contact: bool) -> None:
        """Choose the axes of vectors without suffix.

        Args:
            frame: of FRAMES.
            each_contact: whether names of contacts may be left out.
        """
        self.frame, self.each_contact = frame, each_contact
        self.used: dict[Any, Quantity] = {}

    def find(self, name: str) -> Term | None:
        """Term of a name, None if it is no quantity.

        Raises:
            BadInputError: a contact or its axes are named where no contact is meant.
        """
        if name in SCALARS:
            unit = parse_unit(SCALARS[name][0])
            return Term(MASS if name == "m" else self._use(Quantity(name)), unit)
        if found := _VECTOR.match(name):
            kind, axis, frame = found.groups()
            vector = self._vector(kind, frame or self.frame, None)
            return Term(_component(vector, axis), parse_unit(VECTORS[kind][0]))
        if found := _CONTACT_SCALAR.match(name):
            kind, contact = found.groups()
            symbol = self._use(Quantity(kind, (), "", self._contact(name, contact)))
            return Term(symbol, parse_unit(CONTACT_SCALARS[kind][0]))
        if found := _CONTACT_VECTOR.match(name):
            kind, axis, contact, frame = found.groups()
            vector = self._vector(kind, frame or self.frame, self._contact(name, contact))
            return Term(_component(vector, axis), parse_unit(CONTACT_VECTORS[kind][0]))
        return None

    def rotation(self, frame: str) -> Any:
        """Matrix whose columns are the axes of a frame in the body frame."""
        if frame == "body":
            return sympy.eye(3)
        self._require_contact(frame)
        contact = EACH if frame == "contact" else None
        return sympy.Matrix(
            3, 3, lambda i, j: self._use(Quantity("axes", (int(i), int(j)), frame, contact))
        )

    def _vector(self, kind: str, frame: str, contact: str | None) -> Any:
        self._require_contact(frame)
        if kind == "com":
            return self.rotation(frame).T * COM
        return sympy.Matrix([self._use(Quantity(kind, (k,), frame, contact)) for k in range(3)])

    def _use(self, quantity: Quantity) -> Any:
        self.used[quantity.symbol] = quantity
        return quantity.symbol

    def _contact(self, name: str, contact: str | None) -> str:
        if contact is None and not self.each_contact:
            raise BadInputError(
                f"'{name}' does not say of which contact: write {name}_thumb, or `at: contacts` "
                "for a sum over all contacts"
            )
        return contact or EACH

    def _require_contact(self, frame: str) -> None:
        if frame == "contact" and not self.each_contact:
            raise BadInputError("axes `contact` need `at: contacts`")


def is_reserved(name: str) -> bool:
    """Whether a name belongs to a quantity and may not be declared."""
    bare = name in CONTACT_SCALARS or name in CONTACT_VECTORS
    return name == "pi" or name in SCALARS or bare or bool(_VECTOR.match(name))


def unknown_name(name: str, declared: Iterable[str]) -> BadInputError:
    """Error that proposes what may have been meant."""
    components = [f"{v}_{axis}" for v in (*VECTORS, *CONTACT_VECTORS) for axis in AXES]
    known = [*declared, *SCALARS, *VECTORS, *CONTACT_SCALARS, *CONTACT_VECTORS]
    close = get_close_matches(name, [*known, *components], 1, 0.5)
    hint = f"did you mean '{close[0]}'?" if close else f"expected one of {', '.join(known)}"
    return BadInputError(f"'{name}' is neither declared nor a quantity: {hint}")


def quantity_values(quantity: Quantity, samples: WrenchSamples) -> Array:
    """Values (N, 1), or (N, C) where they differ between contacts."""
    if quantity.kind == "axes":
        row, column = quantity.index
        return _axes(samples, quantity.frame)[:, :, row, column]
    if quantity.kind in SCALARS:
        return _scalar(quantity.kind, samples)[:, None]
    if quantity.kind in CONTACT_SCALARS:
        along = "f" if quantity.kind == "grip" else "omega"
        normal = _body_vector(Quantity("n", contact=quantity.contact), samples)
        vector = _body_vector(Quantity(along, contact=quantity.contact), samples)
        value = np.einsum("nci,nci->nc", *np.broadcast_arrays(normal, vector))
        return np.asarray(np.maximum(value, 0.0) if quantity.kind == "grip" else value)
    vector = _body_vector(quantity, samples)
    axes = _axes(samples, quantity.frame)[..., quantity.index[0]]
    return np.asarray((axes * vector).sum(axis=2))


def _component(vector: Any, axis: str | None) -> Any:
    return vector if axis is None else vector[AXES.index(axis)]


def _scalar(kind: str, samples: WrenchSamples) -> Array:
    if kind == "t":
        return samples.time
    vector = samples.velocity if kind == "speed" else samples.angular_velocity
    return np.asarray(np.linalg.norm(vector, axis=1))


def _axes(samples: WrenchSamples, frame: str) -> Array:
    """Axes of a frame as columns in the body frame, (N, 1 or C, 3, 3)."""
    if frame == "contact":
        return samples.contact_rotation
    if frame == "world":
        return body_from_world(samples)[:, None]
    return np.broadcast_to(np.eye(3), (len(samples.time), 1, 3, 3))


def _body_vector(quantity: Quantity, samples: WrenchSamples) -> Array:
    """A vector in the body frame, (N, 1 or C, 3)."""
    world = {"p": samples.position, "v": samples.velocity, "a": samples.acceleration}
    if quantity.kind.startswith("world_"):
        return body_from_world(samples)[:, None, :, AXES.index(quantity.kind[-1])]
    if quantity.kind in ("omega", "alpha"):
        turning = quantity.kind == "omega"
        rate = samples.angular_velocity if turning else samples.angular_acceleration
        return rate[:, None]
    if quantity.kind in VECTORS:
        return to_body(samples, world.get(quantity.kind, samples.gravity))[:, None]
    vectors = {
        "f": samples.contact_force,
        "couple": samples.contact_torque,
        "r": samples.contact_point,
        "n": samples.contact_rotation[..., 2],
    }[quantity.kind]
    if quantity.contact == EACH:
        return vectors
    if quantity.contact not in samples.contact_names:
        raise BadInputError(
            f"contact '{quantity.contact}' is not in the recording: "
            f"expected {', '.join(samples.contact_names)}"
        )
    return vectors[:, [samples.contact_names.index(quantity.contact)]]
