"""Newton-Euler balance of one pushed link in single intervals, with whatever effects it has."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.effects.acting import Acting
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation
from tactile_dynamics_ros.core.planar.mechanics.linkage import applied, cross, turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch, tipping_shift
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.latent_model import Motion

NAMES = (
    "ln_product", "ln_mass", "com_x", "com_y", "ln_inertia", "push_height", "com_height",
    "point_x", "point_y", "ln_scale", "delay",
)  # fmt: skip
"""Numbers common to all intervals: ln of mass times friction (kg) and of the mass, centre of mass
from the footprint's centroid (m), ln of the inertia over that of an even plate, errors of the
height of the push and of the contact point (m), height of the centre of mass (m), ln of the size of
the part that carries, delay of the forces (s)."""
_SLIDING_SPEED, _SLIDING_SHARE = 0.02, 0.4
"""Speed of the footprint from which it slides all over, m/s, or as share of the fast tenth if that
is less. Slower intervals may stick in part."""

_OF_CELL = 0.28
"""Distance from a point over that of neighbours, whose speed softens its friction: half the radius
of a disc of its area, which is exact to second order far from the centre of rotation. At 0 single
intervals in which an object turns about a point stop whole fits."""


Friction = Callable[[Array, Array, float], Array]
"""Wrench (N, 3) on the object per newton of load times coefficient, about the centroid, link axes,
from the twist (N, 3) there, the centre of pressure (N, 2) from it, and the scale."""


@dataclass(frozen=True, eq=False)
class LinearFriction:
    """`Friction` to first order.

    Attributes:
        base: (N, 3) wrench at `around`. slope: (N, 3, 6) its derivative.
        around: (N, 6) twist, centre of pressure, and scale.
    """

    base: Array
    slope: Array
    around: Array

    def __call__(self, twist: Array, centre: Array, scale: float) -> Array:
        """Wrench (N, 3)."""
        change = np.column_stack([twist, centre, np.full(len(twist), scale)]) - self.around
        return np.asarray(self.base + applied(self.slope, change))

    def repeated(self, times: int) -> LinearFriction:
        """Of all intervals that often, one after the other."""
        return LinearFriction(
            np.tile(self.base, (times, 1)),
            np.tile(self.slope, (times, 1, 1)),
            np.tile(self.around, (times, 1)),
        )


@dataclass(frozen=True, eq=False)
class _State:
    """How the link moves and rests, given what acts."""

    situation: Situation
    com_acceleration: Array
    arm: Array
    normal: Array
    twist: Array
    centre: Array
    numbers: Array


def measured_situation(cut: Intervals, at: NDArray[np.intp], gravity: Array) -> Situation:
    """What was measured in some intervals, of an object of 1 kg about its centroid."""
    return Situation(
        time=cut.time[at],
        force=cut.force[at],
        expected=cut.expected[at],
        expected_rate=cut.expected_rate[at],
        point=cut.point[at],
        facing=cut.facing[at],
        touching=cut.touching[at],
        gravity=gravity,
        mass=np.ones(len(at)),
        com=np.zeros((len(at), 2)),
    )


@dataclass(frozen=True, eq=False)
class Balance:
    """Forces and torque that are lacking in some intervals.

    Attributes:
        intervals: forces and contact points. at: (R,) which of them.
        patch: footprint. gravity: (3,) m/s^2. middle: (2,) m, mean place of the centroid.
        effects: of the model; their parameters follow the common numbers.
    """

    intervals: Intervals
    at: NDArray[np.intp]
    patch: SupportPatch
    gravity: Array
    middle: Array
    effects: tuple[PushEffect, ...] = ()

    def lack(self, kinematics: Motion, common: Array, friction: Friction) -> Array:
        """(R, 3) force, N, and torque about the contact, N m, that are lacking."""
        state = self._state(kinematics, common)
        numbers, mass = state.numbers, state.situation.mass
        yaw = kinematics.pose[:, 2]
        acting = self._acting(common)
        motion = self.motion(kinematics) if self.effects else None
        rise = acting.rise(motion) if motion else np.zeros((len(yaw), 2))
        centre = state.centre + rise @ self.patch.second_moments
        unit = friction(state.twist, centre, float(np.exp(numbers[9])))
        coefficient = float(np.exp(numbers[0] - numbers[1]))
        more = kinematics.local[:, 0] + np.sum(rise * state.centre, axis=1)
        load = coefficient * state.normal * (1.0 + more)
        support = turned(unit[:, :2] * load[:, None], yaw)
        spin = unit[:, 2] * load
        if motion:
            support, spin = acting.resisted(motion, support, spin)
        from_point = state.arm - turned(state.situation.com, yaw)
        torque = spin + cross(from_point, support)
        inertia = mass * self.patch.gyration * np.exp(numbers[4])
        pull = mass[:, None] * (state.com_acceleration - state.situation.gravity[:2])
        force = pull - state.situation.force[:, :2] - support
        turning = inertia * kinematics.acceleration[:, 2] + cross(state.arm, pull)
        return np.column_stack([force, turning - torque - self.intervals.torque[self.at]])

    def feet(self, kinematics: Motion) -> Array:
        """Places (R, n, 2) of the points that carry, m, axes of the support."""
        offset = self.patch.centroid + self.patch.offset
        yaw = np.repeat(kinematics.pose[:, 2], len(offset))
        arms = turned(np.tile(offset, (len(kinematics.pose), 1)), yaw)
        return np.asarray(kinematics.pose[:, None, :2] + arms.reshape(-1, len(offset), 2))

    def lack_by_shares(
        self, kinematics: Motion, common: Array, slip: float, shares: Iterable[Array]
    ) -> Array:
        """Change (R, 3, K) of `lack` by relative changes of friction (R, n) under the points."""
        state = self._state(kinematics, common)
        scale = np.full(len(state.twist), float(np.exp(state.numbers[9])))
        weight = float(np.exp(state.numbers[0] - state.numbers[1])) * state.normal
        load = self.patch.pressure(state.centre, scale) * weight[:, None]
        yaw = kinematics.pose[:, 2]
        arm = state.arm - turned(state.situation.com, yaw)
        changes = []
        for share in shares:
            wrench = self._wrench(load * share, scale, state.twist, slip)
            force = turned(wrench[:, :2], yaw)
            changes.append(-np.column_stack([force, wrench[:, 2] + cross(arm, force)]))
        return np.stack(changes, axis=2)

    def lack_by_face(
        self, kinematics: Motion, common: Array, slip: float, uneven: float, aside: float
    ) -> Array:
        """Changes (R, 3, n + 2) of `lack` by a face that carries elsewhere within its outline.

        Each point bears more by `uneven`, relative, at the same load and centre of pressure; and
        the whole that carries lies aside along x and y by `aside` radii of gyration, the centre of
        mass staying where it is.
        """
        state, patch = self._state(kinematics, common), self.patch
        scale = np.full(len(state.twist), float(np.exp(state.numbers[9])))
        pressure = patch.pressure(state.centre, scale)
        shares = patch.balanced(pressure, uneven * np.eye(pressure.shape[1]))
        changes = [self.lack_by_shares(kinematics, common, slip, shares)]
        here = self.lack(kinematics, common, self.friction(slip))
        for shift in aside * np.sqrt(patch.gyration) * np.eye(2):
            there = replace(self, patch=replace(patch, outline=patch.outline + shift))
            moved = common - np.pad(shift, (2, len(common) - 4))
            after = there.lack(kinematics, moved, there.friction(slip))
            changes.append((after - here)[:, :, None])
        return np.concatenate(changes, axis=2)

    def friction(self, slip: float) -> Friction:
        """Friction as it is."""

        def wrench(twist: Array, centre: Array, scale: float) -> Array:
            scales = np.full(len(twist), scale)
            return self._wrench(self.patch.pressure(centre, scales), scales, twist, slip)

        return wrench

    def _wrench(self, load: Array, scale: Array, twist: Array, slip: float) -> Array:
        """Friction (R, 3) of points that stand for cells of an even face.

        Each point slips as if by the mean motion of its cell: where the object turns about one,
        its friction does not jump.
        """
        within = _OF_CELL * self.patch.spacing * twist[:, 2:]
        matrix = self.patch.resistance(load, scale, twist, np.hypot(slip, within))
        return -applied(matrix, twist)

    def linear_friction(self, kinematics: Motion, common: Array, slip: float) -> LinearFriction:
        """Friction to first order around the present motion.

        The wrench is linear in the load, which is linear in the centre over the scale while the
        same points carry.
        """
        state = self._state(kinematics, common)
        twist = state.twist
        scale = np.full(len(twist), float(np.exp(state.numbers[9])))
        load, by_centre = self.patch.pressure_and_slope(state.centre, scale)

        wrench = partial(self._wrench, slip=slip)
        base = wrench(load, scale, twist)
        slopes = [
            (wrench(load, scale, twist + h * row) - base) / h
            for h, row in zip((1e-6, 1e-6, 1e-5), np.eye(3), strict=True)
        ]
        along = [wrench(by_centre[:, :, axis], scale, twist) for axis in (0, 1)]
        wider = (wrench(load, scale + 1e-5, twist) - base) / 1e-5
        share = state.centre / scale[:, None]
        slopes += [*along, wider - along[0] * share[:, :1] - along[1] * share[:, 1:]]
        around = np.column_stack([twist, state.centre, scale])
        return LinearFriction(base, np.stack(slopes, axis=2), around)

    def _acting(self, common: Array) -> Acting:
        return Acting(self.effects, common[len(NAMES) :])

    def numbers(self, common: Array) -> Array:
        """The common numbers with what effects add to them."""
        return self._acting(common).numbers(common[: len(NAMES)], NAMES)

    @cached_property
    def _measured(self) -> Situation:
        return measured_situation(self.intervals, self.at, self.gravity)

    def _situation(self, common: Array, numbers: Array) -> Situation:
        situation = replace(
            self._measured,
            mass=np.full(len(self.at), float(np.exp(numbers[1]))),
            com=np.broadcast_to(numbers[2:4], (len(self.at), 2)),
        )
        return self._acting(common).changed(situation)

    def motion(self, kinematics: Motion) -> PlanarMotion:
        """Motion of the footprint's centroid."""
        yaw, rate = kinematics.pose[:, 2], kinematics.velocity[:, 2]
        offset = turned(np.broadcast_to(self.patch.centroid, (len(yaw), 2)), yaw)
        across = np.stack([-offset[:, 1], offset[:, 0]], axis=1)
        return PlanarMotion(
            time=self.intervals.time[self.at],
            place=kinematics.pose[:, :2] + offset,
            velocity=kinematics.velocity[:, :2] + rate[:, None] * across,
            yaw=yaw,
            rate=rate,
            gyration=self.patch.gyration,
            middle=self.middle,
        )

    def _state(self, kinematics: Motion, common: Array) -> _State:
        numbers = self.numbers(common)
        situation = self._situation(common, numbers)
        yaw, rate = kinematics.pose[:, 2], kinematics.velocity[:, 2:]
        com = turned(self.patch.centroid + situation.com, yaw)
        across = np.stack([-com[:, 1], com[:, 0]], axis=1)
        acceleration = kinematics.acceleration[:, :2] - rate**2 * com
        acceleration = acceleration + kinematics.acceleration[:, 2:] * across
        arm = kinematics.pose[:, :2] + com - situation.point[:, :2] - numbers[7:9]
        arm = np.where(situation.touching[:, None], arm, 0.0)
        weight = -situation.mass * situation.gravity[2]
        normal = np.maximum(weight - situation.force[:, 2], 0.1 * weight)
        centre = self._centre(kinematics, situation, numbers, acceleration, arm, normal)
        offset = turned(np.broadcast_to(self.patch.centroid, (len(yaw), 2)), yaw)
        aside = np.stack([-offset[:, 1], offset[:, 0]], axis=1)
        linear = turned(kinematics.velocity[:, :2] + rate * aside, -yaw)
        twist = np.concatenate([linear, rate], axis=1)
        return _State(situation, acceleration, arm, normal, twist, centre, numbers)

    def _centre(
        self,
        kinematics: Motion,
        situation: Situation,
        numbers: Array,
        acceleration: Array,
        arm: Array,
        normal: Array,
    ) -> Array:
        """Centre of pressure (R, 2) from the centroid, m, axes of the link."""
        external = situation.force[:, :2]
        pull = acceleration - situation.gravity[:2]
        support = situation.mass[:, None] * pull - external
        height = np.full(len(arm), numbers[6])
        above = situation.point[:, 2] + numbers[5]
        shift = tipping_shift(normal, height, support, external, above)
        shift = shift + situation.force[:, 2:] * arm / normal[:, None]
        moved = situation.com + turned(shift, -kinematics.pose[:, 2])
        return np.asarray(moved + kinematics.local[:, 1:] * np.sqrt(self.patch.gyration))


