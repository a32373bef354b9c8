"""All that a simulated recording consists of: object, table, contact, actions, what is hidden."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.actions import Action
from tactile_dynamics_ros.synthetic.pushed.friction_field import FrictionField
from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY, PushedObject

STEP = 0.002
"""Physical clock, s. Halving it moves the end of a recording by less than 0.1 mm (tested)."""


@dataclass(frozen=True)
class BodyState:
    """Motion of one link at an instant.

    Attributes:
        time: s.
        origin: (2,) m. rotation: (2, 2). velocity: (2,) m/s of the origin. turn_rate: rad/s.
    """

    time: float
    origin: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    turn_rate: float

    def place(self, point: np.ndarray) -> np.ndarray:
        """Return a point of the link on the table."""
        return np.asarray(self.origin + self.rotation @ point)

    def speed(self, point: np.ndarray) -> np.ndarray:
        """Return the velocity of a point of the link."""
        arm = self.rotation @ point
        return np.asarray(self.velocity + self.turn_rate * np.array([-arm[1], arm[0]]))


class Influence(Protocol):
    """Something that acts on link_1 besides table and pusher."""

    def act(self, state: BodyState) -> tuple[np.ndarray, np.ndarray, float]:
        """Return force (2,) N, the place (2,) where it acts, and load N that it adds there."""


@dataclass(frozen=True)
class Tip:
    """How the pusher touches.

    Attributes:
        radius: m, of the sphere at its end.
        height: m, of the contact above the table.
        stiffness, shear_stiffness: N/m, of tip and arm. damping: N s/m.
        friction: coefficient between tip and object.
        grip: N, by which each pad presses in a pull.
    """

    radius: float = 0.006
    height: float = 0.02
    stiffness: float = 2e4
    shear_stiffness: float = 1.5e4
    damping: float = 60.0
    friction: float = 0.35
    grip: float = 12.0


@dataclass(frozen=True)
class Change:
    """What happens to the object at one time.

    Attributes:
        time: s. friction: factor from then on. mass: kg put on link_1. place: (2,) m in its frame.
    """

    time: float
    friction: float = 1.0
    mass: float = 0.0
    place: np.ndarray = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True)
class Film:
    """Where the table is wet: beyond a border (m) along an axis (0 for x, 1 for y)."""

    axis: int
    border: float


@dataclass(frozen=True)
class Scene:
    """One recording to be simulated.

    Attributes:
        seed: of all draws.
        thing: the object.
        tip: of the pusher.
        actions: one after the other.
        gravity: (3,) m/s^2, axes of the table.
        viscosity: N s/m of the whole underside, spread as the feet's stiffness is.
        film: where it acts, or None for everywhere.
        weakening: relative loss of friction at speed. weakening_speed: m/s at which most is lost.
        stiction: relative gain of friction at rest. stiction_speed: m/s.
        stretch: (2, 2) velocity to the velocity that friction sees: the identity is isotropic.
        field: friction from place to place.
        change: at one time, or None.
        influences: besides table and pusher.
    """

    seed: int
    thing: PushedObject
    tip: Tip
    actions: tuple[Action, ...]
    gravity: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -GRAVITY]))
    viscosity: float = 0.0
    film: Film | None = None
    weakening: float = 0.0
    weakening_speed: float = 0.05
    stiction: float = 0.0
    stiction_speed: float = 0.002
    stretch: np.ndarray = field(default_factory=lambda: np.eye(2))
    field: FrictionField | None = None
    change: Change | None = None
    influences: tuple[Influence, ...] = ()

    @property
    def steps(self) -> int:
        """Steps of the physical clock."""
        return sum(len(action.path) for action in self.actions)
