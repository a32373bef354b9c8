"""A table with planar objects in Bullet; their parts as trackers see them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.sim.bodies import TABLE_CENTRE, TABLE_HALF_SIZE, Engine
from tactile_dynamics_ros.sim.objects import PlanarObject, PlanarPart
from tactile_dynamics_ros.sim.planar.bed import GRAVITY, Surface, feet_of
from tactile_dynamics_ros.sim.planar.body import PlanarBody


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


STILL = 1e-5
"""Speed, m/s and rad/s, below which objects that nothing pushes are not simulated: in an hour they
would move by what a bristle stretches at most."""
SETTLING = 0.2
"""s within which objects that rest have settled after they were placed: twenty periods of a bed."""
APART = 0.03
"""Least gap between objects that are placed at random, m: cameras see that they are two."""
TRIES = 1000
"""Places that are tried for an object; a table of 0.8 m by 1.2 m has room for a dozen."""


class TableWorld(Engine):
    """Objects that rest on a table, with whatever pushes them; a context manager.

    `step` advances; `add_pre_step` registers what acts before each step, such as a robot that
    pushes. While all that is registered is idle and all is still, time passes without work.

    Args:
        things: what stands there.
        places: (K, 3) x, y (m) of their middle and turn (rad) of each.
        height: of the table, m.
        surface: how the table rubs.
        time_step: s.

    Attributes:
        client: Bullet client. bodies: the objects. time: simulated seconds. height: of the table.
        surface: as given.
    """

    def __init__(
        self,
        things: Sequence[PlanarObject],
        places: Array,
        height: float,
        surface: Surface,
        time_step: float,
    ) -> None:
        self.time, self.time_step, self.height, self.surface = 0.0, time_step, height, surface
        super().__init__()
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=self.client)
        pybullet.setTimeStep(time_step, physicsClientId=self.client)
        self._draw_table()
        self.bodies: list[PlanarBody] = []
        for thing, place in zip(things, places, strict=True):
            self.add(thing, standing(thing, place, height))
        self._pre_step: list[Callable[[TableWorld], None]] = []
        self._idle: list[Callable[[], bool]] = []
        self._settled = SETTLING

    def add(self, thing: PlanarObject, pose: Array) -> None:
        """Put one more object there, with its frame at a pose (4, 4)."""
        self.bodies.append(PlanarBody(self.client, thing, pose, self.surface))

    def add_pre_step(
        self,
        callback: Callable[[TableWorld], None],
        is_idle: Callable[[], bool] = lambda: False,
    ) -> None:
        """Call back before each simulation step, in the order of registration.

        Args:
            callback: gets this world.
            is_idle: whether it does nothing while the objects stand still.
        """
        self._pre_step.append(callback)
        self._idle.append(is_idle)

    def step(self, count: int = 1) -> None:
        """Advance by `count` simulation steps."""
        for _ in range(count):
            self.time += self.time_step
            if all(is_idle() for is_idle in self._idle) and self._is_still():
                continue
            for callback in self._pre_step:
                callback(self)
            for body in self.bodies:
                body.rest_on_table(self.time_step)
            pybullet.stepSimulation(self.client)
            for body in self.bodies:
                body.forget()

    def wake(self) -> None:
        """Simulate objects that stand still too, for a moment: something about them has changed."""
        self._settled = self.time + SETTLING

    def _is_still(self) -> bool:
        """Whether no object moves; what was just placed or changed still settles."""
        speeds = [
            np.abs(part).max()
            for body in self.bodies
            for k in range(len(body.links))
            for part in body.velocity(k)
        ]
        return self.time > self._settled and max(speeds, default=0.0) < STILL

    def _draw_table(self) -> None:
        """Draw the table; objects rest on beds of their own and never collide with it."""
        visual = pybullet.createVisualShape(
            pybullet.GEOM_BOX,
            halfExtents=TABLE_HALF_SIZE,
            rgbaColor=(0.6, 0.6, 0.6, 1.0),
            physicsClientId=self.client,
        )
        centre = (*TABLE_CENTRE, self.height - TABLE_HALF_SIZE[2])
        pybullet.createMultiBody(0.0, -1, visual, centre, physicsClientId=self.client)


def standing(thing: PlanarObject, place: Array, height: float) -> Array:
    """Return the pose (4, 4) of an object's frame when its middle is at x, y and it is turned."""
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.0, 0.0, place[2]]))
    pose[:3, 3] = [*place[:2], height]
    pose[:2, 3] -= pose[:2, :2] @ middle_of(thing)
    return pose


def middle_of(thing: PlanarObject) -> Array:
    """Return the middle (2,) of the box around an object's outline, m, in its frame."""
    corners = np.concatenate([part.corners for part in thing.parts])
    return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)))


def scattered(things: Sequence[PlanarObject], first: Array, rng: np.random.Generator) -> Array:
    """Return places (K, 3): the first as given, others on the table without touching.

    Args:
        things: objects.
        first: (3,) x, y (m) and turn (rad) of the first.
        rng: of the draw.
    """
    reach = [0.5 * float(np.linalg.norm(_size(thing))) for thing in things]
    places = [first]
    half = np.array(TABLE_HALF_SIZE[:2]) - 0.1
    for k in range(1, len(things)):
        for _ in range(TRIES):
            place = TABLE_CENTRE + half * rng.uniform(-1.0, 1.0, 2)
            gaps = [
                np.linalg.norm(place - other[:2]) - reach[k] - reach[n] - APART
                for n, other in enumerate(places)
            ]
            if min(gaps) > 0.0:
                break
        places.append(np.array([*place, rng.uniform(-np.pi, np.pi)]))
    return np.stack(places)


def _size(thing: PlanarObject) -> Array:
    corners = np.concatenate([part.corners for part in thing.parts])
    return np.asarray(np.ptp(corners, axis=0))
