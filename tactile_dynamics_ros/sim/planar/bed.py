"""The face on which a body rests: springs that carry it and bristles that resist its sliding."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import skew

FrictionMap = Callable[[Array], Array]
"""Factor on the coefficient of friction at places (K, 2) of the table."""

GRAVITY = 9.81
SINK = 1e-4
"""Depth to which the bed gives way under a body at rest, m: a vertical period of 20 ms, twenty
simulation steps. At 0.03 mm flat wide bodies rock from step to step for ever (three of 32 planar
objects at 1 ms), ten times as deep lets a body lean visibly when it is pushed."""
DAMPING = 0.4
"""Share of the critical damping of the springs: bounces die within two periods."""
FELT = 5e-4
"""Move, m (or change of a direction), after which the roughness under the feet is looked up anew:
on it a foot's friction changes by 1 %. At each step it takes as long as all the rest."""
AROUND, RINGS = 24, 4
"""Feet around and from the middle of each part: its friction radius is right to 1 %."""


def feet_of(corners: Array) -> tuple[Array, Array]:
    """Return places (K, 2), m, and shares (K,) of the area of feet that fill an outline.

    Args:
        corners: (N, 2) m, anticlockwise, star shaped about its centroid.
    """
    edge, centre = _resampled(corners), _centroid(corners)
    after = np.roll(edge, -1, axis=0)
    sector = 0.5 * np.abs(_wedge(edge - centre, after - centre))
    bounds = np.sqrt(np.linspace(0.0, 1.0, RINGS + 1))
    ring = np.diff(bounds**2)
    reach = np.diff(bounds**3) / (1.5 * ring)  # centroid of a slice of a triangle
    middle = 0.5 * (edge + after) - centre
    places = centre + reach[:, None, None] * middle
    area = ring[:, None] * sector
    return places.reshape(-1, 2), (area / area.sum()).ravel()


def _resampled(corners: Array) -> Array:
    """Return the corners and points between them, about `AROUND`, evenly spaced."""
    after = np.roll(corners, -1, axis=0)
    lengths = np.linalg.norm(after - corners, axis=1)
    counts = np.maximum(1, np.rint(AROUND * lengths / lengths.sum()).astype(int))
    rows = [
        start + (end - start) * np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
        for start, end, count in zip(corners, after, counts, strict=True)
    ]
    return np.concatenate(rows)


