"""What was going on while an object was pushed, beside the innovations of its poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Residuals
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion

Array = NDArray[np.float64]

_CHANNELS = ("position_x", "position_y", "yaw")
"""What is seen of each part, in the order of the filter's rows."""


def push_conditions(motion: PlanarMotion, force: Array, at: NDArray[np.intp]) -> list[Condition]:
    """Speed, force, place and time at some intervals.

    Args:
        motion: of all intervals that count.
        force: (R,) N, horizontal.
        at: (J,) which of them.
    """
    speed = np.maximum(np.linalg.norm(motion.velocity, axis=1), 1e-9)
    heading = motion.velocity / speed[:, None]
    return [
        Condition("speed", "m/s", motion.speed[at], symbol="v"),
        Condition("force", "N", force[at]),
        Condition("place x", "m", motion.place[at, 0], symbol="x"),
        Condition("place y", "m", motion.place[at, 1], symbol="y"),
        Condition("heading cosine", "", heading[at, 0], cosine_of="the heading from x"),
        Condition("heading sine", "", heading[at, 1], cosine_of="the heading from y"),
        Condition("time", "s", motion.time[at] - motion.time[0], symbol="t"),
    ]


def push_residuals(
    time: Array, white: Array, pose_std: Array, conditions: Sequence[Condition]
) -> Residuals:
    """Residuals for people.

    Args:
        time: (J,) s.
        white: (J, 3 B) innovations of x, y and yaw of B parts.
        pose_std: (J, 3 B) m, m, rad.
        conditions: as of `push_conditions`.
    """
    parts = [""] if white.shape[1] == 3 else ["link_1_", "link_2_"]
    return Residuals(
        time=time,
        white=white,
        physical=white * pose_std,
        channels=tuple(before + channel for before in parts for channel in _CHANNELS),
        units=("m", "m", "rad") * len(parts),
        conditions=tuple(conditions),
        drivers=np.column_stack([c.values for c in (conditions[0], *conditions[4:6])]),
        alone="mass, friction and centre alone",
        about="The model predicts every pose of the object from those before it and from the "
        "forces of the pusher; the residual is what it is off by, over the noise.",
    )
