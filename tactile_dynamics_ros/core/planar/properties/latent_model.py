"""What the models of one pushed part and of two share: a latent motion, and friction that varies.

The motion has D coordinates with one control point per interval of a quadratic B-spline, so that
accelerations are constant over an interval. Beside it each node carries how friction differs there
from its mean, and how the centre of pressure does; both vary over the distance travelled.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.bordered import (
    Cost,
    Factor,
    NormalEquations,
    Solution,
    minimise,
)
from tactile_dynamics_ros.core.planar.effects.acting import ends
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals, add_smoothness

Mask = NDArray[np.bool_]

USUAL_FRICTION, FRICTION_SPREAD = 0.3, 0.6
"""Median of friction coefficients and standard deviation of their logarithm before any data: 68 %
between 0.16 and 0.55, from Teflon to wood. It is all that is said of the mass where nothing
accelerates; half the spread would make such masses look known to 30 %."""
INERTIA_SPREAD = 0.3
"""Standard deviation of ln(inertia over that of an even plate): a rim has 1.5 to 2 times that of a
plate, a solid lump in the middle half of it. Wider changes masses of shapely objects by little."""
HEIGHT_STD, POINT_STD = 2e-3, 5e-4
"""What the height and the place of the push are off by, m: of a calibrated arm. An unstated error
of 5 mm in height shifts the mass by 12 % and leaves no trace in the residuals."""
SCALE_SPREAD = 0.03
"""Standard deviation of ln(size of the part that carries over the footprint): of flat faces. Feet
or a rim are an effect of their own."""
DELAY_STD = 5e-3
"""Delay between the clocks of force and pose, s: half a sample at 100 Hz."""
PRODUCT_SPREAD = 3.0
"""Standard deviation of the logarithm of a product before the data: none to speak of."""
MODEL_ERROR = 0.003
"""Error of the equations of motion over the typical force; it is all the noise that the balance of
an untouched part has. At a third of it the fit needs twice as many steps."""
ELSEWHERE = np.array([2.0, 1.2, 1.2])
"""Std of friction and of its centre at the places of a recording about those of the table, over the
RMS by which those places differ: on ten recordings made for tuning, each over a few lengths of it.
At 0 products on uneven tables were up to 13 std off; larger widens intervals."""
TOLERANCE = 3e-2
"""Fall of the cost (twice the log probability) that is immaterial: 0.03 of a std squared; at a
third of it fits take twice as long and move by less than 0.1 std."""
_LOCAL_SCALE = 0.01
"""Size of local friction, in whose inverse square its damping is counted; none of a result."""
_VOLUME_STEP = 0.02
"""Change of a logarithm for a difference quotient; half or double changes slopes by 1 %."""
_LOOSE = 1e-6
"""Information on every node beside the data, in units of one pose: places that nothing tells, such
as those of nodes before the first pose. A millionth changes no interval."""
_DISTANCE = 0.02
"""Distance over which friction stays alike, m: grain and wear of tables. Twice as long widens
products of short pushes by 1.3."""
STEPS = {"pose": 1e-6, "velocity": 1e-5, "acceleration": 1e-3, "local": 1e-5}
"""Changes for difference quotients, m, m/s, m/s^2 and 1: a thousandth of their noise, a thousand
times what rounding makes."""


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


@dataclass(frozen=True)
class Motion:
    """Coordinates (R, D), their velocities and accelerations, and how friction differs (R, l)."""

    pose: Array
    velocity: Array
    acceleration: Array
    local: Array

    @classmethod
    def of_nodes(cls, nodes: Array, middle: NDArray[np.intp], step: float, size: int) -> Motion:
        """At the middle of intervals, from nodes (N, D + l) of control points and friction."""
        before, here, after = (nodes[middle + k, :size] for k in (-1, 0, 1))
        return cls(
            (before + 6.0 * here + after) / 8.0,
            (after - before) / (2.0 * step),
            (before - 2.0 * here + after) / step**2,
            nodes[middle, size:],
        )

    def shifted(self, name: str, axis: int) -> Motion:
        """With one column changed by `STEPS`."""
        columns = {n: getattr(self, n) for n in STEPS}
        columns[name] = columns[name].copy()
        columns[name][:, axis] += STEPS[name]
        return Motion(**columns)

    def moved(self, steps: Array) -> Motion:
        """(K R): all intervals with the first of the K numbers moved by a step, and so on."""
        parts = [getattr(self, name) for name in STEPS]
        values = np.concatenate(parts, axis=1) + np.diag(steps)[:, None, :]
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        return Motion(*np.split(values.reshape(-1, len(steps)), ends, axis=1))


@dataclass(frozen=True, eq=False)
class PushData:
    """What a model of pushed parts is made from.

    Attributes:
        intervals: forces and poses. patches: footprint of each part. gravity: (3,) m/s^2.
        com_height, com_height_std: m, of each part before the data.
        mask: (N,) intervals whose equations count; elsewhere the motion is smooth.
        spread: (N, D) accelerations allowed there. travelled: (N - 1,) m between nodes.
    """

    intervals: Intervals
    patches: tuple[SupportPatch, ...]
    gravity: Array
    com_height: Array
    com_height_std: Array
    mask: Mask
    spread: Array
    travelled: Array


@dataclass(frozen=True, eq=False)
class LatentModel(ABC):
    """Residuals of pushed parts on a latent motion.

    Attributes:
        data: what was measured.
        effects: of the model; their parameters follow the common numbers.
        names: of the common numbers. freedoms: D coordinates, and as many equations.
        locals: l numbers of friction at each node.
        scalings: names of the numbers with which the volume of motions changes.
    """

    data: PushData
    effects: tuple[PushEffect, ...] = field(default=(), kw_only=True)
    names: ClassVar[tuple[str, ...]]
    freedoms: ClassVar[int]
    locals: ClassVar[int]
    scalings: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def own_prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers."""

    @abstractmethod
    def misfit(self, nodes: Array, common: Array, sharp: Sharpness) -> Array:
        """White residuals (R, D) of the equations of `middle`."""

    @abstractmethod
    def dynamics(self, nodes: Array, common: Array, sharp: Sharpness) -> tuple[Array, Array, Array]:
        """`misfit`, its derivative by nodes (R, D, 3, D + l) and by numbers (R, D, p)."""

    @abstractmethod
    def add_poses(self, equations: Cost, nodes: Array, common: Array) -> None:
        """Add what was seen of the poses."""

    @abstractmethod
    def add_prior(self, equations: Cost, common: Array) -> None:
        """Add what is known of the numbers beforehand."""

    @property
    def intervals(self) -> Intervals:
        """Forces and poses."""
        return self.data.intervals

    @cached_property
    def middle(self) -> NDArray[np.intp]:
        """Nodes whose equations count."""
        return np.flatnonzero(self.data.mask & self.intervals.inner)

    @cached_property
    def typical_force(self) -> float:
        """Median horizontal force while something is touched, N."""
        cut = self.intervals
        return float(np.median(np.linalg.norm(cut.force[cut.touching, :2], axis=1)))

    @cached_property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers and of the effects' parameters."""
        mean, std = self.own_prior
        more = [p.prior_std for effect in self.effects for p in effect.parameters]
        return np.append(mean, np.zeros(len(more))), np.append(std, more)

    def at(self, name: str) -> int:
        """Place of a common number."""
        return self.names.index(name)

    @cached_property
    def delayers(self) -> list[int]:
        """Places of all numbers that delay the stamps of the forces."""
        starts = len(self.names) + ends(self.effects)
        added = [int(k) for k, e in zip(starts, self.effects, strict=True) if e.adds_to == "delay"]
        return [self.at("delay"), *added]

    def motion_of(self, nodes: Array) -> Motion:
        """Motion of the intervals that count."""
        return Motion.of_nodes(nodes, self.middle, self.intervals.step, self.freedoms)

    def linearise(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> NormalEquations:
        """Normal equations of dynamics, poses, local friction, prior and `volume_slope`."""
        equations = self.equations_of_motion(nodes, common, sharp)
        self.add_seen(equations, nodes, common, sharp, slope)
        return equations

    def cost(
        self, nodes: Array, common: Array, sharp: Sharpness, slope: Array | None = None
    ) -> float:
        """Cost of `linearise` without most of its derivatives."""
        total = Cost()
        total.count(self.misfit(nodes, common, sharp))
        self._add_smoothness(total, nodes)
        self.add_seen(total, nodes, common, sharp, slope)
        return total.cost

    def add_seen(
        self,
        equations: Cost,
        nodes: Array,
        common: Array,
        sharp: Sharpness,
        slope: Array | None = None,
    ) -> None:
        """Add all but the dynamics."""
        if slope is not None:
            equations.add_slope(slope, common)
        self.add_poses(equations, nodes, common)
        self._add_local(equations, nodes, sharp)
        self.add_prior(equations, common)

    def equations_of_motion(self, nodes: Array, common: Array, sharp: Sharpness) -> NormalEquations:
        """Normal equations of the dynamics alone, and of smoothness where they do not count."""
        equations = NormalEquations(len(nodes), nodes.shape[1], len(common))
        equations.add(self.middle, *self.dynamics(nodes, common, sharp))
        self._add_smoothness(equations, nodes)
        return equations

    def _add_smoothness(self, equations: Cost, nodes: Array) -> None:
        cut = self.intervals
        elsewhere = np.flatnonzero(~self.data.mask & cut.inner)
        spread = self.data.spread[elsewhere] * cut.step**2
        add_smoothness(equations, nodes[:, : self.freedoms], elsewhere, spread)

    def _add_local(self, equations: Cost, nodes: Array, sharp: Sharpness) -> None:
        """Rows e_k+1 = rho e_k + sigma sqrt(1 - rho^2) w and e_0 = sigma w of local friction."""
        keep, std = self.memory(sharp)
        local = nodes[:, self.freedoms :]
        weights = np.zeros((*local.shape, 3))
        weights[1:, :, 0] = -(keep / std)[:, None]
        weights[1:, :, 1] = (1.0 / std)[:, None]
        weights[0, :, 1] = 1.0 / sharp.variation
        residual = local * weights[:, :, 1]
        residual[1:] += local[:-1] * weights[1:, :, 0]
        equations.add_separate(np.arange(len(nodes)), residual, weights, self.freedoms)

    def memory(self, sharp: Sharpness) -> tuple[Array, Array]:
        """Factor (N - 1,) by which local friction lasts to the next node, and std of its change.

        rho = exp(-distance / 20 mm).
        """
        keep = np.exp(-np.maximum(self.data.travelled, 1e-6) / _DISTANCE)
        return keep, sharp.variation * np.sqrt(1.0 - keep**2)

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
        self.add_seen(equations, nodes, common, sharp)
        return 0.5 * (caused - equations.log_determinant_of_nodes(loose, nodes.shape[1]))

    def log_jacobian(self, nodes: Array, common: Array, sharp: Sharpness) -> float:
        """Logarithm of |det J|, see `volume_slope`: of what the forces cause by the motion."""
        loose = np.broadcast_to(self.loosening, nodes.shape)
        equations = self.equations_of_motion(nodes, common, sharp)
        return 0.5 * equations.log_determinant_of_nodes(loose, self.freedoms)

    @cached_property
    def node_scale(self) -> Array:
        """(D + l,) sizes of the nodes' numbers, in whose inverse squares damping is counted."""
        std = self.intervals.poses[0].std
        return np.append(std[[0, 1, 2, 2][: self.freedoms]], np.full(self.locals, _LOCAL_SCALE))

    @property
    def loosening(self) -> Array:
        """(D + l,) information on every node beside the data."""
        motion = np.arange(len(self.node_scale)) < self.freedoms
        return np.asarray(_LOOSE / np.square(self.node_scale) * motion)

    def factor(self, equations: NormalEquations) -> Factor:
        """Factor of normal equations, with the information that lies on every node."""
        loose = np.broadcast_to(self.loosening, (equations.nodes, equations.size))
        return equations.factor(loose, np.zeros(equations.common))

    def evidence(self, sharp: Sharpness, cost: float, factor: Factor) -> float:
        """Log probability of the data, integrated over motion and numbers, up to a constant."""
        _, std = self.memory(sharp)
        volume = self.locals * (float(np.sum(np.log(std))) + np.log(sharp.variation))
        return float(-0.5 * (cost + factor.log_determinant) - volume)

    def minimised(
        self,
        nodes: Array,
        common: Array,
        sharp: Sharpness,
        iterations: int,
        slope: Array | None = None,
    ) -> Solution:
        """Optimum of `cost` from a motion and common numbers."""
        linearise = partial(self.linearise, sharp=sharp, slope=slope)
        cost = partial(self.cost, sharp=sharp, slope=slope)
        scales = self.node_scale, self.prior[1]
        return minimise(linearise, nodes, common, *scales, iterations, TOLERANCE, cost)
