"""Friction between fingertips and object: coefficients per region, static, kinetic and odd ones.

Bullet multiplies one coefficient per link with one per body. Before every step this module sets
that of a fingertip so that the product is what the surface under it has at that instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pybullet

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.sim.world import HandWorld

BREAKAWAY_SPEED = 1.5e-3
"""Speed at which static has become kinetic friction, m/s."""


@dataclass(frozen=True)
class SurfaceFriction:
    """What one region of an object does to a fingertip.

    Attributes:
        static: coefficient at rest. kinetic: while sliding.
        adhesion: normal force by which the skin sticks beyond what presses, N.
        load_exponent: the coefficient falls with the normal force (in N) to this power.
        weakening: share of the kinetic coefficient that is lost at 20 mm/s.
        anisotropy: relative half difference between the two principal directions.
        grain: (3,) direction of the higher coefficient, object frame.
    """

    static: float
    kinetic: float
    adhesion: float = 0.0
    load_exponent: float = 0.0
    weakening: float = 0.0
    anisotropy: float = 0.0
    grain: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def coefficient(self, press: float, speed: float, pull: Array) -> float:
        """Ratio of the greatest tangential to the normal force.

        Args:
            press: normal force, N.
            speed: m/s.
            pull: (3,) direction of the tangential force, object frame.
        """
        press = max(press, 0.02)
        at_rest = float(np.exp(-((speed / BREAKAWAY_SPEED) ** 2)))
        value = self.kinetic + (self.static - self.kinetic) * at_rest
        value *= 1.0 - self.weakening * speed / (speed + 0.02) * 2.0
        value *= press**self.load_exponent
        cosine = float(pull @ self.grain)
        value *= 1.0 + self.anisotropy * (2.0 * cosine**2 - 1.0)
        return float(max(value * (1.0 + self.adhesion / press), 0.01))


@dataclass(frozen=True)
class SlipTruth:
    """What a fingertip really does on the object.

    Attributes:
        press: normal force, N. pull: tangential force, N. speed: sliding speed, m/s.
        coefficient: that was in force. region: name.
    """

    press: float
    pull: float
    speed: float
    coefficient: float
    region: str


class SkinFriction:
    """Sets the friction of the fingertips before every step of a world.

    Args:
        world: whose contacts are ruled.
        regions: boxes (lower, upper) in the object frame by name, m.
        surfaces: friction by region; ``body`` is everything else.
        probing: finger whose static and kinetic friction differ; the others only have static.
    """

    def __init__(
        self,
        world: HandWorld,
        regions: Mapping[str, tuple[Array, Array]],
        surfaces: Mapping[str, SurfaceFriction],
        probing: str = "index",
    ) -> None:
        self._regions, self._surfaces = dict(regions), dict(surfaces)
        self._probing = probing
        links = {
            name: index
            for index in range(pybullet.getNumJoints(world.robot, world.client))
            for name in [pybullet.getJointInfo(world.robot, index, world.client)[12].decode()]
        }
        self._links = {finger.name: links[finger.touches] for finger in world.machine.hand}
        self._set = dict.fromkeys(world.fingers, 1.0)
        self.truth = SlipTruth(0.0, 0.0, 0.0, surfaces["body"].static, "body")
        for finger in world.fingers:
            self._assign(world, finger, surfaces["body"].static)
        world.add_pre_step(self.apply)

    def region(self, point: Array) -> str:
        """Name of the region at a point (3,) of the object frame."""
        for name, (lower, upper) in self._regions.items():
            if np.all(point >= lower) and np.all(point <= upper):
                return name
        return "body"

    def apply(self, world: HandWorld) -> None:
        """Look at the contact of the last step and set the coefficient of the next."""
        link = self._links[self._probing]
        points = pybullet.getContactPoints(
            world.object_id, world.robot, linkIndexB=link, physicsClientId=world.client
        )
        pressing = [point for point in points if point[9] > 0.0]
        if not pressing:
            self.truth = SlipTruth(0.0, 0.0, 0.0, self.truth.coefficient, self.truth.region)
            return
        self._rule(world, pressing)

    def _rule(self, world: HandWorld, contacts: list[tuple[Any, ...]]) -> None:
        pose = world.object_pose()
        contact = max(contacts, key=lambda point: point[9])
        where = np.array(contact[5])
        region = self.region((where - pose[:3, 3]) @ pose[:3, :3])
        pull = np.zeros(3)
        for point in contacts:
            pull += point[10] * np.array(point[11]) + point[12] * np.array(point[13])
        size = float(np.sqrt(pull @ pull))
        direction = (pull / max(size, 1e-9)) @ pose[:3, :3]
        speed = self._speed(world, where, int(contact[3]), np.array(contact[7]))
        press = float(sum(point[9] for point in contacts))
        value = self._surfaces[region].coefficient(press, speed, direction)
        self.truth = SlipTruth(press, size, speed, value, region)
        self._assign(world, self._probing, value)

    def _speed(self, world: HandWorld, point: Array, panel: int, normal: Array) -> float:
        """Tangential speed of the fingertip over the touched part of the object, m/s."""
        client = world.client
        tip = _velocity(client, world.robot, self._links[self._probing], point)
        if panel >= 0:
            other = _velocity(client, world.object_id, panel, point)
        else:
            angular, linear = world.object_velocity()
            other = linear + _cross(angular, point - world.object_pose()[:3, 3])
        difference = tip - other
        along = difference - (difference @ normal) * normal
        return float(np.sqrt(along @ along))

    def _assign(self, world: HandWorld, finger: str, value: float) -> None:
        if abs(value - self._set[finger]) > 1e-4 * value:
            self._set[finger] = value
            pybullet.changeDynamics(
                world.robot,
                self._links[finger],
                lateralFriction=value / world.model.friction,
                physicsClientId=world.client,
            )


def _velocity(client: int, body: int, link: int, point: Array) -> Array:
    """Velocity (3,) of the point of a link that is at a place in the world."""
    state = pybullet.getLinkState(body, link, 1, 1, physicsClientId=client)
    return np.array(state[6]) + _cross(state[7], point - np.array(state[0]))


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,), without the overhead of numpy's general one."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
