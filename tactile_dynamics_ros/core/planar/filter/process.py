"""What a model of pushing has to do to be filtered, planned with and explored with.

Frame S: of the support, z upwards. A state has six numbers for each link: x, y (m) and yaw (rad) of
the link's frame in S, then the velocities of the same three (m/s, m/s, rad/s). C hypotheses are
predicted at once, each with its own state and parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array

Mask = NDArray[np.bool_]

LINK_STATE = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate")
"""Numbers of the state of one link, as documented above; link_1 first, then link_2."""
LINK_PARAMETERS = ("ln_product", "ln_mass", "com_x", "com_y")
"""Parameters that every model has for each link: ln of mass times support friction (kg), ln of the
mass (kg), centre of mass (m) in the link's frame. More of a model's own may follow them."""


@dataclass(frozen=True, eq=False)
class PusherMotion:
    """How the pusher moves during one step, in S; the same for all hypotheses.

    Attributes:
        before: (3,) x, y (m) and yaw (rad) when the step begins: of the point that touches the
            object (tip), or of the middle between the pads (grip).
        after: (3,) when it ends.
        step: s.
        height: m above the support.
        grip: whether it encloses the object, that then moves with it; else a tip pushes.
        touching: whether it touches, where that was measured; None where the outline decides.
        normal: (2,) unit vector into the object at the tip, where known; None where the outline
            decides.
        lift: N upwards on the object, where known.
        link: index of the touched link.
    """

    before: Array
    after: Array
    step: float
    height: float = 0.02
    grip: bool = False
    touching: bool | None = None
    normal: Array | None = None
    lift: float = 0.0
    link: int = 0


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a model expects of C hypotheses.

    Attributes:
        states: (C, 6 L) when the step ends.
        wrench: (C, 3) N, N, N m that the pusher applies on the object, axes of S, about the point
            where the pusher is when the step begins; mean over the step.
        force_std: N, by which the model itself says that its forces are off, beside what differs
            from place to place; errors that last count once, not at each step.
        state_std: (6 L,) by which it says that states are off, or 0.
        lasting: by how many times longer its errors last than those of the mechanics do: so much
            less do many steps tell of the parameters.
    """

    states: Array
    wrench: Array
    force_std: float = 0.0
    state_std: Array | float = 0.0
    lasting: float = 1.0


class Process(Protocol):
    """A model of what a pusher does to an object of L links."""

    @property
    def links(self) -> int:
        """L."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the p parameters: `LINK_PARAMETERS` of link_1 (then of link_2), then its own."""

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (p,) and covariance (p, p) of the parameters before any data."""

    def feasible(self, parameters: Array) -> Mask:
        """Which (C,) of the parameters (C, p) are physically possible."""

    def acting(self, states: Array, parameters: Array) -> tuple[Array, tuple[int, ...]]:
        """By which numbers (C, k) the parameters (C, p) act on objects in states (C, 6 L).

        They are the parameters themselves unless some act only together.

        Returns:
            The numbers, and which of them only inertia tells.
        """

    def predict(self, states: Array, parameters: Array, motion: PusherMotion) -> Prediction:
        """Advance states (C, 6 L) of objects with parameters (C, p) by one step of the pusher."""
