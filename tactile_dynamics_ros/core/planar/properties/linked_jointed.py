"""Two parts on a revolute joint with friction: four coordinates, four equations per interval."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.linked.chances import JOINT_SPREAD, JOINT_TORQUE
from tactile_dynamics_ros.core.planar.linked.rows import LinearFriction, PartMotion, across
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.support import tipping_shift
from tactile_dynamics_ros.core.planar.properties.linked_model import (
    DELAY_STD,
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
from tactile_dynamics_ros.core.planar.properties.linked_structure import Hinge

Array = NDArray[np.float64]

_OF_PART = (
    "ln_product", "ln_mass", "com_x", "com_y", "ln_inertia", "com_height", "ln_scale",
)  # fmt: skip
"""Numbers of each part, as of one part alone: kg, kg, m from the footprint's centroid, 1, m, 1."""
NAMES = (
    *(f"{name}_{k}" for k in (1, 2) for name in _OF_PART),
    "push_height", "point_x", "point_y", "delay",
    "joint_at_x_1", "joint_at_y_1", "joint_at_x_2", "joint_at_y_2", "ln_joint_torque",
)  # fmt: skip
"""Common numbers of a jointed pair: those of both parts, errors of the push (m, m, m, s), place of
the joint in each part's frame (m), ln of its friction torque (N m)."""
_JOINT_STD = 0.05
"""Std of the joint's place around that of the motion, m: hardly any; the poses tell it anew."""
_ARM = 0.05
"""Distance at which a turn of the joint is compared with the slip of a footprint, m."""
_HELD = 0.3
"""Change of the relative turning rate, rad/s^2, allowed where the joint does not turn. Ten times as
much lets it creep by a tenth of a degree."""


@dataclass(frozen=True, eq=False)
class _Acting:
    """What acts on one part: support (force (R, 2), torque (R,) about its centroid), and its pull.

    The pull (R, 2) is mass times acceleration less gravity, at the centre of mass `com` (R, 2); the
    spin (R,) is inertia times angular acceleration; all in axes of the support.
    """

    support: Array
    torque: Array
    pull: Array
    com: Array
    centroid: Array
    spin: Array

    def moment(self, point: Array) -> Array:
        """(R,) that is lacking about a point (R, 2)."""
        moving = self.spin + cross(self.com - point, self.pull)
        return np.asarray(moving - self.torque - cross(self.centroid - point, self.support))


@dataclass(frozen=True, eq=False)
class _Loaded:
    """Pull (R, 2) N, friction coefficient times load (R,) N, and centre of pressure (R, 2) m."""

    pull: Array
    load: Array
    centre: Array


