"""Two parts that are one rigid body with two footprints: three coordinates, three equations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.linked.rows import LinearFriction, PairPatch, PartMotion
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.support import tipping_shift
from tactile_dynamics_ros.core.planar.properties.linked_model import (
    DELAY_STD,
    FRICTION_SPREAD,
    HEIGHT_STD,
    INERTIA_SPREAD,
    MODEL_ERROR,
    POINT_STD,
    PRODUCT_SPREAD,
    SCALE_SPREAD,
    Lack,
    Motion,
    PairModel,
)

Array = NDArray[np.float64]

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
    endings: ClassVar[tuple[str, ...]] = ("",)

    @cached_property
    def size(self) -> float:
        """Radius of gyration of both footprints together, m."""
        return float(np.sqrt(self.patch.gyration))

    @property
    def body_sizes(self) -> tuple[float, ...]:
        """Of the one body."""
        return (self.size,)

    @cached_property
    def prior(self) -> tuple[Array, Array]:
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

    def part_poses(self, coordinates: Array, common: Array) -> tuple[Array, Array]:
        """Poses (M, 3) of both parts' frames."""
        yaw = coordinates[:, 2]
        arm = turned(np.broadcast_to(self.offset[:2], (len(yaw), 2)), yaw)
        second = np.column_stack([coordinates[:, :2] + arm, yaw + self.offset[2]])
        return coordinates, second

    def lack(self, common: Array, motion: Motion, slip: float) -> Lack:
        """Equations with friction to first order around a motion."""
        part = PartMotion(motion.pose, motion.velocity, motion.acceleration)
        state = self._state(part, common, self._loaded(part, motion, common)[1])
        friction = LinearFriction.of_state(self.patch, state, slip)

        def equations(moved: Motion, numbers: Array) -> Array:
            return self._equations(moved, numbers, friction)

        return equations

    def _state(self, part: PartMotion, common: Array, centre: Array) -> Array:
        twist = part.twist_of(self.patch.centroid)
        even = np.ones(len(twist))
        return np.column_stack([twist, centre, even * np.exp(common[6]), even * common[7]])

    def _loaded(
        self, part: PartMotion, motion: Motion, common: Array
    ) -> tuple[Array, Array, Array]:
        """Friction coefficient times load (R,) N, centre of pressure (R, 2) m, pull (R, 2) N."""
        cut, at = self.data.intervals, self.middle
        mass, yaw = float(np.exp(common[1])), motion.pose[:, 2]
        pull = part.acceleration_of(self.patch.centroid + common[2:4]) - self.data.gravity[:2]
        pull, force = mass * pull, cut.force[at, :2]
        weight = -mass * self.data.gravity[2]
        normal = np.maximum(weight - cut.force[at, 2], 0.1 * weight)
        height = np.full(len(yaw), common[5])
        shift = tipping_shift(normal, height, pull - force, force, cut.point[at, 2] + common[8])
        local = motion.local[:, 1:] * np.sqrt(self.patch.gyration)
        load = np.exp(common[0] - common[1]) * normal * (1.0 + motion.local[:, 0])
        return load, common[2:4] + turned(shift, -yaw) + local, pull

    def _equations(self, motion: Motion, common: Array, friction: LinearFriction) -> Array:
        cut, at, patch = self.data.intervals, self.middle, self.patch
        part = PartMotion(motion.pose, motion.velocity, motion.acceleration)
        load, centre, pull = self._loaded(part, motion, common)
        com = motion.pose[:, :2] + part.place(patch.centroid + common[2:4])
        arm = com - cut.point[at, :2] - common[9:11]
        arm = np.where(cut.touching[at, None], arm, 0.0)
        wrench = friction.at(self._state(part, common, centre)) * load[:, None]
        support = turned(wrench[:, :2], motion.pose[:, 2])
        to_centroid = arm - part.place(common[2:4])
        inertia = np.exp(common[1] + common[4]) * patch.gyration
        turning = inertia * motion.acceleration[:, 2] + cross(arm, pull)
        torque = wrench[:, 2] + cross(to_centroid, support) + cut.torque[at]
        return np.column_stack([pull - support - cut.force[at, :2], turning - torque])

    def noise(self, floor: float) -> Array:
        """(R, 3) standard deviations of two forces and the torque."""
        cut, at = self.data.intervals, self.middle
        least = floor * MODEL_ERROR * self.typical_force
        force = np.where(cut.touching[at][:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * self.size)
        return np.column_stack([np.hypot(force, least), torque])
