"""Tips and grippers of many scenes: where they are and with what force they touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.actions import Action
from tactile_dynamics_ros.synthetic.pushed.bodies import Bodies, perpendicular, rotation
from tactile_dynamics_ros.synthetic.pushed.implicit import Spring
from tactile_dynamics_ros.synthetic.pushed.scene import Scene

CONTACTS = ("pusher", "pad_left", "pad_right")
_GRASP = 0.03
"""s in which a gripper closes or opens."""


@dataclass(frozen=True)
class Touch:
    """Springs of the tips in the coming step."""

    springs: tuple[Spring, Spring]


def nearest_on_outline(corners: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points (B, 2) of outlines (B, K, 2) and the distances (B,) of points."""
    edge = np.roll(corners, -1, axis=1) - corners
    to_point = point[:, None] - corners
    length = np.maximum(np.sum(edge * edge, axis=-1), 1e-18)
    share = np.clip(np.sum(to_point * edge, axis=-1) / length, 0.0, 1.0)
    near = corners + share[..., None] * edge
    squared = np.sum((point[:, None] - near) ** 2, axis=-1)
    best = squared.argmin(axis=1)
    rows = np.arange(len(corners))
    return near[rows, best], np.sqrt(squared[rows, best])


class Pushers:
    """The pusher of each scene; a tip has a spring, a gripper holds two places of the object."""

    def __init__(self, scenes: Sequence[Scene], step: float) -> None:
        self._scenes, self._h = list(scenes), step
        b, steps = len(self._scenes), max(scene.steps for scene in self._scenes)
        self._path = np.zeros((b, steps + 1, 3))
        self._starts: dict[int, list[tuple[int, Action]]] = {}
        self._share = np.zeros((b, steps))
        for k, scene in enumerate(self._scenes):
            self._lay_out(k, scene)
        tips = [scene.tip for scene in self._scenes]
        for name in ("radius", "height", "stiffness", "shear_stiffness", "damping", "grip"):
            setattr(self, f"_{name}", np.array([getattr(tip, name) for tip in tips]))
        self.friction = np.array([tip.friction for tip in tips])
        self._frame, self._yaw = np.zeros((b, 2)), np.zeros(b)
        self._body, self._origin_shift = np.zeros(b, dtype=int), np.zeros((b, 2))
        self._pushes, self._pulls = np.zeros(b, dtype=bool), np.zeros(b, dtype=bool)
        most = max(len(link.corners) for scene in scenes for link in scene.thing.links)
        self._outline = np.zeros((b, most, 2))
        self._pad, self._hold = np.zeros((b, 2, 2)), np.zeros((b, 2, 2))
        self._part, self._sheared = np.zeros(b, dtype=int), np.zeros(b)

    def _lay_out(self, b: int, scene: Scene) -> None:
        """Put the paths of all actions of a scene one behind the other."""
        at = 0
        for action in scene.actions:
            count = len(action.path)
            self._starts.setdefault(at, []).append((b, action))
            self._path[b, at + 1 : at + 1 + count] = action.path
            if action.kind == "pull":
                ramp = _GRASP / self._h
                k = np.arange(count)
                closed = np.minimum(k, count - 1 - k) / ramp
                self._share[b, at : at + count] = np.clip(closed, 0.0, 1.0)
            at += count

    def begin(self, k: int, bodies: Bodies) -> None:
        """Place the pushers whose next action begins."""
        for b, action in self._starts.get(k, ()):
            thing = self._scenes[b].thing
            rigid = thing.kind == "rigid_pair"
            body = 0 if rigid else action.link
            shift = thing.offset if rigid and action.link == 1 else np.zeros(2)
            turn = rotation(bodies.angle[b, body])
            origin = bodies.origins()[b, body] + turn @ shift
            self._path[b, k] = 0.0
            self._body[b], self._part[b] = body, action.link
            self._yaw[b] = bodies.angle[b, body] + action.heading
            self._pushes[b], self._pulls[b] = action.kind == "push", action.kind == "pull"
            away = (self._radius[b] + action.gap) * action.normal if action.kind == "push" else 0.0
            self._frame[b] = origin + turn @ (action.point - away)
            corners = thing.links[action.link].corners + shift
            extra = len(self._outline[b]) - len(corners)
            self._outline[b] = np.concatenate([corners, np.repeat(corners[-1:], extra, axis=0)])
            axis = np.array([[-1.0], [1.0]]) * action.grip
            self._hold[b] = action.point + shift + axis * action.normal
            self._pad[b] = axis * np.array([1.0, 0.0])
            self._sheared[b] = 0.0

    def _pose(self, k: int) -> np.ndarray:
        """Return the pushers' poses (B, 3) at a step."""
        path = self._path[:, k]
        place = self._frame + np.einsum("bij,bj->bi", rotation(self._yaw), path[:, :2])
        return np.concatenate([place, (self._yaw + path[:, 2])[:, None]], axis=1)

    def touch(self, k: int, bodies: Bodies, mass: np.ndarray, momentum: np.ndarray) -> Touch:
        """Return the springs of the tips; what grippers do goes into mass matrix and momentum."""
        self._turn = rotation(bodies.angle[np.arange(len(self._body)), self._body])
        self._place = bodies.origins()[np.arange(len(self._body)), self._body]
        self._before, self._after = self._pose(k), self._pose(k + 1)
        springs = self._tip_springs(bodies)
        if self._pulls.any():
            self._add_grips(k, bodies, mass, momentum)
        else:
            self._let_go()
        return Touch(springs)

    def _let_go(self) -> None:
        b = len(self._body)
        self._pad_G = np.zeros((b, 2, 2, self._G.shape[-1]))
        self._pad_slope, self._pad_level = np.zeros((b, 2, 2)), np.zeros((b, 2, 2))
        self._pad_point, self._pad_normal = np.zeros((b, 2, 2)), np.zeros((b, 2, 2))

    def _velocities_at(self, bodies: Bodies, points: np.ndarray) -> np.ndarray:
        """Return (B, N, 2, D) of points (B, N, 2) of the bodies that are touched."""
        spread = np.repeat(points[:, None], bodies.links, axis=1)
        return bodies.velocities(spread)[np.arange(len(points)), self._body]

    def _tip_springs(self, bodies: Bodies) -> tuple[Spring, Spring]:
        h = self._h
        local = np.einsum("bji,bj->bi", self._turn, self._before[:, :2] - self._place)
        near, distance = nearest_on_outline(self._outline, local)
        inwards = (near - local) / np.maximum(distance, 1e-12)[:, None]
        self._normal = np.einsum("bij,bj->bi", self._turn, inwards)
        self._tangent = perpendicular(self._normal)
        self._point = self._place + np.einsum("bij,bj->bi", self._turn, near)
        self._G = self._velocities_at(bodies, near[:, None])[:, 0]
        self._tip_velocity = (self._after - self._before)[:, :2] / h
        depth = self._radius - distance
        damping = np.where(depth > 0.0, self._damping, 0.0)
        slope = self._stiffness * h + damping
        approach = np.sum(self._tip_velocity * self._normal, axis=1)
        level = np.where(self._pushes, self._stiffness * depth + slope * approach, -1.0)
        slope = np.where(self._pushes, slope, 0.0)
        along = np.einsum("bk,bkd->bd", self._normal, self._G)
        shear_slope = self._shear_stiffness * h + damping
        sliding = np.sum(self._tip_velocity * self._tangent, axis=1)
        shear_level = self._shear_stiffness * self._sheared + shear_slope * sliding
        across = np.einsum("bk,bkd->bd", self._tangent, self._G)
        return Spring(along, level, slope), Spring(across, shear_level, shear_slope)

    def _add_grips(self, k: int, bodies: Bodies, mass: np.ndarray, momentum: np.ndarray) -> None:
        h, share = self._h, self._share[:, k] * self._pulls
        self._pad_G = self._velocities_at(bodies, self._hold)
        self._pad_point = self._place[:, None] + np.einsum("bij,bnj->bni", self._turn, self._hold)
        places = [
            pose[:, None, :2] + np.einsum("bij,bnj->bni", rotation(pose[:, 2]), self._pad)
            for pose in (self._before, self._after)
        ]
        axis = self._hold[:, 1] - self._hold[:, 0]
        axis = axis / np.maximum(np.linalg.norm(axis, axis=1), 1e-12)[:, None]
        axis = np.einsum("bij,bj->bi", self._turn, axis)
        self._pad_normal = np.stack([axis, -axis], axis=1)
        outer = axis[:, :, None] * axis[:, None, :]
        flat = (np.eye(2) - outer) * self._shear_stiffness[:, None, None]
        K = share[:, None, None] * (outer * self._stiffness[:, None, None] + flat)
        self._pad_slope = K * h + (share * self._damping)[:, None, None] * np.eye(2)
        stretch = places[0] - self._pad_point
        moving = (places[1] - places[0]) / h
        squeeze = (share * self._grip)[:, None, None] * self._pad_normal
        self._pad_level = squeeze + np.einsum("bij,bnj->bni", K, stretch)
        self._pad_level += np.einsum("bij,bnj->bni", self._pad_slope, moving)
        if not share.any():
            return
        mass += h * np.einsum("bnid,bij,bnje->bde", self._pad_G, self._pad_slope, self._pad_G)
        momentum += h * np.einsum("bnid,bni->bd", self._pad_G, self._pad_level)

    def record(
        self, k: int, u: np.ndarray, normal: np.ndarray, shear: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Keep what the step found; return pusher, contact, point, normal, force, touched part."""
        tip = normal[:, None] * self._normal + shear[:, None] * self._tangent
        slid = np.einsum("bk,bkd,bd->b", self._tangent, self._G, u)
        drawn = self._sheared + self._h * (
            np.sum(self._tip_velocity * self._tangent, axis=1) - slid
        )
        bound = self.friction * normal / self._shear_stiffness
        self._sheared = np.clip(drawn, -bound, bound)
        moving = np.einsum("bnid,bd->bni", self._pad_G, u)
        pads = self._pad_level - np.einsum("bij,bnj->bni", self._pad_slope, moving)
        closed = self._pulls & (self._share[:, k] > 0.0)
        pads = np.where(closed[:, None, None], pads, 0.0)
        self._force = np.concatenate([tip[:, None], pads], axis=1)
        contact = np.stack([normal > 0.0, closed, closed], axis=1)
        point = np.concatenate([self._point[:, None], self._pad_point], axis=1)
        normals = np.concatenate([self._normal[:, None], self._pad_normal], axis=1)
        return self._after, contact, point, normals, self._force, self._part

    def power(self, u: np.ndarray) -> np.ndarray:
        """Return the power (B,) that contacts put into the object, W."""
        G = np.concatenate([self._G[:, None], self._pad_G], axis=1)
        return np.asarray(np.einsum("bnk,bnkd,bd->b", self._force, G, u))

    def forces(self, links: int) -> np.ndarray:
        """Return the force (B, L, 2) on each body."""
        total = self._force.sum(axis=1)
        on = self._body[:, None] == np.arange(links)
        return np.asarray(total[:, None] * on[..., None])

    def tipping(self, links: int) -> np.ndarray:
        """Return forces times height (B, L, 2), N m."""
        return np.asarray(self._height[:, None, None] * self.forces(links))
