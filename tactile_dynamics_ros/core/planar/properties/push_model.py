"""Newton-Euler equations of one pushed link per interval, on a latent motion.

The motion has one control point per interval of a quadratic B-spline, so that accelerations are
constant over an interval. Beside it each node carries how friction differs there from its mean: a
relative change and a shift of the centre of pressure, which vary over the distance travelled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import Cost, NormalEquations
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.balance import NAMES, Balance, Kinematics
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals

Mask = NDArray[np.bool_]

USUAL_FRICTION, FRICTION_SPREAD = 0.3, 0.6
"""Median of friction coefficients and standard deviation of their logarithm before any data: 68 %
between 0.16 and 0.55, from Teflon to wood. It is all that is said of the mass where nothing
accelerates; half the spread would make such masses look known to 30 %."""
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
_INERTIA_SPREAD = 0.3
"""Standard deviation of ln(inertia over that of an even plate): a rim has 1.5 to 2 times that of a
plate, a solid lump in the middle half of it. Wider changes masses of shapely objects by little."""
_HEIGHT_STD, _POINT_STD = 2e-3, 5e-4
"""What the height and the place of the push are off by, m: of a calibrated arm. An unstated error
of 5 mm in height shifts the mass by 12 % and leaves no trace in the residuals."""
_SCALE_SPREAD = 0.03
"""Standard deviation of ln(size of the part that carries over the footprint): of flat faces. Feet
or a rim are an effect of their own."""
_DELAY_STD = 5e-3
"""Delay between the clocks of force and pose, s: half a sample at 100 Hz."""
_VOLUME_STEP = 0.02
"""Change of a logarithm for a difference quotient; half or double changes slopes by 1 %."""
_LOOSE = 1e-6
"""Information on every node beside the data, in units of one pose: places that nothing tells, such
as those of nodes before the first pose. A millionth changes no interval."""
_DISTANCE = 0.02
"""Distance over which friction stays alike, m: grain and wear of tables. Twice as long widens
products of short pushes by 1.3."""

_STEPS = np.repeat([1e-6, 1e-5, 1e-3, 1e-5], 3)
"""Steps of difference quotients by pose (m, rad), velocity, acceleration and local friction: a
thousandth of their noise, a thousand times what rounding makes."""

ELSEWHERE = np.array([2.0, 1.2, 1.2])
"""Std of friction and of its centre at the places of a recording about those of the table, over the
RMS by which those places differ: on ten recordings made for tuning, each over a few lengths of it.
At 0 products on uneven tables were up to 13 std off; larger widens intervals."""
USUAL_UNEVENNESS = 0.07
"""Std of the friction of a recording's places about that of the table where data do not tell how it
differs: its RMS on ten recordings made for tuning, on tables that vary by 10 % as real ones do. At
0 products were 8 and 13 std off where an even table was as likely as one that varies."""


@dataclass(frozen=True)
class Sharpness:
    """How strictly a stage of the fit takes the model.

    Attributes:
        slip: m/s below which friction falls. floor: of the model's error over its final value.
        variation: relative standard deviation of friction from place to place.
    """

    slip: float
    floor: float
    variation: float


@dataclass(frozen=True, eq=False)
class PushModel:
    """Residuals of one link.

    Attributes:
        intervals: forces and poses. patch: footprint. gravity: (3,) m/s^2.
        com_height, com_height_std: m, before the data.
        mask: (N,) intervals whose equations count; elsewhere the motion is smooth.
        travelled: (N - 1,) m between nodes. spread: (N, 3) accelerations allowed elsewhere.
        effects: of the model. known: the first four common numbers (4,) beforehand, and a root
            (4, 4) of their information; None: nothing but the usual friction.
    """

    intervals: Intervals
    patch: SupportPatch
    gravity: Array
    com_height: float
    com_height_std: float
    mask: Mask
    travelled: Array
    spread: Array
    effects: tuple[PushEffect, ...] = ()
    known: tuple[Array, Array] | None = None

    @cached_property
    def plate(self) -> float:
        """Inertia over mass of an even plate about its centroid, m^2."""
        return self.patch.gyration

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers, but of the first two."""
        reach = 0.5 * np.sqrt(self.plate)
        mean = np.zeros(len(NAMES))
        mean[NAMES.index("com_height")] = self.com_height
        std = np.array(
            [3.0, 3.0, reach, reach, _INERTIA_SPREAD, _HEIGHT_STD, self.com_height_std]
            + [_POINT_STD, _POINT_STD, _SCALE_SPREAD, _DELAY_STD]
            + [p.prior_std for effect in self.effects for p in effect.parameters]
        )
        return np.append(mean, np.zeros(len(std) - len(mean))), std

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
        return Balance(self.intervals, self.middle, self.patch, self.gravity, middle, effects)

    @property
    def delayers(self) -> tuple[int, ...]:
        """Places, among the common numbers, of those that effects add to the delay."""
        first, found = len(NAMES), []
        for effect in self.effects:
            found += [first] * (effect.adds_to == "delay")
            first += len(effect.parameters)
        return tuple(found)

    @cached_property
    def typical_force(self) -> float:
        """Median horizontal force while something is touched, N."""
        horizontal = np.linalg.norm(self.intervals.force[:, :2], axis=1)
        return float(np.median(horizontal[self.intervals.touching]))

    @cached_property
    def middle(self) -> NDArray[np.intp]:
        """Nodes whose equations count."""
        return np.flatnonzero(self.mask & self.intervals.inner)

    def linearise(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> NormalEquations:
        """Normal equations of dynamics, poses, local friction, prior and `volume_slope`."""
        equations = self.equations_of_motion(nodes, common, sharp)
        self._add_seen(equations, nodes, common, sharp, slope)
        return equations

    def cost(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> float:
        """Cost of `linearise` without its derivatives."""
        kinematics = Kinematics.of_nodes(nodes, self.middle, self.intervals.step)
        lack = self.balance.lack(kinematics, common, self.balance.friction(sharp.slip))
        total = Cost()
        total.count(lack / self.noise(sharp.floor))
        self._add_smoothness(total, nodes)
        self._add_seen(total, nodes, common, sharp, slope)
        return total.cost

    def _add_seen(
        self,
        equations: Cost,
        nodes: Array,
        common: Array,
        sharp: Sharpness,
        slope: Array | None = None,
    ) -> None:
        if slope is not None:
            equations.add_slope(slope, common)
        add_poses(equations, self.intervals, nodes, common, self.delayers)
        self._add_local(equations, nodes, sharp)
        self._add_prior(equations, common)

    def equations_of_motion(self, nodes: Array, common: Array, sharp: Sharpness) -> NormalEquations:
        """Normal equations of the dynamics alone, and of smoothness where they do not count."""
        equations = NormalEquations(len(nodes), 6, len(common))
        equations.add(self.middle, *self.dynamics(nodes, common, sharp))
        self._add_smoothness(equations, nodes)
        return equations

    def _add_smoothness(self, equations: Cost, nodes: Array) -> None:
        elsewhere = np.flatnonzero(~self.mask & self.intervals.inner)
        add_smoothness(equations, nodes, elsewhere, self.spread[elsewhere] * self.intervals.step**2)

    def volume_slope(self, nodes: Array, common: Array, sharp: Sharpness) -> Array:
        """Slope (p,) of what the likeliest motion leaves out of the probability of the numbers.

        Forces cause the motion: any force is as likely as any other beforehand, not any motion.
        With J the derivative of the forces by the motion, and H that of the whole cost, the
        probability integrated over all motions has the factor

            |det J| / sqrt(det H),   |det J| = sqrt(det H_dynamics)

        beside the likeliest one's. Without it the mass comes out too low: a light object follows
        the noise of its poses at no cost.
        """
        slope = np.zeros(len(common))
        for name in ("ln_product", "ln_mass"):
            shift = np.zeros(len(common))
            shift[NAMES.index(name)] = _VOLUME_STEP
            values = [self._log_volume(nodes, common + k * shift, sharp) for k in (1.0, -1.0)]
            slope[NAMES.index(name)] = (values[0] - values[1]) / (2.0 * _VOLUME_STEP)
        return slope

    def _log_volume(self, nodes: Array, common: Array, sharp: Sharpness) -> float:
        equations = self.equations_of_motion(nodes, common, sharp)
        caused = equations.log_determinant_of_nodes(self._loose(nodes), 3)
        self._add_seen(equations, nodes, common, sharp)
        return 0.5 * (caused - equations.log_determinant_of_nodes(self._loose(nodes), 6))

    def log_jacobian(self, nodes: Array, common: Array, sharp: Sharpness) -> float:
        """Logarithm of |det J|, see `volume_slope`: of what the forces cause by the motion."""
        equations = self.equations_of_motion(nodes, common, sharp)
        return 0.5 * equations.log_determinant_of_nodes(self._loose(nodes), 3)

    def _loose(self, nodes: Array) -> Array:
        """(N, 6) information on every node beside the data."""
        loose = np.append(_LOOSE / np.square(self.intervals.poses[0].std), np.zeros(3))
        return np.broadcast_to(loose, nodes.shape)

    def dynamics(self, nodes: Array, common: Array, sharp: Sharpness) -> tuple[Array, Array, Array]:
        """White residuals (R, 3) of `middle`, derivative by nodes (R, 3, 3, 6) and numbers."""
        kinematics = Kinematics.of_nodes(nodes, self.middle, self.intervals.step)
        friction = self.balance.linear_friction(kinematics, common, sharp.slip)
        scale = 1.0 / self.noise(sharp.floor)

        def at(numbers: Array) -> Array:
            return self.balance.lack(kinematics, numbers, friction) * scale

        residual = at(common)
        moved = self._moved_balance.lack(
            kinematics.moved(_STEPS), common, friction.repeated(len(_STEPS))
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
        least = floor * 0.003 * self.typical_force
        touching = cut.touching[at]
        force = np.where(touching[:, None], cut.force_std[at], 0.3 * cut.force_std[at])
        size = np.linalg.norm(cut.force[at, :2], axis=1)
        torque = np.hypot(size * cut.point_std[at], least * np.sqrt(self.plate))
        return np.column_stack([np.hypot(force, least), torque])

    def _add_local(self, equations: Cost, nodes: Array, sharp: Sharpness) -> None:
        """Rows e_k+1 = rho e_k + sigma sqrt(1 - rho^2) w, rho = exp(-distance / 20 mm)."""
        add_local(equations, nodes, 3, *self.memory(sharp), sharp.variation)

    def memory(self, sharp: Sharpness) -> tuple[Array, Array]:
        """Factor (N - 1,) by which local friction lasts to the next node, and std of its change."""
        keep = np.exp(-np.maximum(self.travelled, 1e-6) / _DISTANCE)
        return keep, sharp.variation * np.sqrt(1.0 - keep**2)

    def _add_prior(self, equations: Cost, common: Array) -> None:
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
    def effects(self) -> dict[str, dict[str, dict[str, object]]]:
        """{effect: {parameter: {"value", "std", "unit"}}}; of any size where the mass is bound."""
        table: dict[str, dict[str, dict[str, object]]] = {}
        first = len(NAMES)
        for effect in self.model.effects:
            own = table.setdefault(effect.name, {})
            for parameter in effect.parameters:
                value, std = float(self.common[first]), self.std(first)
                if self.mass_is_bound:
                    std = float(np.hypot(std, value))
                own[parameter.name] = {"value": value, "std": std, "unit": parameter.unit}
                first += 1
        return table

    def std(self, index: int) -> float:
        """Standard deviation of one of the common numbers."""
        return float(np.sqrt(self.covariance[index, index]))


def add_poses(
    equations: Cost,
    cut: Intervals,
    nodes: Array,
    common: Array,
    delayers: Sequence[int] = (),
) -> None:
    """Add what was seen of the pose: the motion at the stamp plus the delay of the forces.

    Args:
        equations: to be extended.
        cut: poses and nodes.
        nodes: (N, b) control points first.
        common: (p,) numbers.
        delayers: places of further numbers that are added to the delay.
    """
    delaying = [NAMES.index("delay"), *delayers]
    seen = see_poses(cut, nodes, float(np.sum(common[delaying])))
    weights = seen.weights[:, None, :] / cut.poses[0].std[:, None]
    by_common = np.zeros((len(seen.middle), 3, len(common)))
    by_common[:, :, delaying] = seen.slope[..., None]
    equations.add_separate(seen.middle, seen.residual, weights, by_common=by_common)


@dataclass(frozen=True, eq=False)
class SeenPoses:
    """Poses (M,) beside the motion at their stamps.

    Attributes:
        index: among the poses. middle: node. weights: (M, 3) of the node and its neighbours.
        residual: (M, 3) white. slope: (M, 3) its derivative by the delay.
    """

    index: NDArray[np.intp]
    middle: NDArray[np.intp]
    weights: Array
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
    counts = np.diff(np.append(cut.first_node, len(cut)))
    start = cut.first_node[poses.segment]
    place = (poses.time + delay - cut.time[start]) / cut.step
    nearest = np.clip(np.round(place), 1, counts[poses.segment] - 2).astype(np.intp)
    share = place - nearest
    inside = np.flatnonzero(np.abs(share) <= 1.0)
    share, middle = share[inside], (start + nearest)[inside]
    weights = np.stack(
        [0.5 * (0.5 - share) ** 2, 0.75 - share**2, 0.5 * (0.5 + share) ** 2], axis=1
    )
    slopes = np.stack([share - 0.5, -2.0 * share, share + 0.5], axis=1) / cut.step
    near = np.stack([nodes[middle + k, :3] for k in (-1, 0, 1)], axis=1)
    residual = (np.einsum("mk,mki->mi", weights, near) - poses.value[inside]) / poses.std
    slope = np.einsum("mk,mki->mi", slopes, near) / poses.std
    return SeenPoses(inside, middle, weights, residual, slope)


def add_local(
    equations: Cost, nodes: Array, first: int, keep: Array, std: Array, variation: float
) -> None:
    """Add rows e_k+1 = keep_k e_k + std_k w of local friction, and e_0 = variation w.

    Args:
        equations: to be extended.
        nodes: (N, b) control points, then local friction from the number `first` on.
        first: number with which it begins.
        keep: (N - 1,) factor by which it lasts to the next node.
        std: (N - 1,) of its change.
        variation: standard deviation where nothing is before it.
    """
    local = nodes[:, first:]
    weights = np.zeros((*local.shape, 3))
    weights[1:, :, 0] = -(keep / std)[:, None]
    weights[1:, :, 1] = (1.0 / std)[:, None]
    weights[0, :, 1] = 1.0 / variation
    residual = local * weights[:, :, 1]
    residual[1:] += local[:-1] * weights[1:, :, 0]
    equations.add_separate(np.arange(len(nodes)), residual, weights, first)


def add_smoothness(equations: Cost, nodes: Array, middle: NDArray[np.intp], spread: Array) -> None:
    """Add second differences of the motion around some nodes, with their std (R, 3)."""
    weights = np.array([1.0, -2.0, 1.0]) / spread[:, :, None]
    curve = nodes[middle - 1, :3] - 2.0 * nodes[middle, :3] + nodes[middle + 1, :3]
    equations.add_separate(middle, curve / spread, weights)
