"""Newton-Euler equations of two parts on one latent motion: what both structures share.

The motion has D coordinates with one control point per interval of a quadratic B-spline. Beside it
each node carries how friction differs there from its mean, and how the centre of pressure does.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import Cost, NormalEquations
from tactile_dynamics_ros.core.planar.effects.acting import Acting, ends
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation
from tactile_dynamics_ros.core.planar.linked.rows import PairFriction, PartMotion, Pressed
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.balance import measured_situation
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.linked_pair import (
    STEPS,
    Motion,
    PairData,
    SeenPart,
    Sightings,
)
from tactile_dynamics_ros.core.planar.properties.push_model import Sharpness, add_local

USUAL_FRICTION, FRICTION_SPREAD = 0.3, 0.6
"""Median of friction coefficients and standard deviation of their logarithm before any data, as for
one part: 68 % between 0.16 and 0.55."""
INERTIA_SPREAD = 0.3
"""Standard deviation of ln(inertia over that of an even plate), as for one part."""
HEIGHT_STD, POINT_STD = 2e-3, 5e-4
"""What the height and the place of the push are off by, m: of a calibrated arm, as for one part."""
SCALE_SPREAD = 0.03
"""Standard deviation of ln(size of the part that carries over the footprint): of flat faces."""
DELAY_STD = 5e-3
"""Delay between the clocks of force and pose, s: half a sample at 100 Hz."""
MODEL_ERROR = 0.003
"""Error of the equations of motion over the typical force; it is all the noise that the balance of
the untouched part has. At a third of it the fit needs twice as many steps."""
PRODUCT_SPREAD = 3.0
"""Standard deviation of the logarithm of a product before the data: none to speak of."""
_DISTANCE = 0.02
"""Distance over which friction stays alike, m, as for one part."""
_VOLUME_STEP = 0.02
"""Change of a logarithm for a difference quotient; half or double changes slopes by 1 %."""
LOOSE = 1e-6
"""Information on every node beside the data, in units of one pose: a millionth changes nothing."""


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
class PairModel(ABC):
    """Residuals of two parts; a structure says which coordinates and equations they have.

    Attributes:
        data: what was measured.
        effects: of the model; their parameters follow the common numbers.
        names: of the common numbers. freedoms: D coordinates, and as many equations: two forces,
            the torque about the contact, and what a structure adds. locals: l numbers of friction.
        scalings: names of the numbers with which the volume of motions changes.
        endings: of the names of each body's numbers.
        unknown: names of the numbers of which hardly anything is known before the data.
    """

    data: PairData
    effects: tuple[PushEffect, ...] = field(default=(), kw_only=True)
    names: ClassVar[tuple[str, ...]]
    freedoms: ClassVar[int]
    locals: ClassVar[int]
    scalings: ClassVar[tuple[str, ...]]
    unknown: ClassVar[tuple[str, ...]]
    endings: ClassVar[tuple[str, ...]] = ("_1", "_2")

    @property
    @abstractmethod
    def own_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers."""

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

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers and of the effects' parameters."""
        mean, std = self.own_prior
        more = [p.prior_std for effect in self.effects for p in effect.parameters]
        return np.append(mean, np.zeros(len(more))), np.append(std, more)

    @property
    def bodies(self) -> tuple[SupportPatch, ...]:
        """Footprint of each body that feels friction of places."""
        return self.data.patches

    @property
    def intervals(self) -> Intervals:
        """Forces and poses."""
        return self.data.intervals

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

    def at(self, name: str) -> int:
        """Place of a common number."""
        return self.names.index(name)

    @cached_property
    def delayers(self) -> list[int]:
        """Places of all numbers that delay the stamps of the forces."""
        starts = len(self.names) + ends(self.effects)
        added = [int(k) for k, e in zip(starts, self.effects, strict=True) if e.adds_to == "delay"]
        return [self.at("delay"), *added]

    @cached_property
    def middle(self) -> NDArray[np.intp]:
        """Nodes whose equations count."""
        return np.flatnonzero(self.data.mask & self.data.intervals.inner)

    @cached_property
    def typical_force(self) -> float:
        """Median horizontal force while something is touched, N."""
        cut = self.data.intervals
        return float(np.median(np.linalg.norm(cut.force[cut.touching, :2], axis=1)))

    @cached_property
    def size(self) -> float:
        """Root of the mean squared radius of gyration of the footprints, m."""
        return float(np.sqrt(np.mean([patch.gyration for patch in self.data.patches])))

    def linearise(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> NormalEquations:
        """Normal equations of dynamics, poses, local friction, prior and `volume_slope`."""
        equations = self.equations_of_motion(nodes, common, sharp)
        if slope is not None:
            equations.add_slope(slope, common)
        self._add_seen(equations, nodes, common, sharp)
        return equations

    def cost(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> float:
        """Cost of `linearise` without most of its derivatives."""
        motion = Motion.of_nodes(nodes, self.middle, self.data.intervals.step, self.freedoms)
        friction = self.linear_friction(common, motion, sharp.slip)
        total = Cost()
        total.count(self.lack(motion, common, friction) / self.noise(sharp.floor))
        if slope is not None:
            total.add_slope(slope, common)
        self._add_smoothness(total, nodes)
        self._add_seen(total, nodes, common, sharp)
        return total.cost

    def _add_seen(self, equations: Cost, nodes: Array, common: Array, sharp: Sharpness) -> None:
        for part in (0, 1):
            self._add_poses(equations, nodes, common, part)
        self._add_local(equations, nodes, sharp)
        self._add_prior(equations, common)

    def equations_of_motion(self, nodes: Array, common: Array, sharp: Sharpness) -> NormalEquations:
        """Normal equations of the dynamics alone, and of smoothness where they do not count."""
        equations = NormalEquations(len(nodes), nodes.shape[1], len(common))
        equations.add(self.middle, *self.dynamics(nodes, common, sharp))
        self._add_smoothness(equations, nodes)
        return equations

    def _add_smoothness(self, equations: Cost, nodes: Array) -> None:
        cut, count = self.data.intervals, self.freedoms
        elsewhere = np.flatnonzero(~self.data.mask & cut.inner)
        spread = self.data.spread[elsewhere, :count] * cut.step**2
        curve = nodes[elsewhere - 1] - 2.0 * nodes[elsewhere] + nodes[elsewhere + 1]
        weights = np.array([1.0, -2.0, 1.0]) / spread[:, :, None]
        equations.add_separate(elsewhere, curve[:, :count] / spread, weights)

    def dynamics(self, nodes: Array, common: Array, sharp: Sharpness) -> tuple[Array, Array, Array]:
        """White residuals (R, D) of `middle`, derivative by nodes (R, D, 3, D + l) and numbers."""
        step = self.data.intervals.step
        motion = Motion.of_nodes(nodes, self.middle, step, self.freedoms)
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

    def _add_poses(self, equations: Cost, nodes: Array, common: Array, part: int) -> None:
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

    def _add_local(self, equations: Cost, nodes: Array, sharp: Sharpness) -> None:
        """Rows e_k+1 = rho e_k + sigma sqrt(1 - rho^2) w, rho = exp(-distance / 20 mm)."""
        add_local(equations, nodes, self.freedoms, *self.memory(sharp), sharp.variation)

    def memory(self, sharp: Sharpness) -> tuple[Array, Array]:
        """Factor (N - 1,) by which local friction lasts to the next node, and std of its change."""
        keep = np.exp(-np.maximum(self.data.travelled, 1e-6) / _DISTANCE)
        return keep, sharp.variation * np.sqrt(1.0 - keep**2)

    def _add_prior(self, equations: Cost, common: Array) -> None:
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

    def volume_slope(self, nodes: Array, common: Array, sharp: Sharpness) -> Array:
        """Slope (p,) of what the likeliest motion leaves out of the probability of the numbers.

        As for one part: |det J| / sqrt(det H), with J the derivative of the forces by the motion.
        """
        slope = np.zeros(len(common))
        for name in self.scalings:
            shift = np.zeros(len(common))
            shift[self.at(name)] = _VOLUME_STEP
            values = [self._log_volume(nodes, common + k * shift, sharp) for k in (1.0, -1.0)]
            slope[self.at(name)] = (values[0] - values[1]) / (2.0 * _VOLUME_STEP)
        return slope

    def _log_volume(self, nodes: Array, common: Array, sharp: Sharpness) -> float:
        loose = np.broadcast_to(self.loosening, nodes.shape)
        equations = self.equations_of_motion(nodes, common, sharp)
        caused = equations.log_determinant_of_nodes(loose, self.freedoms)
        self._add_seen(equations, nodes, common, sharp)
        return 0.5 * (caused - equations.log_determinant_of_nodes(loose, nodes.shape[1]))

    @cached_property
    def node_scale(self) -> Array:
        """(D + l,) sizes of the nodes' numbers, in whose inverse squares damping is counted."""
        std = self.data.intervals.poses[0].std
        return np.append(std[[0, 1, 2, 2][: self.freedoms]], np.full(self.locals, 0.01))

    @property
    def loosening(self) -> Array:
        """(D + l,) information on every node beside the data."""
        motion = np.arange(len(self.node_scale)) < self.freedoms
        return np.asarray(LOOSE / np.square(self.node_scale) * motion)