@dataclass(frozen=True, eq=False)
class JointedModel(PairModel):
    """Residuals of a jointed pair; the coordinates are x, y, yaw of the first part, second yaw.

    Attributes:
        hinge: the joint's place as the relative motion tells it.
    """

    hinge: Hinge | None = None
    names: ClassVar[tuple[str, ...]] = NAMES
    freedoms: ClassVar[int] = 4
    locals: ClassVar[int] = 6
    scalings: ClassVar[tuple[str, ...]] = ("ln_product_1", "ln_product_2", "ln_mass_1", "ln_mass_2")

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers."""
        assert self.hinge is not None
        data = self.data
        reach = [0.5 * np.sqrt(patch.gyration) for patch in data.patches]
        start = np.log(0.5 * self.typical_force / -data.gravity[2])
        mean, std = np.zeros(len(NAMES)), np.zeros(len(NAMES))
        for k in (0, 1):
            at = slice(7 * k, 7 * k + 7)
            mean[at] = [start, start - np.log(0.3), 0.0, 0.0, 0.0, data.com_height[k], 0.0]
            std[at] = [PRODUCT_SPREAD, PRODUCT_SPREAD, reach[k], reach[k], INERTIA_SPREAD,
                       data.com_height_std[k], SCALE_SPREAD]  # fmt: skip
        mean[18:] = [*self.hinge.first, *self.hinge.second, np.log(JOINT_TORQUE)]
        std[14:18] = HEIGHT_STD, POINT_STD, POINT_STD, DELAY_STD
        std[18:] = [*([_JOINT_STD] * 4), JOINT_SPREAD]
        return mean, std

    def pose_std(self, part: int) -> Array:
        """With play the second part lies beside where the joint would hold it."""
        assert self.hinge is not None
        std = super().pose_std(part)
        slack = self.hinge.play[0] / np.sqrt(2.0) if part == 1 else 0.0
        return np.hypot(std, [slack, slack, 0.0])

    def part_poses(self, coordinates: Array, common: Array) -> tuple[Array, Array]:
        """Poses (M, 3) of both parts' frames."""
        first, yaw = coordinates[:, :3], coordinates[:, 3]
        size = len(coordinates)
        joint = first[:, :2] + turned(np.broadcast_to(common[18:20], (size, 2)), first[:, 2])
        second = joint - turned(np.broadcast_to(common[20:22], (size, 2)), yaw)
        return first, np.column_stack([second, yaw])

    def _parts(self, motion: Motion, common: Array) -> tuple[PartMotion, PartMotion]:
        poses = self.part_poses(motion.pose, common)
        first = PartMotion(poses[0], motion.velocity[:, :3], motion.acceleration[:, :3])
        rate, change = motion.velocity[:, 3:], motion.acceleration[:, 3:]
        arm = turned(np.broadcast_to(-common[20:22], (len(rate), 2)), motion.pose[:, 3])
        twist = first.twist_of(common[18:20])
        speed = turned(twist[:, :2], poses[0][:, 2]) + rate * across(arm)
        push = first.acceleration_of(common[18:20]) + change * across(arm) - rate**2 * arm
        second = PartMotion(
            poses[1], np.column_stack([speed, rate]), np.column_stack([push, change])
        )
        return first, second

    def lack(self, common: Array, motion: Motion, slip: float) -> Lack:
        """Equations with friction to first order around a motion."""
        frictions = []
        for k, part in enumerate(self._parts(motion, common)):
            state = self._state(k, part, common, self._resting(k, part, common))
            rough = LinearFriction.of_state(self.data.patches[k], state, slip)
            centre = self._loaded(k, part, motion, common, rough).centre
            state = self._state(k, part, common, centre)
            frictions.append(LinearFriction.of_state(self.data.patches[k], state, slip))
        turning = slip / _ARM

        def equations(moved: Motion, numbers: Array) -> Array:
            return self._equations(moved, numbers, (frictions[0], frictions[1]), turning)

        return equations

    def _resting(self, k: int, part: PartMotion, common: Array) -> Array:
        """Centre of pressure (R, 2) below the centre of mass, from the centroid."""
        return np.broadcast_to(common[7 * k + 2 : 7 * k + 4], (len(part.pose), 2))

    def _state(self, k: int, part: PartMotion, common: Array, centre: Array) -> Array:
        twist = part.twist_of(self.data.patches[k].centroid)
        scale = np.full(len(twist), float(np.exp(common[7 * k + 6])))
        return np.column_stack([twist, centre, scale, np.zeros(len(twist))])

    def _equations(
        self,
        motion: Motion,
        common: Array,
        frictions: tuple[LinearFriction, LinearFriction],
        slip: float,
    ) -> Array:
        cut, at = self.data.intervals, self.middle
        parts = self._parts(motion, common)
        force = cut.force[at, :2]
        point = cut.point[at, :2] + common[15:17]
        first = self._acting(0, parts[0], motion, common, frictions[0])
        second = self._acting(1, parts[1], motion, common, frictions[1])
        joint = parts[0].pose[:, :2] + parts[0].place(common[18:20])
        total = first.pull + second.pull - first.support - second.support - force
        point = np.where(cut.touching[at, None], point, first.com)
        whole = first.moment(point) + second.moment(point) - cut.torque[at]
        turning = motion.velocity[:, 3] - motion.velocity[:, 2]
        rubbing = np.exp(common[22]) * turning / np.sqrt(turning**2 + slip**2)
        on_second = self.data.touched[at] == 0.0
        free = np.where(on_second, second.moment(joint) + rubbing, first.moment(joint) - rubbing)
        held = motion.acceleration[:, 3] - motion.acceleration[:, 2]
        return np.column_stack([total, whole, np.where(self.data.turning[at], free, held)])

    def _loaded(
        self, k: int, part: PartMotion, motion: Motion, common: Array, friction: LinearFriction
    ) -> _Loaded:
        """Load and pressure of a part; what the joint passes on tips it as a contact does."""
        cut, at, patch = self.data.intervals, self.middle, self.data.patches[k]
        own = common[7 * k : 7 * k + 7]
        mass, yaw = float(np.exp(own[1])), part.pose[:, 2]
        pull = mass * (part.acceleration_of(patch.centroid + own[2:4]) - self.data.gravity[:2])
        touched = (self.data.touched[at] == float(k)) & cut.touching[at]
        weight = -mass * self.data.gravity[2]
        normal = np.maximum(weight - np.where(touched, cut.force[at, 2], 0.0), 0.1 * weight)
        load = np.exp(own[0] - own[1]) * normal * (1.0 + motion.local[:, 3 * k])
        resting = self._resting(k, part, common)
        rough = friction.at(self._state(k, part, common, resting))[:, :2] * load[:, None]
        rough = turned(rough, yaw)
        pushed = np.where(touched[:, None], cut.force[at, :2], 0.0)
        height = np.full(len(yaw), own[5])
        shift = tipping_shift(normal, height, rough, pushed, cut.point[at, 2] + common[14])
        middle = np.full(len(yaw), float(min(common[5], common[12])))
        passed = pull - rough - pushed
        shift = shift + (middle - height)[:, None] * passed / normal[:, None]
        local = motion.local[:, 3 * k + 1 : 3 * k + 3] * np.sqrt(patch.gyration)
        return _Loaded(pull, load, resting + turned(shift, -yaw) + local)

    def _acting(
        self, k: int, part: PartMotion, motion: Motion, common: Array, friction: LinearFriction
    ) -> _Acting:
        patch, own = self.data.patches[k], common[7 * k : 7 * k + 7]
        loaded = self._loaded(k, part, motion, common, friction)
        state = self._state(k, part, common, loaded.centre)
        wrench = friction.at(state) * loaded.load[:, None]
        origin = part.pose[:, :2]
        return _Acting(
            support=turned(wrench[:, :2], part.pose[:, 2]),
            torque=wrench[:, 2],
            pull=loaded.pull,
            com=origin + part.place(patch.centroid + own[2:4]),
            centroid=origin + part.place(patch.centroid),
            spin=np.exp(own[1] + own[4]) * patch.gyration * part.acceleration[:, 2],
        )

    def noise(self, floor: float) -> Array:
        """(R, 4) standard deviations of two forces, torque, and torque about the joint."""
        cut, at = self.data.intervals, self.middle
        least = floor * MODEL_ERROR * self.typical_force
        force = np.where(cut.touching[at][:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * self.size)
        free = np.where(self.data.turning[at], least * self.size, _HELD)
        return np.column_stack([np.hypot(force, least), torque, free])
