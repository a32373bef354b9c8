"""Two parts that are one rigid body with two footprints: three coordinates, three equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.effects.situation import Situation
from tactile_dynamics_ros.core.planar.linked.rows import (
    LinearFriction,
    Loaded,
    PairFriction,
    PairPatch,
    PartMotion,
    Pressed,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch, tipping_shift
from tactile_dynamics_ros.core.planar.properties.latent_model import (
    DELAY_STD,
    FRICTION_SPREAD,
    HEIGHT_STD,
    INERTIA_SPREAD,
    MODEL_ERROR,
    POINT_STD,
    PRODUCT_SPREAD,
    SCALE_SPREAD,
    Motion,
)
from tactile_dynamics_ros.core.planar.properties.linked_model import Given, PairModel

NAMES = (
    "ln_product", "ln_mass", "com_x", "com_y", "ln_inertia", "com_height", "ln_scale", "ln_ratio",
    "push_height", "point_x", "point_y", "delay",
)  # fmt: skip
"""Common numbers of a rigid pair: those of the whole body, in the first part's frame from the
centroid of both footprints, the second part's friction coefficient over the first one's, and errors
of the push (m, m, m, s)."""


@dataclass(frozen=True, eq=False)
class RigidModel(PairModel):
    """Residuals of a rigid pair; the coordinates are x, y, yaw of the first part.

    Attributes:
        patch: both footprints in the first part's frame.
        offset: (3,) pose of the second part in it.
    """

    patch: PairPatch
    offset: Array
    names: ClassVar[tuple[str, ...]] = NAMES
    freedoms: ClassVar[int] = 3
    locals: ClassVar[int] = 3
    scalings: ClassVar[tuple[str, ...]] = ("ln_product", "ln_mass")
    unknown: ClassVar[tuple[str, ...]] = ("ln_product", "ln_mass", "com_x", "com_y")
    endings: ClassVar[tuple[str, ...]] = ("",)

    @cached_property
    def size(self) -> float:
        """Radius of gyration of both footprints together, m."""
        return float(np.sqrt(self.patch.gyration))

    @property
    def bodies(self) -> tuple[SupportPatch, ...]:
        """Both footprints are those of one body."""
        return (self.patch,)

    @cached_property
    def own_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers."""
        start = np.log(self.typical_force / -self.data.gravity[2])
        height = float(np.mean(self.data.com_height))
        reach = 0.5 * self.size
        tall = float(np.hypot(np.max(self.data.com_height_std), np.ptp(self.data.com_height)))
        mean = np.zeros(len(NAMES))
        mean[[0, 1, 5]] = start, start - np.log(0.3), height
        std = [PRODUCT_SPREAD, PRODUCT_SPREAD, reach, reach, INERTIA_SPREAD, tall, SCALE_SPREAD]
        std += [np.sqrt(2.0) * FRICTION_SPREAD, HEIGHT_STD, POINT_STD, POINT_STD, DELAY_STD]
        return mean, np.array(std)

    def part_poses(self, coordinates: Array, numbers: Array) -> tuple[Array, Array]:
        """Poses (M, 3) of both parts' frames."""
        yaw = coordinates[:, 2]
        arm = turned(np.broadcast_to(self.offset[:2], (len(yaw), 2)), yaw)
        second = np.column_stack([coordinates[:, :2] + arm, yaw + self.offset[2]])
        return coordinates, second

    def presumed(self, numbers: Array) -> Situation:
        """What was measured, on a body of this mass and centre of mass."""
        even = np.ones(len(self.middle))
        mass, com = even * np.exp(numbers[1]), even[:, None] * numbers[2:4]
        return replace(super().presumed(numbers), mass=mass, com=com)

    def linear_friction(self, common: Array, motion: Motion, slip: float) -> PairFriction:
        """Friction of both footprints to first order around a motion."""
        given, part = self.given(common), _part(motion)
        state = self._state(part, given.numbers, self._loaded(part, motion, given).centre)
        return PairFriction((LinearFriction.of_state(self.patch, state, slip),), slip)

    def _state(self, part: PartMotion, numbers: Array, centre: Array) -> Array:
        twist = part.twist_of(self.patch.centroid)
        even = np.ones(len(twist))
        return np.column_stack([twist, centre, even * np.exp(numbers[6]), even * numbers[7]])

    def _loaded(self, part: PartMotion, motion: Motion, given: Given) -> Loaded:
        patch, situation, numbers = self.patch, given.situation, given.numbers
        mass, yaw = situation.mass, motion.pose[:, 2]
        com = turned(patch.centroid + situation.com, yaw)
        acceleration = part.acceleration_at(com) - situation.gravity[:2]
        pull, force = mass[:, None] * acceleration, situation.force[:, :2]
        weight = -mass * situation.gravity[2]
        normal = np.maximum(weight - situation.force[:, 2], 0.1 * weight)
        height, above = np.full(len(yaw), numbers[5]), situation.point[:, 2] + numbers[8]
        shift = tipping_shift(normal, height, pull - force, force, above)
        local = motion.local[:, 1:] * np.sqrt(patch.gyration)
        load = np.exp(numbers[0] - numbers[1]) * normal * (1.0 + motion.local[:, 0])
        return Loaded(pull, load, situation.com + turned(shift, -yaw) + local)

    def lack(self, motion: Motion, common: Array, friction: PairFriction) -> Array:
        """Two forces and the torque about the contact (R, 3) that are lacking, N and N m."""
        given, part = self.given(common), _part(motion)
        loaded = self._loaded(part, motion, given)
        planar = self.planar_motion(part, self.patch)
        rise = given.acting.rise(planar)
        centre = loaded.centre + rise @ self.patch.second_moments
        load = loaded.load * (1.0 + np.sum(rise * loaded.centre, axis=1))
        wrench = friction.bodies[0].at(self._state(part, given.numbers, centre)) * load[:, None]
        force = turned(wrench[:, :2], motion.pose[:, 2])
        support = given.acting.resisted(planar, force, wrench[:, 2])
        inertia = given.situation.mass * np.exp(given.numbers[4]) * self.patch.gyration
        turning = inertia * motion.acceleration[:, 2]
        turning = turning + cross(self._arm(motion, given), loaded.pull)
        moved = np.column_stack([loaded.pull - given.situation.force[:, :2], turning])
        moved[:, 2] -= self.data.intervals.torque[self.middle]
        return moved + self.support_rows(motion, common, [support])

    def _arm(self, motion: Motion, given: Given) -> Array:
        """(R, 2) m from the contact to the centre of mass; none where nothing touches."""
        situation = given.situation
        com = motion.pose[:, :2] + turned(self.patch.centroid + situation.com, motion.pose[:, 2])
        arm = com - situation.point[:, :2] - given.numbers[9:11]
        return np.where(situation.touching[:, None], arm, 0.0)

    def support_rows(
        self, motion: Motion, common: Array, supports: Sequence[tuple[Array, Array]]
    ) -> Array:
        """What a force (R, 2) and torque (R,) of the support on the body do to `lack`."""
        given, ((force, torque),) = self.given(common), supports
        centroid = self._arm(motion, given) - turned(given.situation.com, motion.pose[:, 2])
        return -np.column_stack([force, torque + cross(centroid, force)])

    def pressed(self, motion: Motion, common: Array, friction: PairFriction) -> tuple[Pressed, ...]:
        """How the body rests and slides."""
        given, part = self.given(common), _part(motion)
        loaded = self._loaded(part, motion, given)
        state = self._state(part, given.numbers, loaded.centre)
        return (Pressed(self.patch, part, state, loaded.load),)

    def noise(self, floor: float) -> Array:
        """(R, 3) standard deviations of two forces and the torque."""
        cut, at = self.data.intervals, self.middle
        least = floor * MODEL_ERROR * self.typical_force
        force = np.where(cut.touching[at][:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * self.size)
        return np.column_stack([np.hypot(force, least), torque])


def _part(motion: Motion) -> PartMotion:
    return PartMotion(motion.pose, motion.velocity, motion.acceleration)
