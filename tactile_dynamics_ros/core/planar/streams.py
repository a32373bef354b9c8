"""Time-stamped measurements of links that are pushed or pulled on a support.

Support frame S: origin and axes of `/support/pose` (default: the world), z the normal of the
support, upwards. Planar poses are (x, y, yaw) of a link's frame in S; yaw is unwrapped.
Contact forces are those that the pusher applies **on the object**.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array

_USUAL_FORCE_STD, _USUAL_POINT_STD = 0.03, 3e-4
"""Noise of force, N, and contact point, m, presumed where none is stated: of a good 3-axis pad and
of a calibrated arm. Wrong ones are seen in the error and widen the intervals."""
USUAL_POSE_STD = np.array([5e-4, 5e-4, 3e-3])
"""Noise of poses, m, m, rad, presumed where none is stated: of a tracker of markers. Larger hides
what a model lacks, smaller invents it; a wrong one is seen in the error and widens intervals."""


def _gravity() -> Array:
    return np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class LinkStream:
    """Planar pose of one link and its outline on the support.

    Attributes:
        time: (N,) s, strictly increasing; may have gaps, or only samples before and after a push.
        pose: (N, 3) x, y in m, yaw in rad, frame S.
        pose_std: (3,) m, m, rad of white noise, or None if not stated.
        footprint: (V, 2) m, vertices of the outline in the link's frame, counter-clockwise.
    """

    time: Array
    pose: Array
    pose_std: Array | None
    footprint: Array

    @property
    def presumed_pose_std(self) -> Array:
        """(3,) m, m, rad of the poses: as stated, or as usual."""
        return np.asarray(USUAL_POSE_STD if self.pose_std is None else self.pose_std)

    def between(self, start: float, stop: float) -> LinkStream:
        """What was measured from start to stop, s."""
        kept = (self.time >= start) & (self.time <= stop)
        return replace(self, time=self.time[kept], pose=self.pose[kept])


@dataclass(frozen=True)
class PushContact:
    """Force of a tip or a pad, and where it acts.

    Attributes:
        name: such as "pusher", "pad_left".
        time: (M,) s of the force, strictly increasing; silent or zero where untouched.
        force: (M, 3) N on the object, axes of S.
        force_std: (3,) N of white noise along axes of S, or None if not stated.
        pose_time: (K,) s, strictly increasing, of point and normal.
        point: (K, 3) m, in S; its z is the height of the push above the support.
        normal: (K, 3) unit vectors into the object, axes of S.
        point_std: m of white noise per axis, or None if not stated.
        torque: (M, 3) N m about the point, axes of S, or None for a contact that carries none.
        link: index of the link that it touches, or None if not known (the nearest outline).
    """

    name: str
    time: Array
    force: Array
    force_std: Array | None
    pose_time: Array
    point: Array
    normal: Array
    point_std: float | None = None
    torque: Array | None = None
    link: int | None = None

    @property
    def presumed_force_std(self) -> Array:
        """(3,) N of the force: as stated, or as usual."""
        stated = self.force_std
        return np.full(3, _USUAL_FORCE_STD) if stated is None else np.asarray(stated)

    @property
    def presumed_point_std(self) -> float:
        """Noise per axis of where it acts, m: as stated, or as usual."""
        return _USUAL_POINT_STD if self.point_std is None else self.point_std

    def between(self, start: float, stop: float) -> PushContact:
        """What was measured from start to stop, s."""
        kept = (self.time >= start) & (self.time <= stop)
        placed = (self.pose_time >= start) & (self.pose_time <= stop)
        return replace(
            self,
            time=self.time[kept],
            force=self.force[kept],
            torque=None if self.torque is None else self.torque[kept],
            pose_time=self.pose_time[placed],
            point=self.point[placed],
            normal=self.normal[placed],
        )


@dataclass(frozen=True)
class PushedStreams:
    """All that was measured of one object on a support.

    Attributes:
        links: link_1, then link_2 where there are two.
        contacts: by name.
        gravity: (3,) m/s^2, axes of S; horizontal components where the support leans.
        com_height: m, height of the centre of mass of each link above the support, or None.
        com_height_std: m, of each.
        pusher_time: (K,) s. pusher_yaw: (K,) rad, of the pusher's axes, in which its sensors may
            err; None if not recorded.
        force_doubt: relative std of all forces together, as of a robot's stiffness. mass_doubt: kg,
            std of a mass that moves with the object and is in the forces, as of a robot's tip.
        session_starts: s, when each of several recordings begins that are joined; empty for one.
    """

    links: tuple[LinkStream, ...]
    contacts: dict[str, PushContact]
    gravity: Array = field(default_factory=_gravity)
    com_height: tuple[float, ...] | None = None
    com_height_std: tuple[float, ...] | None = None
    pusher_time: Array | None = None
    pusher_yaw: Array | None = None
    session_starts: tuple[float, ...] = ()
    force_doubt: float = 0.0
    mass_doubt: float = 0.0

    @property
    def feels(self) -> bool:
        """Whether any force was measured; else only paths of what pushes are known."""
        return any(len(contact.time) for contact in self.contacts.values())

    def between(self, start: float, stop: float) -> PushedStreams:
        """What was measured of links and contacts from start to stop, s."""
        links = tuple(link.between(start, stop) for link in self.links)
        contacts = {name: contact.between(start, stop) for name, contact in self.contacts.items()}
        return replace(self, links=links, contacts=contacts)
