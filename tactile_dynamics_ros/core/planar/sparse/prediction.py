"""What the mechanics say of pushes: where each ends, its force, its work."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.mechanics.linkage import Link, Linkage, turned
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import (
    GRAVITY,
    PlanarSimulation,
    StepConfig,
)
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.sparse.pushes import STEADY, STEPS, Pushes
from tactile_dynamics_ros.core.planar.streams import PushContact, PushedStreams

_INTERVAL = 0.04
"""Length of the intervals whose ways are added up, s. At 10 ms the noise of poses (0.1 mm) adds 3 %
to the way of a foot; at 0.1 s paths that bend are 1 % too short."""
_MOVES = 1e-3
"""Way of a foot in an interval, m, from which the object moves (25 mm/s): of slower intervals, work
and way are left out, as noise is all that a resting object seems to move. Pushes at 25 to 40 mm/s
would come out 20 % too low; `fit_sparse` is for those."""
_ABOVE_NOISE = 4.0
"""Way over the stated noise of poses from which the object moves; noise of 0.5 mm at rest looks
like ways of up to 1.5 mm."""


def product_between_rests(streams: PushedStreams) -> float:
    """Product q = m mu g, N, as work of the contacts over the way that friction resists.

    q = sum F . dx / sum p_i |dx_i|: kinetic energy is the same (none) before and after, so that
    neither mass nor accelerations are needed. The pressure is taken as even.

    Raises:
        NotIdentifiableError: the object does not move, or nothing pushes it while it does.
    """
    link = streams.links[0]
    count = max(2, int((link.time[-1] - link.time[0]) / _INTERVAL))
    time = np.linspace(link.time[0], link.time[-1], count)
    pose = np.stack([np.interp(time, link.time, part) for part in link.pose.T], axis=1)
    patch = SupportPatch(np.asarray(link.footprint, dtype=np.float64))
    feet = [_ways(pose, np.tile(point, (count, 1))) for point in patch.offset + patch.centroid]
    travel = patch.share @ np.linalg.norm(feet, axis=2)
    noise = 0.0 if link.pose_std is None else float(link.pose_std[0])
    moves = travel > max(_MOVES, _ABOVE_NOISE * noise)
    work = sum(_work(contact, time, pose) for contact in streams.contacts.values())
    done = float(np.sum(work * moves))
    if done <= 0.0:
        raise NotIdentifiableError(
            f"contacts do {done:.2g} J on the object, expected more than none; push it, and check "
            "the sign of forces (on the object) and their frame"
        )
    return done / float(travel[moves].sum())


def _work(contact: PushContact, time: Array, pose: Array) -> Array:
    """Work (N - 1,) of a contact in each interval, J."""
    place = np.stack([np.interp(time, contact.pose_time, p) for p in contact.point.T[:2]], axis=1)
    own = turned(place - pose[:, :2], -pose[:, 2])
    middle = 0.5 * (own[:-1] + own[1:])
    way = _ways(pose, np.concatenate([middle, middle[-1:]]))
    force = np.zeros((len(time) - 1, 2))
    slot = np.searchsorted(time, contact.time, side="right") - 1
    inside = (slot >= 0) & (slot < len(force))
    np.add.at(force, slot[inside], contact.force[inside, :2])
    samples = np.bincount(slot[inside], minlength=len(force)).clip(1)
    return np.asarray(np.sum(force / samples[:, None] * way, axis=1))


def _ways(pose: Array, point: Array) -> Array:
    """Ways (N - 1, 2) of points (N, 2) of the link during each interval."""
    before = pose[:-1, :2] + turned(point[:-1], pose[:-1, 2])
    return np.asarray(pose[1:, :2] + turned(point[:-1], pose[1:, 2]) - before)


NAMES = ("ln_product", "com_x", "com_y", "ln_scale", "ln_tip_friction", "ln_mass")
"""Numbers common to all pushes: q = m mu g in N, m, m, size of the carrying part over that of the
footprint, friction coefficient of the pusher, kg."""
RESIDUALS = ("ln_work", "force_angle", "slip", "yaw")
"""Residuals of one push: logarithm of the work over that of friction, angle of the force (rad),
slip along the edge (m), yaw (rad)."""
_STIFFNESS = 2e4
"""Stiffness of tip and arm, N/m. At a tenth the object stays back by 2 mm under 4 N; ten times more
needs shorter steps."""
_LEAST_FORCE = 0.05
"""Measured force over q below which a push is taken as lost: logarithms of none are not finite. At
0.2 pushes that pivot about a foot would be cut."""
_DIFFERENCES = np.array([0.0, 1e-3, 1e-3, 0.02, 0.05, 0.05])
"""Steps of the differences for the derivatives: far above what rounds leave, far below a std. The
product has none: the motion does not depend on it."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """Residuals (V, K, 4) of V variants of the common numbers, by `RESIDUALS`."""

    pushes: Pushes
    patch: SupportPatch
    outline: Array

    def residuals(self, common: Array) -> Array:
        """Measured less predicted, (V, K, 4); NaN where no force was measured.

        Args:
            common: (V, 6) by `NAMES`.
        """
        end, force = self._integrate(common)
        p = self.pushes
        normal = turned(p.normal, p.end[:, 2])
        tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        drag = np.maximum(p.drag, _LEAST_FORCE * np.exp(common[:, :1]))
        drag = drag / (np.exp(common[:, :1]) * self.foot_travel(common) / p.way)
        turn = _angle(p.force, normal, tangent) - _angle(force, normal, tangent)
        slip = np.einsum("vki,ki->vk", self._touched(p.end) - self._touched(end), tangent)
        yaw = p.end[:, 2] - end[..., 2]
        return np.stack([np.log(drag), np.arctan2(np.sin(turn), np.cos(turn)), slip, yaw], axis=2)

    def linearised(self, common: Array) -> tuple[Array, Array]:
        """Residuals (K, 4) and derivatives (K, 4, 6) at common numbers (6,)."""
        moved = np.flatnonzero(_DIFFERENCES)
        if not self.pushes.height.any():
            moved = moved[:-1]
        variants = np.tile(common, (len(moved) + 1, 1))
        variants[np.arange(len(moved)) + 1, moved] += _DIFFERENCES[moved]
        found = self.residuals(variants)
        slope = np.zeros((*found.shape[1:], len(NAMES)))
        slope[:, :, moved] = np.moveaxis((found[1:] - found[0]), 0, -1) / _DIFFERENCES[moved]
        slope[:, 0, 0] = -1.0
        return found[0], slope

    def foot_travel(self, common: Array) -> Array:
        """Way (V, K) of the load from pose to pose, m, which friction resists with q.

        sum p_i |d_i| (t / 2) / sin(t / 2) with chords d_i of the points and the turn t: exact where
        the object turns about a fixed point. Work over q tells friction without the direction of
        the force, so that friction that varies within the footprint hardly matters.
        """
        p, share = self.pushes, self.load(common)
        points = np.exp(common[:, 3])[:, None, None] * self.patch.offset + self.patch.centroid
        turns = p.end[:, 2] - p.start[:, 2]
        chord = (p.end - p.start)[None, None, :, :2] + (
            _placed(points[:, :, None], p.end[:, 2]) - _placed(points[:, :, None], p.start[:, 2])
        )
        length = np.einsum("vi,vik->vk", share, np.linalg.norm(chord, axis=-1))
        return np.asarray(length / np.sinc(turns / (2.0 * np.pi)))

    def load(self, common: Array) -> Array:
        """Shares (V, n) of the load on the points of the support at rest."""
        return self.patch.pressure(common[:, 1:3] - self.patch.centroid, np.exp(common[:, 3]))

    def _touched(self, pose: Array) -> Array:
        """Places of the material point that is touched at the end, by poses (..., K, 3)."""
        return np.asarray(pose[..., :2] + _placed(self.pushes.touched, pose[..., 2]))

    def _integrate(self, common: Array) -> tuple[Array, Array]:
        """Poses (V, K, 3) at the end and mean forces (V, K, 2) of the steady part."""
        variants, count = len(common), len(self.pushes)
        path = np.pad(np.tile(self.pushes.path, (variants, 1, 1)), ((0, 0), (0, 0), (0, 1)))
        each = np.repeat(common, count, axis=0)
        height = np.tile(self.pushes.height, variants)
        mass = np.exp(each[:, 5])
        link = Link(
            patch=self.patch,
            mass=mass,
            friction=np.exp(each[:, 0]) / (mass * GRAVITY),
            com=each[:, 1:3],
            com_height=height,
            inertia=np.ones_like(mass),
            scale=np.exp(each[:, 3]),
        )
        tip = Tip(self.outline, height, np.exp(each[:, 4]), stiffness=_STIFFNESS, damping=0.0)
        start = np.tile(self.pushes.start, (variants, 1))[:, None]
        simulation = PlanarSimulation(Linkage((link,)), tip, start, StepConfig(quasi_static=True))
        force, steady = np.zeros((variants * count, 2)), range(int(STEADY * STEPS), STEPS)
        for k in range(STEPS):
            simulation.step(path[:, k], path[:, k + 1])
            if k in steady:
                force += simulation.wrench[:, :2] / len(steady)
        end = simulation.linkage.frames(simulation.coordinates)[:, 0]
        return end.reshape(variants, count, 3), force.reshape(variants, count, 2)


def _angle(force: Array, normal: Array, tangent: Array) -> Array:
    along = np.einsum("...ki,ki->...k", force, normal)
    return np.asarray(np.arctan2(np.einsum("...ki,ki->...k", force, tangent), along))


def _placed(point: Array, yaw: Array) -> Array:
    """Points (..., 2) turned by yaws (...)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = point[..., 0], point[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)
