"""Residuals as wrenches for people, and simple functions that may explain them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Residuals
from tactile_dynamics_ros.core.effects.filters import FirstOrderLag
from tactile_dynamics_ros.core.effects.geometry import (
    AXES,
    body_from_world,
    force_columns,
    to_body,
    torque_columns,
)
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel

_RELAXATION = 2.0
"""Time constant, s, of the slow part of a contact's force in terms that creep: skin relaxes within
0.1 to 0.3 s and several s (hardware facts), and 2 s lies between. The term shows that something
creeps, its time constant is not estimated: far from it, creep is described less well and may lose
to another law."""
_SLOWEST = 0.02
"""Speed, m/s or rad/s, below which a direction of motion fades to zero, so that terms of dry
friction do not turn with noise at rest. More takes slow motion out of them. Here 2 cm/s, above the
noise of velocities from poses and below that of a hand; less lets terms flip with noise at each
turning point."""


@dataclass(frozen=True)
class Term:
    """Wrench columns that depend on one quantity.

    Attributes:
        quantity: its name.
        label: the dependence in words.
        columns: (N, 6, m) [torque, force], body frame.
        symbols: symbols of the columns, empty where they are too many for a formula.
        frame: in which the dependence is simple.
        effect: the effect of the catalogue that it is, if it is one.
    """

    quantity: str
    label: str
    columns: Array
    symbols: tuple[str, ...]
    frame: str
    effect: str = ""


def wrench_terms(samples: WrenchSamples) -> Iterator[Term]:
    """All terms of the library, one after the other."""
    yield from _constants(samples)
    yield from _motion_terms(samples)
    yield from _rotation_terms(samples)
    yield from _contact_terms(samples)


def _forces(vectors: Array) -> Array:
    """Force columns at the origin (N, 6, m) of (N, 3, m)."""
    return force_columns(np.zeros(3), vectors)


def _isotropic(
    quantity: str, label: str, vectors: Array, symbol: str, frame: str, effect: str = ""
) -> Iterator[Term]:
    """One force along a vector (N, 3), body axes."""
    yield Term(quantity, label, _forces(vectors[..., None]), (symbol,), frame, effect)


def _linear(samples: WrenchSamples, quantity: str, vectors: Array) -> Iterator[Term]:
    """World force and body torque that depend linearly on the components of a vector."""
    world = body_from_world(samples)
    products = np.einsum("nij,nk->nijk", world, vectors).reshape(len(vectors), 3, 9)
    yield Term(quantity, f"world force linear in {quantity}", _forces(products), (), "world")
    local = np.einsum("ij,nk->nijk", np.eye(3), to_body(samples, vectors))
    local = local.reshape(len(vectors), 3, 9)
    yield Term(quantity, f"body force linear in {quantity}", _forces(local), (), "body")
    yield Term(quantity, f"torque linear in {quantity}", torque_columns(local), (), "body")


def _constants(samples: WrenchSamples) -> Iterator[Term]:
    count = len(samples.time)
    ramp = (samples.time - samples.time.mean()) / max(float(np.ptp(samples.time)), 1e-9)
    world = body_from_world(samples)
    fixed = np.tile(np.eye(6), (count, 1, 1))
    symbols = tuple(f"[force_{a}, world]" for a in AXES)
    pull = "hanging_cable"
    yield Term("gravity", "constant world force", _forces(world), symbols, "world", pull)
    yield Term("constant", "constant body wrench", fixed, (), "body")
    powers = [fixed * ramp[:, None, None] ** k for k in (1, 2, 3)]
    yield Term("time", "body wrench that drifts", np.concatenate(powers, axis=2), (), "body")
    steps = [fixed * (ramp > level)[:, None, None] for level in (-0.25, 0.0, 0.25)]
    yield Term("time", "body wrench that steps", np.concatenate(steps, axis=2), (), "body")
    moved = [_forces(world) * ramp[:, None, None] ** k for k in (1, 2)]
    yield Term("time", "world force that drifts", np.concatenate(moved, axis=2), (), "world")


def _motion_terms(samples: WrenchSamples) -> Iterator[Term]:
    velocity = to_body(samples, samples.velocity)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    drag = "viscous_drag"
    yield from _isotropic("velocity", "force along v", velocity, "v", "world", drag)
    squared, drag = speed * velocity, "quadratic_drag"
    yield from _isotropic("velocity", "force along |v| v", squared, "|v| v", "world", drag)
    direction = velocity / np.maximum(speed, _SLOWEST)
    yield from _isotropic("velocity", "force along v/|v|", direction, "v/|v|", "world")
    yield from _linear(samples, "velocity", samples.velocity)
    acceleration = to_body(samples, samples.acceleration)
    mass = "added_mass"
    yield from _isotropic("acceleration", "force along a", acceleration, "a", "world", mass)
    yield from _linear(samples, "acceleration", samples.acceleration)
    middle = samples.position - samples.position.mean(axis=0)
    away = to_body(samples, middle)
    yield from _isotropic("position", "force along p - mean", away, "(p - <p>)", "world")
    yield from _linear(samples, "position", middle)
    yield _curved(samples, middle)


def _curved(samples: WrenchSamples, middle: Array) -> Term:
    """World force that depends on position to second order."""
    products = [middle[:, i] * middle[:, j] for i in range(3) for j in range(i, 3)]
    shape = np.stack([*middle.T, *products], axis=1)
    columns = np.einsum("nij,nk->nijk", body_from_world(samples), shape)
    columns = columns.reshape(len(middle), 3, -1)
    return Term("position", "world force curved in position", _forces(columns), (), "world")


def _rotation_terms(samples: WrenchSamples) -> Iterator[Term]:
    omega, alpha = samples.angular_velocity, samples.angular_acceleration
    velocity = to_body(samples, samples.velocity)
    lift = np.cross(omega, velocity)
    yield from _isotropic("angular_velocity", "force along omega x v", lift, "omega x v", "world")
    rate = np.linalg.norm(omega, axis=1, keepdims=True)
    for symbol, torque in (
        ("omega", omega),
        ("|omega| omega", rate * omega),
        ("omega/|omega|", omega / np.maximum(rate, _SLOWEST)),
    ):
        columns = torque_columns(torque[..., None])
        label = f"torque along {symbol}"
        effect = "rotational_drag" if symbol == "omega" else ""
        yield Term("angular_velocity", label, columns, (f"[torque] {symbol}",), "body", effect)
    yield from _linear(
        samples, "angular_velocity", np.einsum("nij,nj->ni", samples.rotation, omega)
    )
    yield from _linear(
        samples, "angular_acceleration", np.einsum("nij,nj->ni", samples.rotation, alpha)
    )


def _contact_terms(samples: WrenchSamples) -> Iterator[Term]:
    """Wrenches at each contact that depend on its own force."""
    for index, name in enumerate(samples.contact_names):
        force = samples.contact_force[:, index]
        point = samples.contact_point[:, index]
        size = np.linalg.norm(force, axis=1, keepdims=True)
        slow = FirstOrderLag(samples.time, force, _RELAXATION).response
        shapes = np.stack([force, size * force, size**2 * force, force / np.maximum(size, 0.05)], 2)
        columns = force_columns(point, shapes)
        yield Term("force", f"{name}: along its force", columns, (), "contact")
        creeping = np.stack([force - slow, slow], axis=2)
        yield Term(
            "force", f"{name}: lags its force", force_columns(point, creeping), (), "contact"
        )
        mixed = np.einsum("nk,ij->nijk", force, np.eye(3)).reshape(len(force), 3, 9)
        yield Term(
            "force", f"{name}: linear in its force", force_columns(point, mixed), (), "contact"
        )


CHANNELS = ("torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z")
"""Channels of a wrench residual in the order of `core`, [torque, force]; names that documents and
reports show. Another order here alone would name a force a torque."""
UNITS = ("N m", "N m", "N m", "N", "N", "N")
"""Units of these channels. They follow the channels."""


def wrench_residuals(model: FittedModel, white: Array) -> Residuals:
    """Measured minus predicted wrench about the body origin, with what was going on.

    Args:
        model: whose parameters predict.
        white: (N, 6) white residual of the same samples.
    """
    rotation = np.concatenate([samples.rotation for samples in model.samples])
    to_world = np.zeros((len(rotation), 6, 6))
    to_world[:, :3, :3] = to_world[:, 3:, 3:] = rotation
    parts = [conditions(samples) for samples in model.samples]
    joined = tuple(
        replace(first, values=np.concatenate([part[k].values for part in parts]))
        for k, first in enumerate(parts[0])
    )
    return Residuals(
        time=np.concatenate([samples.time for samples in model.samples]),
        white=white,
        physical=-model.smooth_residual(),
        channels=CHANNELS,
        units=UNITS,
        frames={"world": to_world},
        conditions=joined,
        drivers=np.concatenate(
            [np.concatenate([s.velocity, s.angular_velocity], axis=1) for s in model.samples]
        ),
        factors=_factors(model, white.ravel()),
        frame="body",
        alone="rigid body alone",
        about="The model predicts, from the motion of a rigid body, what forces the contacts must "
        "apply.",
    )


def _factors(model: FittedModel, white: Array) -> tuple[Array, Array]:
    """Residual e = L white and C^-1 e = L^-T white, (N, 6) each."""
    whiteners = [stretch.linearisation.whitener for stretch in model.stretches]
    parts = np.split(white, np.cumsum([len(stretch.residual) for stretch in model.stretches])[:-1])
    pairs = list(zip(whiteners, parts, strict=True))
    plain = np.concatenate([whitener.colour(part) for whitener, part in pairs])
    weighted = np.concatenate([whitener.whiten_transposed(part) for whitener, part in pairs])
    return plain.reshape(-1, 6), weighted.reshape(-1, 6)


def conditions(samples: WrenchSamples) -> list[Condition]:
    """Speeds, tilt, grip and contact state, (N,) each."""
    size = np.linalg.norm
    up = -samples.rotation[:, 2]
    force = size(samples.contact_force, axis=2)
    tilt = np.degrees(np.arccos(np.clip(up @ (up.mean(axis=0) / size(up.mean(axis=0))), -1, 1)))
    found = [
        Condition("speed", "m/s", size(samples.velocity, axis=1)),
        Condition("rate of turn", "rad/s", size(samples.angular_velocity, axis=1)),
        Condition("acceleration", "m/s^2", size(samples.acceleration, axis=1)),
        Condition("tilt from the mean orientation", "deg", tilt),
        Condition("height", "m", samples.position[:, 2]),
        Condition("grip force", "N", force.sum(axis=1)),
        Condition("time", "s", samples.time),
    ]
    if samples.contact_force.shape[1] > 1:
        found += [
            Condition(f"force of {name}", "N", force[:, index])
            for index, name in enumerate(samples.contact_names)
        ]
        held = samples.in_contact.sum(axis=1).astype(float)
        found.append(Condition("contacts", "", held, below_most="while a finger is off the object"))
    return found