def _foot_speed(patch: SupportPatch, kinematics: Motion) -> Array:
    """Root mean square speed (N,) of the footprint, m/s."""
    yaw, rate = kinematics.pose[:, 2], kinematics.velocity[:, 2]
    x, y = patch.centroid
    u = kinematics.velocity[:, 0] - rate * (np.sin(yaw) * x + np.cos(yaw) * y)
    v = kinematics.velocity[:, 1] + rate * (np.cos(yaw) * x - np.sin(yaw) * y)
    return np.asarray(np.sqrt(u * u + v * v + patch.gyration * rate * rate))


def foot_speeds(cut: Intervals, patch: SupportPatch, nodes: Array) -> Array:
    """Root mean square speed (N,) of the footprint at nodes (N, b), m/s; 0 at ends of segments."""
    speed = np.zeros(len(cut))
    middle = np.flatnonzero(cut.inner)
    speed[middle] = _foot_speed(patch, Motion.of_nodes(nodes, middle, cut.step, 3))
    return speed


def around(flags: NDArray[np.bool_], distance: int) -> NDArray[np.bool_]:
    """Flags (N,) of intervals within a distance of those that are flagged."""
    rolled = [np.roll(flags, k) for k in range(-distance, distance + 1)]
    return np.asarray(np.any(rolled, axis=0))


def sliding(cut: Intervals, patch: SupportPatch, nodes: Array) -> NDArray[np.bool_]:
    """Intervals that slide all over, but for those next to a touch or a release."""
    speed = foot_speeds(cut, patch, nodes)
    fast = float(np.percentile(speed[cut.touching], 90))
    slides = (speed > min(_SLIDING_SPEED, _SLIDING_SHARE * fast)) & cut.measured & cut.inner
    change = np.diff(cut.touching.astype(int), prepend=0) != 0
    return np.asarray(slides & ~around(change, 1))