def _wedge(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _centroid(corners: Array) -> Array:
    after = np.roll(corners, -1, axis=0)
    area = _wedge(corners, after)
    return np.asarray(((corners + after) * area[:, None]).sum(axis=0) / (3.0 * area.sum()))


@dataclass(frozen=True)
class Support:
    """What the table does to a body during a step.

    Attributes:
        force: (3,) N, world.
        point: (3,) m, world, where it acts: the centre of pressure.
        torque: N m about the vertical there.
    """

    force: Array
    point: Array
    torque: float


@dataclass
class Surface:
    """How the table rubs; what is hidden in it may change while time passes.

    Attributes:
        variation: factor on coefficients by place.
        factor: on all coefficients.
        viscosity: N s/m for a whole body, besides friction.
        lost: share of friction that is lost at high speed. lost_speed: m/s at which 63 % of it is.
        stretch: (2, 2) symmetric, velocity to the velocity that friction opposes; None if even.
    """

    variation: FrictionMap
    factor: float = 1.0
    viscosity: float = 0.0
    lost: float = 0.0
    lost_speed: float = 0.04
    stretch: Array | None = None


class Bed:
    """Table under one rigid body, as feet of their own: pressure, stick and slip at each.

    Each foot stands on a spring (Winkler's foundation), so that the pressure is linear over the
    face, follows tipping moments and vanishes where the body lifts off. A bristle at each foot
    stretches by micrometres before it slips, and then pulls back with coefficient times pressure
    (Coulomb). Engines keep about four contacts of a face, which makes it too hard to turn.

    Args:
        feet: (K, 3) m, body frame.
        shares: (K,) of the springs' stiffness: of the area where the face is even.
        friction: (K,) coefficients.
        mass: kg that rests on it.
        height: of the table, m.
        surface: of the table.

    Attributes:
        shares: as given.
    """

    def __init__(
        self,
        feet: Array,
        shares: Array,
        friction: Array,
        mass: float,
        height: float,
        surface: Surface,
    ) -> None:
        self._feet = np.vstack([feet.T, np.ones(len(feet))])
        self._height, self._surface = height, surface
        self._hard = mass * GRAVITY / SINK
        self._damped = 2.0 * DAMPING * mass * np.sqrt(GRAVITY / SINK)
        self._friction, self._rough = friction, friction
        self._known_at = np.full(4, np.inf)
        self._stretch = np.zeros((2, len(feet)))
        self._pressure = np.zeros(len(feet))
        self.reshape(shares)

    @property
    def pressure(self) -> Array:
        """Force (K,) that each foot carried in the last step, N."""
        return self._pressure

    def reshape(self, shares: Array) -> None:
        """Let the feet share the load in another way, (K,)."""
        self.shares = shares
        self._stiffness, self._damping = self._hard * shares, self._damped * shares

    def places(self) -> Array:
        """Feet (K, 2) m, body frame."""
        return self._feet[:2].T.copy()

    def press(self, pose: Array, angular: Array, linear: Array, step: float) -> Support | None:
        """Return what the table does to the body; None where it does not touch.

        Args:
            pose: (4, 4) of the body frame in the world.
            angular: (3,) rad/s, world axes.
            linear: (3,) m/s of the body frame's origin, world axes.
            step: s since the last call.
        """
        motion = np.empty((6, 4))
        motion[:3] = pose[:3]
        motion[3:, :3] = skew(angular) @ pose[:3, :3]
        motion[3:, 3] = linear
        moved = motion @ self._feet
        depth = self._height - moved[2]
        carried = self._stiffness * depth - self._damping * moved[5]
        self._pressure = pressure = np.maximum(carried, 0.0) * (depth > 0.0)
        total = float(pressure.sum())
        if total <= 0.0:
            self._stretch[:] = 0.0
            return None
        x, y = place = moved[:2]
        self._feel(pose, place)
        drag = self._drag(moved[3:5], step)
        (cx, cy), (fx, fy) = (place @ pressure / total).tolist(), drag.sum(axis=1).tolist()
        torque = float(x @ drag[1] - y @ drag[0]) - cx * fy + cy * fx
        return Support(np.array([fx, fy, total]), np.array([cx, cy, self._height]), torque)

    def _feel(self, pose: Array, place: Array) -> None:
        """Look up the table's roughness under feet (2, K) that have moved on."""
        now = pose[:2, [0, 3]].ravel()
        if np.abs(now - self._known_at).max() > FELT:
            self._rough, self._known_at = self._friction * self._surface.variation(place.T), now

    def _drag(self, velocity: Array, step: float) -> Array:
        """Stretch the bristles and return the friction (2, K) of each foot, N."""
        surface = self._surface
        seen = velocity if surface.stretch is None else surface.stretch @ velocity
        damped = self._damping * seen
        held = self._stiffness * (self._stretch + step * seen) + damped
        limit = surface.factor * self._rough * self._pressure
        if surface.lost > 0.0:
            speed = np.hypot(seen[0], seen[1])
            limit *= 1.0 - surface.lost * (1.0 - np.exp(-speed / surface.lost_speed))
        size = np.maximum(np.hypot(held[0], held[1]), 1e-12)
        held *= np.minimum(limit / size, 1.0)
        self._stretch = (held - damped) / self._stiffness
        if surface.stretch is not None:
            held = surface.stretch @ held
        if surface.viscosity > 0.0:
            held += surface.viscosity * self.shares * velocity
        return np.asarray(-held)


def uneven_friction(spread: float, seed: int) -> FrictionMap:
    """Return a smooth map of factors around 1 whose standard deviation is `spread`.

    Sources of real pushes find 8 to 13 % from place to place. Waves are 3 to 15 cm long.

    Args:
        spread: standard deviation of the factor.
        seed: of the draw.
    """
    rng = np.random.default_rng([seed, 31])
    count = 24
    number = 2.0 * np.pi / rng.uniform(0.03, 0.15, count)
    turn, phase = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    waves = number * np.stack([np.cos(turn), np.sin(turn)])

    def factor(place: Array) -> Array:
        ripple = np.cos(place @ waves + phase).sum(axis=1)
        return np.asarray(np.maximum(1.0 + spread * ripple * np.sqrt(2.0 / count), 0.1))

    return factor if spread > 0.0 else lambda place: np.ones(len(place))


def gathered(feet: Sequence[tuple[Array, Array]], areas: Sequence[float]) -> tuple[Array, Array]:
    """Return the feet of parts that are one body, each with its share of the whole area."""
    whole = sum(areas)
    shares = [share * area / whole for (_, share), area in zip(feet, areas, strict=True)]
    return np.concatenate([place for place, _ in feet]), np.concatenate(shares)
