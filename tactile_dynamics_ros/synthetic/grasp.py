"""Four fingertips that hold the object: where they touch, how they roll, how hard they grip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from tactile_dynamics_ros.synthetic.motion import SumOfSines
from tactile_dynamics_ros.synthetic.objects import HeldObject

FINGERS = ("index", "middle", "ring", "thumb")
FRICTION = 0.9
RAMP_S = 0.15
_PLACEMENTS_TRIED = 12
_AROUND_RAD = np.radians([40.0, -5.0, -50.0, 180.0])
_ALONG = np.array([0.18, -0.02, -0.18, 0.0])


@dataclass(frozen=True)
class Placement:
    """Where each finger touches and how it squeezes.

    Attributes:
        point: (C, 3) m, body frame.
        normal: (C, 3) unit normals into the object.
        squeeze: (C, 3) internal forces (no net wrench) of 1 N mean normal force, body frame.
    """

    point: np.ndarray
    normal: np.ndarray
    squeeze: np.ndarray


@dataclass(frozen=True)
class Lift:
    """A finger leaves the object from start to stop; if it moves, it lands elsewhere."""

    finger: int
    start: float
    stop: float
    moves: bool


@dataclass(frozen=True)
class ContactSamples:
    """Contacts at N instants in the body frame.

    Attributes:
        weight: (N, C) 0 without contact, 1 when fully loaded.
        point: (N, C, 3) m.
        rotation: (N, C, 3, 3) R_OC; z is the normal into the object, x and y turn with the finger.
        spin: (N, C) rad/s of the object relative to the finger about the normal.
        wish: (N, C, 3) N, the grip force that each finger would apply on a weightless object.
    """

    weight: np.ndarray
    point: np.ndarray
    rotation: np.ndarray
    spin: np.ndarray
    wish: np.ndarray

    @property
    def normal(self) -> np.ndarray:
        """(N, C, 3) unit normals into the object."""
        return self.rotation[..., 2]


@dataclass(frozen=True)
class Grasp:
    """How the fingers hold the object over time."""

    placements: tuple[Placement, Placement]
    lifts: tuple[Lift, ...]
    roll: SumOfSines
    squeeze: SumOfSines
    grip: float

    def evaluate(self, time: np.ndarray) -> ContactSamples:
        """Return the contacts at the given instants."""
        weight = np.ones((len(time), len(FINGERS)))
        second = np.zeros((len(time), len(FINGERS)), dtype=bool)
        for lift in self.lifts:
            weight[:, lift.finger] *= _lift_weight(time, lift)
            second[:, lift.finger] |= lift.moves & (time > 0.5 * (lift.start + lift.stop))
        first, then = self.placements
        point = np.where(second[..., None], then.point, first.point)
        normal = np.where(second[..., None], then.normal, first.normal)
        angle, rate, _ = self.roll.evaluate(time)
        modulation = self.grip * (1.0 + self.squeeze.evaluate(time)[0])
        wish = modulation[..., None] * np.where(second[..., None], then.squeeze, first.squeeze)
        return ContactSamples(weight, point, _contact_rotation(normal, angle), -rate, wish)


def solve_contact_forces(
    contacts: ContactSamples, wrench: np.ndarray, torque_per_force: np.ndarray | None = None
) -> np.ndarray:
    """Contact forces nearest to the wished grip that apply exactly the given wrench.

    minimise sum |f - wish|^2 / weight  subject to  G f = wrench,
    where G has the rows [p x + torque_per_force; 1].

    Args:
        contacts: the contacts at N instants.
        wrench: (N, 6) torque about the body origin and force, body axes.
        torque_per_force: (N, C, 3, 3) torque that a contact applies per newton, or None.

    Returns:
        (N, C, 3) forces on the object in the body frame; exactly zero without contact.
    """
    count, fingers = contacts.weight.shape
    torque_map = _cross_matrix(contacts.point)
    if torque_per_force is not None:
        torque_map = torque_map + torque_per_force
    grasp_map = np.concatenate([torque_map, np.broadcast_to(np.eye(3), torque_map.shape)], axis=-2)
    grasp_map = grasp_map.transpose(0, 2, 1, 3).reshape(count, 6, 3 * fingers)
    weight = np.repeat(contacts.weight, 3, axis=1)
    wish = weight * contacts.wish.reshape(count, -1)
    weighted = grasp_map * weight[:, None, :]
    missing = wrench - np.einsum("nij,nj->ni", grasp_map, wish)
    share = np.linalg.solve(weighted @ grasp_map.transpose(0, 2, 1), missing[..., None])[..., 0]
    return (wish + np.einsum("nij,ni->nj", weighted, share)).reshape(count, fingers, 3)


def draw_grasp(rng: np.random.Generator, body: HeldObject, lifts: tuple[Lift, ...]) -> Grasp:
    """Draw placements, rolling and squeezing; the grip is 1 N until it is set for the motion."""
    first, then = (_draw_firm_placement(rng, body) for _ in range(2))
    roll_peaks = np.radians(rng.uniform(15.0, 40.0, size=len(FINGERS)))
    squeeze_peaks = rng.uniform(0.05, 0.15, size=len(FINGERS))
    return Grasp(
        placements=(first, then),
        lifts=lifts,
        roll=SumOfSines.draw(rng, roll_peaks, (0.1, 1.0), tones=3),
        squeeze=SumOfSines.draw(rng, squeeze_peaks, (0.05, 0.4), tones=3),
        grip=1.0,
    )


def friction_margin(contacts: ContactSamples, force: np.ndarray) -> np.ndarray:
    """Mu f_n - |f_t| at each instant and finger in N; negative outside the friction cone."""
    return _margin(force, contacts.normal)


def _margin(force: np.ndarray, normal: np.ndarray) -> np.ndarray:
    normal_force = (force * normal).sum(-1)
    tangential = force - normal_force[..., None] * normal
    return FRICTION * normal_force - np.linalg.norm(tangential, axis=-1)


def _draw_firm_placement(rng: np.random.Generator, body: HeldObject) -> Placement:
    """The firmest of several placements: the one whose squeeze stays farthest inside the cones."""
    drawn = [_draw_placement(rng, body) for _ in range(_PLACEMENTS_TRIED)]
    return max(drawn, key=lambda place: _margin(place.squeeze, place.normal).min())


def _draw_placement(rng: np.random.Generator, body: HeldObject) -> Placement:
    around = _AROUND_RAD + np.radians(rng.uniform(-12.0, 12.0, size=4))
    height = (_ALONG + rng.uniform(-0.06, 0.06, size=4)) * body.size[2]
    outward = np.stack([np.cos(around), np.sin(around), np.zeros(4)], axis=1)
    if body.shape == "cylinder":
        point = outward * body.size[0] / 2
        normal = -outward
    else:
        half = body.size / 2
        reach = half[:2] / np.maximum(np.abs(outward[:, :2]), 1e-9)
        side = reach.argmin(axis=1)
        point = outward * reach.min(axis=1)[:, None]
        normal = np.zeros((4, 3))
        normal[np.arange(4), side] = -np.sign(outward[np.arange(4), side])
    point[:, 2] = height
    return Placement(point, normal, _internal_squeeze(point, normal))


def _internal_squeeze(point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Forces without net wrench that stay farthest inside the friction cones (linear program)."""
    count = len(point)
    balance = np.concatenate([np.hstack(list(_cross_matrix(point))), np.tile(np.eye(3), count)])
    tangents = _contact_rotation(normal, np.zeros(count))[..., :2]
    rows = []
    for direction in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        side = tangents @ np.array([np.cos(direction), np.sin(direction)])
        for finger in range(count):
            row = np.zeros(3 * count + 1)
            row[3 * finger : 3 * finger + 3] = side[finger] - FRICTION * normal[finger]
            row[-1] = 1.0
            rows.append(row)
    equal = np.zeros((7, 3 * count + 1))
    equal[:6, :-1], equal[6, :-1] = balance, normal.reshape(-1) / count
    best = linprog(
        c=np.append(np.zeros(3 * count), -1.0),
        A_ub=np.array(rows),
        b_ub=np.zeros(len(rows)),
        A_eq=equal,
        b_eq=np.append(np.zeros(6), 1.0),
        bounds=(None, None),
    )
    return best.x[:-1].reshape(count, 3)


def _contact_rotation(normal: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """R_OC with z along the normal and x turned by the angle from the plane of body z."""
    base_y = np.cross(normal, np.array([0.0, 0.0, 1.0]))
    base_y /= np.linalg.norm(base_y, axis=-1, keepdims=True)
    base_x = np.cross(base_y, normal)
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.stack(
        [cosine * base_x + sine * base_y, cosine * base_y - sine * base_x, normal], axis=-1
    )


def _lift_weight(time: np.ndarray, lift: Lift) -> np.ndarray:
    leaving = np.clip((time - lift.start) / RAMP_S, 0.0, 1.0)
    landing = np.clip((time - lift.stop + RAMP_S) / RAMP_S, 0.0, 1.0)
    return 0.5 + 0.5 * np.cos(np.pi * np.minimum(leaving, 1.0 - landing))


def _cross_matrix(vector: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices that multiply like the cross product from the left."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
