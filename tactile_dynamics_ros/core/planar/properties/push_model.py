"""Newton-Euler equations of one pushed link per interval, on a latent motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import Cost
from tactile_dynamics_ros.core.planar.effects.acting import described
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.balance import NAMES, Balance
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals, Sightings
from tactile_dynamics_ros.core.planar.properties.latent_model import (
    DELAY_STD,
    ELSEWHERE,
    FRICTION_SPREAD,
    HEIGHT_STD,
    INERTIA_SPREAD,
    MODEL_ERROR,
    POINT_STD,
    PRODUCT_SPREAD,
    SCALE_SPREAD,
    STEPS,
    USUAL_FRICTION,
    LatentModel,
    Sharpness,
)

ASTRAY = 1.2
"""Error over the noise from which the mass of a fit is no answer, as what is missing goes into it:
of 64 clean recordings 59 had less than 1, the others up to 2.5 and masses up to 70 % too small."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 1.5
"""Friction coefficients beyond which no table is: wet ice, soft rubber. Where something acts that
the model lacks, a heavy object on ice would explain it, which hardly any pose contradicts."""
NEAR_BOUNDS = 1.3
"""Factor from these bounds within which the mass is what they say and not the data: a heavy object
on ice is the sign of something that the model lacks. 1.1 lets masses pass that are three times too
large, 2 calls good Teflon undetermined."""
_BEYOND = 0.1
"""Standard deviation of the logarithm of friction beyond these; a tenth of it changes no fit."""
USUAL_UNEVENNESS = 0.07
"""Std of the friction of a recording's places about that of the table where data do not tell how it
differs: its RMS on ten recordings made for tuning, on tables that vary by 10 % as real ones do. At
0 products were 8 and 13 std off where an even table was as likely as one that varies."""
_STEPS = np.repeat(list(STEPS.values()), 3)
"""The same for each coordinate."""


