"""Newton-Euler equations of two parts on one latent motion: what both structures share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import Cost
from tactile_dynamics_ros.core.planar.effects.acting import Acting
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation
from tactile_dynamics_ros.core.planar.linked.rows import PairFriction, PartMotion, Pressed
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.balance import measured_situation
from tactile_dynamics_ros.core.planar.properties.intervals import Sightings
from tactile_dynamics_ros.core.planar.properties.latent_model import (
    FRICTION_SPREAD,
    STEPS,
    USUAL_FRICTION,
    LatentModel,
    Motion,
    Sharpness,
)
from tactile_dynamics_ros.core.planar.properties.linked_pair import PairData, SeenPart


@dataclass(frozen=True, eq=False)
class Given:
    """What a set of common numbers says.

    Attributes:
        numbers: (p,) by the model's names, with what effects add to them.
        acting: effects at their parameters. situation: what acts in R intervals.
    """

    numbers: Array
    acting: Acting
    situation: Situation


@dataclass(frozen=True, eq=False)
class PairModel(LatentModel):
    """Residuals of two parts; a structure says which coordinates and equations they have.

    Attributes:
        endings: of the names of each body's numbers.
        unknown: names of the numbers of which hardly anything is known before the data.
    """

    data: PairData
    unknown: ClassVar[tuple[str, ...]]
    endings: ClassVar[tuple[str, ...]] = ("_1", "_2")

    @abstractmethod
    def linear_friction(self, common: Array, motion: Motion, slip: float) -> PairFriction:
        """Friction of each body to first order around a motion."""

    @abstractmethod
    def lack(self, motion: Motion, common: Array, friction: PairFriction) -> Array:
        """Equations (R, D) that are lacking, N or N m."""

    @abstractmethod
    def support_rows(
        self, motion: Motion, common: Array, supports: Sequence[tuple[Array, Array]]
    ) -> Array:
        """What forces (R, 2) and torques (R,) of the support on each body do to `lack`."""

    @abstractmethod
    def pressed(self, motion: Motion, common: Array, friction: PairFriction) -> tuple[Pressed, ...]:
        """How each body rests and slides."""

    @abstractmethod
    def noise(self, floor: float) -> Array:
        """(R, D) standard deviations of the equations."""

    @abstractmethod
    def part_poses(self, coordinates: Array, numbers: Array) -> tuple[Array, Array]:
        """Poses (M, 3) of both parts' frames."""

    @property
    def bodies(self) -> tuple[SupportPatch, ...]:
        """Footprint of each body that feels friction of places."""
        return self.data.patches

    def given(self, common: Array) -> Given:
        """What common numbers say."""
        acting = Acting(self.effects, common[len(self.names) :])
        numbers = acting.numbers(common[: len(self.names)], self.names)
        return Given(numbers, acting, acting.changed(self.presumed(numbers)))

    def presumed(self, numbers: Array) -> Situation:
        """What was measured, before effects change it."""
        return self._measured

    @cached_property
    def _measured(self) -> Situation:
        return measured_situation(self.data.intervals, self.middle, self.data.gravity)

    def planar_motion(self, part: PartMotion, patch: SupportPatch) -> PlanarMotion:
        """Motion of a footprint's centroid, as effects see it."""
        return PlanarMotion(
            time=self.data.intervals.time[self.middle],
            place=part.pose[:, :2] + part.place(patch.centroid),
            velocity=part.velocity_of(patch.centroid),
            yaw=part.pose[:, 2],
            rate=part.velocity[:, 2],
            gyration=patch.gyration,
            middle=self.middle_place,
        )

    @cached_property
    def middle_place(self) -> Array:
        """(2,) m, mean place of the first body's centroid."""
        poses = self.data.intervals.poses[0].value
        offset = np.broadcast_to(self.bodies[0].centroid, (len(poses), 2))
        return np.asarray(np.mean(poses[:, :2] + turned(offset, poses[:, 2]), axis=0))

    def lack_by_shares(
        self, motion: Motion, common: Array, friction: PairFriction, shares: Iterable[Array]
    ) -> Array:
        """Change (R, D, K) of `lack` by relative changes of friction (R, n) under all points."""
        pressed = self.pressed(motion, common, friction)
        ends = np.cumsum([len(patch.share) for patch in self.bodies])[:-1]
        changes = []
        for share in shares:
            supports = [
                body.support_by(own, friction.slip)
                for body, own in zip(pressed, np.split(share, ends, axis=1), strict=True)
            ]
            changes.append(self.support_rows(motion, common, supports))
        return np.stack(changes, axis=2)

    def pose_std(self, part: int) -> Array:
        """(3,) m, m, rad, that a part's poses are off by."""
        return self.data.intervals.poses[part].std

    @cached_property
    def size(self) -> float:
        """Root of the mean squared radius of gyration of the footprints, m."""
        return float(np.sqrt(np.mean([patch.gyration for patch in self.data.patches])))

    def misfit(self, nodes: Array, common: Array, sharp: Sharpness) -> Array:
        """White residuals (R, D) of the equations of `middle`."""
        motion = self.motion_of(nodes)
        friction = self.linear_friction(common, motion, sharp.slip)
        return self.lack(motion, common, friction) / self.noise(sharp.floor)

    def dynamics(self, nodes: Array, common: Array, sharp: Sharpness) -> tuple[Array, Array, Array]:
        """White residuals (R, D) of `middle`, derivative by nodes (R, D, 3, D + l) and numbers."""
        step = self.data.intervals.step
        motion = self.motion_of(nodes)
        friction = self.linear_friction(common, motion, sharp.slip)
        scale = 1.0 / self.noise(sharp.floor)
        residual = self.lack(motion, common, friction) * scale

        def by(name: str, count: int) -> Array:
            moved = [motion.shifted(name, axis) for axis in range(count)]
            columns = [self.lack(there, common, friction) * scale - residual for there in moved]
            return np.stack(columns, axis=2) / STEPS[name]

        size = self.freedoms
        pose, velocity = by("pose", size), by("velocity", size) / (2.0 * step)
        acceleration = by("acceleration", size) / step**2
        by_nodes = np.zeros((*residual.shape, 3, nodes.shape[1]))
        by_nodes[:, :, 0, :size] = pose / 8.0 - velocity + acceleration
        by_nodes[:, :, 1, :size] = 0.75 * pose - 2.0 * acceleration
        by_nodes[:, :, 2, :size] = pose / 8.0 + velocity + acceleration
        by_nodes[:, :, 1, size:] = by("local", self.locals)
        columns = []
        for h, row in zip(1e-5 * self.prior[1], np.eye(len(common)), strict=True):
            changed = self.lack(motion, common + h * row, friction) * scale
            columns.append((changed - residual) / h)
        return residual, by_nodes, np.stack(columns, axis=2)

    def add_poses(self, equations: Cost, nodes: Array, common: Array) -> None:
        """Add what was seen of the poses of both parts."""
        for part in (0, 1):
            seen = self.seen(nodes, common, part)
            by_nodes = np.zeros((*seen.by_nodes.shape[:3], nodes.shape[1]))
            by_nodes[..., : self.freedoms] = seen.by_nodes
            equations.add(seen.at.middle, seen.residual, by_nodes, seen.by_common)

    def seen(self, nodes: Array, common: Array, part: int) -> SeenPart:
        """What the motion of the nodes differs from a part's poses, by their noise."""
        cut, size, std = self.data.intervals, self.freedoms, self.pose_std(part)
        poses, numbers = cut.poses[part], common[: len(self.names)]
        at = Sightings.of_poses(cut, poses, float(np.sum(common[self.delayers])))
        near = at.near(nodes)[:, :, :size]
        place = np.einsum("mk,mki->mi", at.weights, near)
        seen = self.part_poses(place, numbers)[part]
        slope = np.zeros((len(place), 3, size))
        for axis, row in enumerate(1e-6 * np.eye(size)):
            moved = self.part_poses(place + row, numbers)[part]
            slope[:, :, axis] = (moved - seen) / 1e-6 / std
        by_common = np.zeros((len(place), 3, len(common)))
        for k in self._placing:
            row = np.eye(len(numbers))[k] * 1e-6
            by_common[:, :, k] = (self.part_poses(place, numbers + row)[part] - seen) / 1e-6
        by_common /= std[:, None]
        rate = np.einsum("mk,mki->mi", at.slopes, near)
        by_common[:, :, self.delayers] = np.einsum("mai,mi->ma", slope, rate)[..., None]
        return SeenPart(
            at=at,
            residual=(seen - poses.value[at.inside]) / std,
            by_nodes=slope[:, :, None, :] * at.weights[:, None, :, None],
            by_common=by_common,
        )

    @property
    def _placing(self) -> list[int]:
        """Places of the common numbers on which the second part's pose depends."""
        return [k for k, name in enumerate(self.names) if name.startswith("joint_at")]

    def add_prior(self, equations: Cost, common: Array) -> None:
        """Add what is known of the numbers beforehand, and of the friction of each body."""
        mean, std = self.prior
        equations.add_common((common - mean) / std, np.diag(1.0 / std))
        for product, mass in self.frictions:
            row = np.zeros((1, len(common)))
            row[0, [product, mass]] = 1.0 / FRICTION_SPREAD, -1.0 / FRICTION_SPREAD
            away = common[product] - common[mass] - np.log(USUAL_FRICTION)
            equations.add_common(np.array([away / FRICTION_SPREAD]), row)

    @property
    def frictions(self) -> list[tuple[int, int]]:
        """Places of ln product and ln mass of each body, whose difference is ln friction."""
        masses = [name for name in self.names if name.startswith("ln_mass")]
        return [(self.at(name.replace("mass", "product")), self.at(name)) for name in masses]
