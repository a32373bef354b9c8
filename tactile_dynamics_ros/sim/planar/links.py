"""Parts of an object as trackers and estimators see them: each a link with a frame of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.sim.planar.bed import GRAVITY, feet_of
from tactile_dynamics_ros.sim.planar.body import PlanarBody
from tactile_dynamics_ros.sim.planar_objects import PlanarPart

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outline:
    """One part with its own frame: in the middle of its outline, axes of the object.

    Attributes:
        body, k: which rigid part it moves with.
        part: as it was drawn.
        middle: (2,) m, of its outline, object's frame.
    """

    body: PlanarBody
    k: int
    part: PlanarPart
    middle: Array

    @property
    def corners(self) -> Array:
        """Outline (V, 2) in the link's frame, m."""
        return np.asarray(self.part.corners - self.middle)

    def pose(self) -> Array:
        """Return the true pose (4, 4) of the link's frame in the world."""
        pose = self.body.pose(self.k)
        pose[:3, 3] += pose[:3, :2] @ self.middle
        return pose

    def truth(self) -> dict[str, Any]:
        """Return what an estimator should find, in the link's frame.

        The inertia is about the centre of mass, and the friction radius that of a flat face, whose
        pressure is linear and has its centre below the centre of mass.
        """
        part = self.part
        solid = part.solid()
        places, even = feet_of(part.corners)
        from_middle = places - even @ places
        moments = (from_middle * even[:, None]).T @ from_middle
        slope = np.linalg.solve(moments, part.com - even @ places)
        shares = even * np.maximum(1.0 + from_middle @ slope, 0.0)
        shares /= shares.sum()
        return {
            "mass": part.mass,
            "friction": part.friction,
            "friction_force_n": part.mass * part.friction * GRAVITY,
            "friction_radius_m": float(shares @ np.linalg.norm(places - part.com, axis=1)),
            "com": (part.com - self.middle).tolist(),
            "com_height": 0.5 * part.height,
            "inertia_zz": float(part.mass / solid.volume * solid.moment_inertia[2, 2]),
        }


def joint_truth(body: PlanarBody) -> dict[str, Any] | None:
    """Return place, in the first link's frame, and friction of a joint; None without one."""
    if body.thing.joint is None:
        return None
    place = body.thing.joint - outlines(body)[0].middle
    return {"position": place.tolist(), "friction_torque_nm": body.thing.joint_friction}


def outlines(body: PlanarBody) -> list[Outline]:
    """Return the links of an object."""
    jointed = len(body.links) > 1
    found = []
    for n, part in enumerate(body.thing.parts):
        middle = 0.5 * (part.corners.min(axis=0) + part.corners.max(axis=0))
        found.append(Outline(body, n if jointed else 0, part, middle))
    return found