@dataclass(frozen=True, eq=False)
class PushModel(LatentModel):
    """Residuals of one link.

    Attributes:
        known: the first four common numbers (4,) beforehand, and a root (4, 4) of their
            information; None: nothing but the usual friction.
    """

    known: tuple[Array, Array] | None = None
    names: ClassVar[tuple[str, ...]] = NAMES
    freedoms: ClassVar[int] = 3
    locals: ClassVar[int] = 3
    scalings: ClassVar[tuple[str, ...]] = ("ln_product", "ln_mass")

    @property
    def patch(self) -> SupportPatch:
        """Footprint."""
        return self.data.patches[0]

    @cached_property
    def plate(self) -> float:
        """Inertia over mass of an even plate about its centroid, m^2."""
        return self.patch.gyration

    @cached_property
    def own_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers, but of the first two."""
        reach = 0.5 * np.sqrt(self.plate)
        mean = np.zeros(len(NAMES))
        mean[NAMES.index("com_height")] = self.data.com_height[0]
        std = [PRODUCT_SPREAD, PRODUCT_SPREAD, reach, reach, INERTIA_SPREAD, HEIGHT_STD]
        std += [self.data.com_height_std[0], POINT_STD, POINT_STD, SCALE_SPREAD, DELAY_STD]
        return mean, np.array(std)

    @cached_property
    def balance(self) -> Balance:
        """Balance of the intervals whose equations count."""
        return self.balance_with(self.effects)

    @cached_property
    def _moved_balance(self) -> Balance:
        """The same balance for all steps of the difference quotient at once."""
        return replace(self.balance, at=np.tile(self.middle, len(_STEPS)))

    def balance_with(self, effects: tuple[PushEffect, ...]) -> Balance:
        """Balance of the same intervals with other effects."""
        poses = self.intervals.poses[0].value
        offset = turned(np.broadcast_to(self.patch.centroid, (len(poses), 2)), poses[:, 2])
        middle = np.mean(poses[:, :2] + offset, axis=0)
        return Balance(self.intervals, self.middle, self.patch, self.data.gravity, middle, effects)

    def misfit(self, nodes: Array, common: Array, sharp: Sharpness) -> Array:
        """White residuals (R, 3) of `middle`."""
        friction = self.balance.friction(sharp.slip)
        return self.balance.lack(self.motion_of(nodes), common, friction) / self.noise(sharp.floor)

    def add_poses(self, equations: Cost, nodes: Array, common: Array) -> None:
        """Add what was seen of the pose: the motion at the stamp plus the delay of the forces."""
        seen = see_poses(self.intervals, nodes, float(np.sum(common[self.delayers])))
        weights = seen.at.weights[:, None, :] / self.intervals.poses[0].std[:, None]
        by_common = np.zeros((len(seen.residual), 3, len(common)))
        by_common[:, :, self.delayers] = seen.slope[..., None]
        equations.add_separate(seen.at.middle, seen.residual, weights, by_common=by_common)

    def dynamics(self, nodes: Array, common: Array, sharp: Sharpness) -> tuple[Array, Array, Array]:
        """White residuals (R, 3) of `middle`, derivative by nodes (R, 3, 3, 6) and numbers."""
        motion = self.motion_of(nodes)
        friction = self.balance.linear_friction(motion, common, sharp.slip)
        scale = 1.0 / self.noise(sharp.floor)

        def at(numbers: Array) -> Array:
            return self.balance.lack(motion, numbers, friction) * scale

        residual = at(common)
        moved = self._moved_balance.lack(
            motion.moved(_STEPS), common, friction.repeated(len(_STEPS))
        )
        changes = moved.reshape(len(_STEPS), *residual.shape) * scale - residual
        by_values = (changes / _STEPS[:, None, None]).transpose(1, 2, 0)
        sizes = 1e-5 * self.prior[1]
        by_common = np.stack(
            [(at(common + h * row) - residual) / h
             for h, row in zip(sizes, np.eye(len(common)), strict=True)], axis=2,
        )  # fmt: skip
        return residual, self.by_nodes(by_values), by_common

    def by_nodes(self, by_values: Array) -> Array:
        """(R, 3, 3, 6) derivative by the three nodes from that by pose, velocity, acceleration."""
        h = self.intervals.step
        pose, velocity, acceleration = (by_values[:, :, 3 * k : 3 * k + 3] for k in range(3))
        out = np.zeros((*by_values.shape[:2], 3, 6))
        out[:, :, 0, :3] = pose / 8.0 - velocity / (2.0 * h) + acceleration / h**2
        out[:, :, 1, :3] = 0.75 * pose - 2.0 * acceleration / h**2
        out[:, :, 2, :3] = pose / 8.0 + velocity / (2.0 * h) + acceleration / h**2
        out[:, :, 1, 3:] = by_values[:, :, 9:]
        return out

    def noise(self, floor: float) -> Array:
        """(R, 3) standard deviations of force, force and torque."""
        cut = self.intervals
        at = self.middle
        least = floor * MODEL_ERROR * self.typical_force
        touching = cut.touching[at]
        force = np.where(touching[:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * np.sqrt(self.plate))
        return np.column_stack([np.hypot(force, least), torque])

    def add_prior(self, equations: Cost, common: Array) -> None:
        """Add what is known of the numbers beforehand; friction keeps within its bounds."""
        mean, std = self.prior
        rows = np.diag(1.0 / std)[4:]
        equations.add_common(rows @ (common - mean), rows)
        first, root = self._beforehand
        rows = np.pad(root, ((0, 0), (0, len(common) - 4)))
        equations.add_common(root @ (common[:4] - first), rows)
        friction = common[0] - common[1]
        bound = np.clip(friction, np.log(LEAST_FRICTION), np.log(MOST_FRICTION))
        if friction != bound:
            slope = np.zeros((1, len(common)))
            slope[0, :2] = 1.0 / _BEYOND, -1.0 / _BEYOND
            equations.add_common(np.array([(friction - bound) / _BEYOND]), slope)

    @cached_property
    def _beforehand(self) -> tuple[Array, Array]:
        """The first four common numbers (4,) and a root (k, 4) of their information."""
        if self.known is not None:
            return self.known
        root = np.zeros((3, 4))
        root[0, :2] = 1.0 / FRICTION_SPREAD, -1.0 / FRICTION_SPREAD
        root[[1, 2], [2, 3]] = 1.0 / self.prior[1][2:4]
        return np.array([np.log(USUAL_FRICTION), 0.0, 0.0, 0.0]), root


@dataclass(frozen=True, eq=False)
class PushFit:
    """Common numbers of one link, averaged over variations of friction by evidence.

    Attributes:
        model: residuals with their final mask. nodes: (N, 6) of the likeliest variation.
        common: (p,) by `NAMES`. covariance: (p, p), widened by the misfit.
        whitened_rms: error over the noise, 1 where only noise remains.
        variation: relative, of friction from place to place.
        converged: whether the optimiser had next to nothing left to do.
        told_even: whether the data tell that friction is the same at all places of the table.
    """

    model: PushModel
    nodes: Array
    common: Array
    covariance: Array
    whitened_rms: float
    variation: float
    converged: bool
    told_even: bool = False

    @property
    def mass_is_bound(self) -> bool:
        """Whether the mass follows from bounds of friction, and not from the data."""
        friction = float(np.exp(self.common[0] - self.common[1]))
        low, high = LEAST_FRICTION * NEAR_BOUNDS, MOST_FRICTION / NEAR_BOUNDS
        return not low < friction < high

    @property
    def place_std(self) -> Array:
        """(3,) std of ln product, and of com_x and com_y, m, that stem from where it slid.

        Friction averages over the places of a recording, and others differ from those as they
        differ among themselves.
        """
        local = self.nodes[self.model.middle, 3:]
        unit = np.sqrt(self.model.patch.gyration)
        differ = np.sqrt(np.mean(local**2, axis=0)) * np.array([1.0, unit, unit])
        least = np.array([0.0 if self.told_even else USUAL_UNEVENNESS, 0.0, 0.0])
        return np.asarray(np.maximum(ELSEWHERE * differ, least))

    @property
    def effects(self) -> dict[str, dict[str, dict[str, Any]]]:
        """{effect: {parameter: {"value", "std", "unit"}}}; of any size where the mass is bound."""
        values = self.common[len(NAMES) :]
        std = np.sqrt(np.diag(self.covariance))[len(NAMES) :]
        return described(self.model.effects, values, np.hypot(std, values * self.mass_is_bound))

    def std(self, index: int) -> float:
        """Standard deviation of one of the common numbers."""
        return float(np.sqrt(self.covariance[index, index]))


@dataclass(frozen=True, eq=False)
class SeenPoses:
    """Poses (M,) beside the motion at their stamps.

    Attributes:
        at: where they lie on the spline.
        residual: (M, 3) white. slope: (M, 3) its derivative by the delay.
    """

    at: Sightings
    residual: Array
    slope: Array


def see_poses(cut: Intervals, nodes: Array, delay: float) -> SeenPoses:
    """What the motion of the nodes differs from the poses, by their noise.

    Args:
        cut: poses and nodes.
        nodes: (N, b) control points first.
        delay: s, of the stamps of the forces.
    """
    poses = cut.poses[0]
    at = Sightings.of_poses(cut, poses, delay)
    near = at.near(nodes)[:, :, :3]
    residual = (np.einsum("mk,mki->mi", at.weights, near) - poses.value[at.inside]) / poses.std
    return SeenPoses(at, residual, np.einsum("mk,mki->mi", at.slopes, near) / poses.std)
