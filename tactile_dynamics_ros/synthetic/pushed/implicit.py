"""Velocities after a step: implicit Euler with dry friction by a primal-dual Newton method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CREEP = 1e-6
"""m/s at which friction reaches 0.7 of its limit. Measured objects creep less than they are seen to
move by noise: at rest below 1 um/s at half the limit. Larger by 100 it would show as drift."""
_TOLERANCE = 1e-8
"""m/s; Newton's last correction. The error after it is far smaller, as convergence is quadratic."""
_FULL_STEPS = 8
"""Newton steps before they are shortened: where a tip sticks and slips in turn, full steps may run
in a circle."""
_MOST = 80


@dataclass(frozen=True)
class Spring:
    """A force along one direction of the generalised velocities: f = level - slope (d . u).

    Attributes:
        direction: (B, D). level: (B,) N. slope: (B,) N s/m, positive.
    """

    direction: np.ndarray
    level: np.ndarray
    slope: np.ndarray

    def force(self, velocity: np.ndarray) -> np.ndarray:
        """Return the force (B,) at velocities (B, D)."""
        return np.asarray(self.level - self.slope * np.sum(self.direction * velocity, axis=1))


@dataclass(frozen=True)
class Step:
    """The equations of one step for B scenes with D generalised velocities.

    M u + h sum_i c_i G_i^T G_i u / |G_i u| = p + h (N d_n + T d_t), N >= 0, |T| <= mu N.

    Attributes:
        h: s.
        mass: (B, D, D). momentum: (B, D), forces that do not depend on u included.
        rubbing: (B, P, 2, D), velocities of what rubs. limit: (B, P) N, largest friction.
        normal, shear: springs of the tip; those of scenes without contact have no slope.
        tip_friction: (B,) coefficient.
    """

    h: float
    mass: np.ndarray
    momentum: np.ndarray
    rubbing: np.ndarray
    limit: np.ndarray
    normal: Spring
    shear: Spring
    tip_friction: np.ndarray

    def solve(self, velocity: np.ndarray, sense: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities (B, D) and what friction opposes: (B, P, 2) within the unit circle.

        Args:
            velocity: (B, D) to start from.
            sense: (B, P, 2) to start from.

        Raises:
            RuntimeError: the iteration does not converge.
        """
        u, w = velocity.copy(), sense
        size = self.rubbing.shape
        flat = self.rubbing.reshape(size[0], -1, size[3])
        weight = self.h * self.limit
        for round_ in range(_MOST):
            v = (flat @ u[..., None]).reshape(size[:3])
            s = np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2 + CREEP**2)
            unit = v / s[..., None]
            share = weight / s
            Gv = (unit[:, :, None] @ self.rubbing)[:, :, 0]
            Gw = (w[:, :, None] @ self.rubbing)[:, :, 0]
            hessian = flat.swapaxes(1, 2) @ (flat * np.repeat(share, 2, axis=1)[..., None])
            hessian -= Gw.swapaxes(1, 2) @ (Gv * share[..., None])
            gradient = (weight[:, None] @ Gv)[:, 0] - self.momentum
            gradient += (self.mass @ u[..., None])[..., 0]
            hessian += self.mass
            self._touch(u, gradient, hessian)
            size_of_step = 1.0 if round_ < _FULL_STEPS else 0.5
            du = -size_of_step * np.linalg.solve(hessian, gradient[..., None])[..., 0]
            Gdu = (flat @ du[..., None]).reshape(size[:3])
            along = unit[..., 0] * Gdu[..., 0] + unit[..., 1] * Gdu[..., 1]
            w = unit + (Gdu - w * along[..., None]) / s[..., None]
            w /= np.sqrt(np.maximum(1.0, w[..., 0] ** 2 + w[..., 1] ** 2))[..., None]
            u = u + du
            if np.abs(du).max() < _TOLERANCE:
                return u, w
        worst = int(np.abs(du).max(axis=1).argmax())
        raise RuntimeError(f"scene {worst}: the step did not converge, {np.abs(du).max():.1e}")

    def _touch(self, u: np.ndarray, gradient: np.ndarray, hessian: np.ndarray) -> None:
        """Add what the tip does to gradient and Hessian."""
        normal, shear, slips, touches = self._tip(u)
        n, t, h = self.normal.direction, self.shear.direction, self.h
        gradient -= h * (normal[:, None] * n + shear[:, None] * t)
        pressing = (h * self.normal.slope * touches)[:, None, None]
        hessian += pressing * n[:, :, None] * n[:, None, :]
        sticks = (h * self.shear.slope * (touches & (slips == 0.0)))[:, None, None]
        hessian += sticks * t[:, :, None] * t[:, None, :]
        sliding = (h * self.tip_friction * self.normal.slope * slips * touches)[:, None, None]
        hessian += sliding * t[:, :, None] * n[:, None, :]

    def _tip(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        normal = self.normal.force(u)
        touches = normal > 0.0
        normal = np.where(touches, normal, 0.0)
        bound = self.tip_friction * normal
        trial = self.shear.force(u)
        slips = np.where(np.abs(trial) > bound, np.sign(trial), 0.0)
        return normal, np.clip(trial, -bound, bound), slips, touches

    def tip_force(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normal and shear force (B,) of the tip at the velocities found."""
        normal, shear, _, _ = self._tip(u)
        return normal, shear
