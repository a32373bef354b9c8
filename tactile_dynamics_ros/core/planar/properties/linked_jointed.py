"""Two parts on a revolute joint with friction: four coordinates, four equations per interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.effects.part import of_both, of_part
from tactile_dynamics_ros.core.planar.linked.chances import JOINT_SPREAD, JOINT_TORQUE
from tactile_dynamics_ros.core.planar.linked.rows import (
    LinearFriction,
    Loaded,
    PairFriction,
    PartMotion,
    Pressed,
    across,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import cross, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import area_and_centroid
from tactile_dynamics_ros.core.planar.mechanics.support import tipping_shift
from tactile_dynamics_ros.core.planar.properties.latent_model import (
    DELAY_STD,
    HEIGHT_STD,
    INERTIA_SPREAD,
    MODEL_ERROR,
    POINT_STD,
    PRODUCT_SPREAD,
    SCALE_SPREAD,
    Motion,
)
from tactile_dynamics_ros.core.planar.properties.linked_model import Given, PairModel
from tactile_dynamics_ros.core.planar.properties.linked_structure import Hinge

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
    unknown: ClassVar[tuple[str, ...]] = ("ln_product_1", "ln_product_2")

    @cached_property
    def own_prior(self) -> tuple[Array, Array]:
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

    def part_poses(self, coordinates: Array, numbers: Array) -> tuple[Array, Array]:
        """Poses (M, 3) of both parts' frames."""
        first, yaw = coordinates[:, :3], coordinates[:, 3]
        size = len(coordinates)
        joint = first[:, :2] + turned(np.broadcast_to(numbers[18:20], (size, 2)), first[:, 2])
        second = joint - turned(np.broadcast_to(numbers[20:22], (size, 2)), yaw)
        return first, np.column_stack([second, yaw])

    def _parts(self, motion: Motion, numbers: Array) -> tuple[PartMotion, PartMotion]:
        poses = self.part_poses(motion.pose, numbers)
        first = PartMotion(poses[0], motion.velocity[:, :3], motion.acceleration[:, :3])
        rate, change = motion.velocity[:, 3:], motion.acceleration[:, 3:]
        arm = turned(np.broadcast_to(-numbers[20:22], (len(rate), 2)), motion.pose[:, 3])
        speed = first.velocity_of(numbers[18:20]) + rate * across(arm)
        push = first.acceleration_of(numbers[18:20]) + change * across(arm) - rate**2 * arm
        second = PartMotion(
            poses[1], np.column_stack([speed, rate]), np.column_stack([push, change])
        )
        return first, second

    def linear_friction(self, common: Array, motion: Motion, slip: float) -> PairFriction:
        """Friction of each part to first order around a motion."""
        given, frictions = self.given(common), []
        for k, part in enumerate(self._parts(motion, given.numbers)):
            state = self._state(k, part, given.numbers, self._carried(k, given)[1])
            rough = LinearFriction.of_state(self.data.patches[k], state, slip)
            centre = self._loaded(k, part, motion, given, rough).centre
            state = self._state(k, part, given.numbers, centre)
            frictions.append(LinearFriction.of_state(self.data.patches[k], state, slip))
        return PairFriction(tuple(frictions), slip)

    def _carried(self, k: int, given: Given) -> tuple[Array, Array]:
        """Mass (R,), kg, and centre of mass (R, 2) from the centroid, m, of a part."""
        own = given.numbers[7 * k : 7 * k + 7]
        even = np.ones(len(self.middle))
        mass, com = even * np.exp(own[1]), even[:, None] * own[2:4]
        alone = replace(given.situation, mass=mass, com=com)
        alone = of_part(given.acting, k).changed(alone)
        return alone.mass, alone.com

    def _state(self, k: int, part: PartMotion, numbers: Array, centre: Array) -> Array:
        twist = part.twist_of(self.data.patches[k].centroid)
        scale = np.full(len(twist), float(np.exp(numbers[7 * k + 6])))
        return np.column_stack([twist, centre, scale, np.zeros(len(twist))])

    def lack(self, motion: Motion, common: Array, friction: PairFriction) -> Array:
        """Two forces and torques about contact and joint (R, 4) that are lacking, N and N m."""
        given = self.given(common)
        parts = self._parts(motion, given.numbers)
        loaded = [self._loaded(k, parts[k], motion, given, friction.bodies[k]) for k in (0, 1)]
        supports = [
            self._supported(k, parts[k], given, loaded[k], friction.bodies[k]) for k in (0, 1)
        ]
        first, second = (self._acting(k, parts[k], given, loaded[k], supports[k]) for k in (0, 1))
        found = self._balanced(motion, given, parts, (first, second))
        found[:, :2] -= given.situation.force[:, :2]
        found[:, 2] -= self.data.intervals.torque[self.middle]
        turning = motion.velocity[:, 3] - motion.velocity[:, 2]
        rubbing = turning / np.sqrt(turning**2 + (friction.slip / _ARM) ** 2)
        rubbing *= np.exp(given.numbers[22]) * np.where(self._on_second, 1.0, -1.0)
        held = motion.acceleration[:, 3] - motion.acceleration[:, 2]
        found[:, 3] = np.where(self.data.turning[self.middle], found[:, 3] + rubbing, held)
        return found

    def support_rows(
        self, motion: Motion, common: Array, supports: Sequence[tuple[Array, Array]]
    ) -> Array:
        """What forces (R, 2) and torques (R,) of the support on each part do to `lack`."""
        given = self.given(common)
        parts = self._parts(motion, given.numbers)
        none = np.zeros(len(motion.pose))
        still = np.zeros((len(none), 2))
        acting = []
        for k, (force, torque) in enumerate(supports):
            places = self._places(k, parts[k], self._carried(k, given)[1])
            acting.append(_Acting(force, torque, still, *places, none))
        found = self._balanced(motion, given, parts, (acting[0], acting[1]))
        found[:, 3] *= self.data.turning[self.middle]
        return found

    def pressed(self, motion: Motion, common: Array, friction: PairFriction) -> tuple[Pressed, ...]:
        """How each part rests and slides."""
        given, found = self.given(common), []
        for k, part in enumerate(self._parts(motion, given.numbers)):
            loaded = self._loaded(k, part, motion, given, friction.bodies[k])
            state = self._state(k, part, given.numbers, loaded.centre)
            found.append(Pressed(self.data.patches[k], part, state, loaded.load))
        return tuple(found)

    @property
    def _on_second(self) -> NDArray[np.bool_]:
        """(R,) whether the balance about the joint is the second part's: the other is touched."""
        return np.asarray(self.data.touched[self.middle] == 0.0)

    def _balanced(
        self,
        motion: Motion,
        given: Given,
        parts: tuple[PartMotion, PartMotion],
        acting: tuple[_Acting, _Acting],
    ) -> Array:
        """What both parts lack (R, 4), but for contact, friction of the joint and held joints."""
        first, second = acting
        numbers, situation = given.numbers, given.situation
        joint = parts[0].pose[:, :2] + parts[0].place(numbers[18:20])
        total = first.pull + second.pull - first.support - second.support
        point = situation.point[:, :2] + numbers[15:17]
        point = np.where(situation.touching[:, None], point, first.com)
        whole = first.moment(point) + second.moment(point)
        free = np.where(self._on_second, second.moment(joint), first.moment(joint))
        return np.column_stack([total, whole, free])

    def _loaded(
        self, k: int, part: PartMotion, motion: Motion, given: Given, friction: LinearFriction
    ) -> Loaded:
        """Load and pressure of a part; what the joint passes on tips it as a contact does."""
        at, patch = self.middle, self.data.patches[k]
        situation, numbers = given.situation, given.numbers
        own = numbers[7 * k : 7 * k + 7]
        (mass, com), yaw = self._carried(k, given), part.pose[:, 2]
        moved = part.acceleration_at(turned(patch.centroid + com, yaw))
        pull = mass[:, None] * (moved - situation.gravity[:2])
        touched = (self.data.touched[at] == float(k)) & situation.touching
        weight = -mass * situation.gravity[2]
        normal = np.maximum(weight - np.where(touched, situation.force[:, 2], 0.0), 0.1 * weight)
        load = np.exp(own[0] - own[1]) * normal * (1.0 + motion.local[:, 3 * k])
        rough = friction.at(self._state(k, part, numbers, com))[:, :2] * load[:, None]
        rough = turned(rough, yaw)
        pushed = np.where(touched[:, None], situation.force[:, :2], 0.0)
        height = np.full(len(yaw), own[5])
        shift = tipping_shift(normal, height, rough, pushed, situation.point[:, 2] + numbers[14])
        middle = np.full(len(yaw), float(min(numbers[5], numbers[12])))
        passed = pull - rough - pushed
        shift = shift + (middle - height)[:, None] * passed / normal[:, None]
        local = motion.local[:, 3 * k + 1 : 3 * k + 3] * np.sqrt(patch.gyration)
        return Loaded(pull, load, com + turned(shift, -yaw) + local)

    def _supported(
        self, k: int, part: PartMotion, given: Given, loaded: Loaded, friction: LinearFriction
    ) -> tuple[Array, Array]:
        """Force (R, 2) and torque (R,) of the support about a part's centroid."""
        patch = self.data.patches[k]
        motion, both = self.planar_motion(part, patch), of_both(given.acting)
        rise = both.rise(motion)
        centre = loaded.centre + rise @ patch.second_moments
        load = loaded.load * (1.0 + np.sum(rise * loaded.centre, axis=1))
        wrench = friction.at(self._state(k, part, given.numbers, centre)) * load[:, None]
        force = turned(wrench[:, :2], part.pose[:, 2])
        force, torque = both.resisted(motion, force, wrench[:, 2], self._shares[k])
        return of_part(given.acting, k).resisted(motion, force, torque)

    @cached_property
    def _shares(self) -> tuple[float, float]:
        """Of each footprint in the area of both."""
        areas = [abs(area_and_centroid(patch.outline)[0]) for patch in self.data.patches]
        return areas[0] / sum(areas), areas[1] / sum(areas)

    def _places(self, k: int, part: PartMotion, com: Array) -> tuple[Array, Array]:
        """Centre of mass, at (R, 2) m from the centroid in the part's axes, and centroid (R, 2)."""
        centroid, origin = self.data.patches[k].centroid, part.pose[:, :2]
        return origin + turned(centroid + com, part.pose[:, 2]), origin + part.place(centroid)

    def _acting(
        self,
        k: int,
        part: PartMotion,
        given: Given,
        loaded: Loaded,
        support: tuple[Array, Array],
    ) -> _Acting:
        mass, com = self._carried(k, given)
        inertia = mass * np.exp(given.numbers[7 * k + 4]) * self.data.patches[k].gyration
        places = self._places(k, part, com)
        return _Acting(*support, loaded.pull, *places, inertia * part.acceleration[:, 2])

    def noise(self, floor: float) -> Array:
        """(R, 4) standard deviations of two forces, torque, and torque about the joint."""
        cut, at = self.data.intervals, self.middle
        least = floor * MODEL_ERROR * self.typical_force
        force = np.where(cut.touching[at][:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * self.size)
        free = np.where(self.data.turning[at], least * self.size, _HELD)
        return np.column_stack([np.hypot(force, least), torque, free])
