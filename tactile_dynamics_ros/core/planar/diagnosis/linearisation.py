"""Pushes linearised at a fit: innovations, and what makes them white on a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.diagnosis.innovations import Innovations
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows
from tactile_dynamics_ros.core.planar.diagnosis.variation import Table, field_rows
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.properties.latent_model import Sharpness


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Innovations of poses to first order around a fit.

    The motion and local friction are integrated out by the filter, what is known of lasting errors
    of height, place, clock and pressure, and friction over the table, by the whitening.

    Attributes:
        pushes: motion and common numbers at which rows are taken.
        table: how friction differs from place to place.
    """

    pushes: FittedPushes
    table: Table

    @cached_property
    def sharp(self) -> Sharpness:
        """How strictly the model is taken."""
        return self.pushes.sharp(self.table.along)

    @cached_property
    def rows(self) -> PushRows:
        """The rows themselves."""
        return self.pushes.rows(self.sharp)

    @cached_property
    def filter(self) -> Innovations:
        """What makes innovations of rows."""
        return Innovations.of(self.rows)

    @cached_property
    def friction(self) -> Any:
        """Friction to first order around the motion."""
        return self.pushes.friction(self.sharp)

    @property
    def times(self) -> Array:
        """(J,) s, of the poses that are judged."""
        return np.asarray(self.rows.poses.time[self.filter.order[:, 0]])

    def innovations(self, motion: Array, poses: Array) -> Array:
        """(M, c) of rows (N, D, c) of the motion and (P, 3, c) of poses alone."""
        local = np.zeros((*self.rows.local.shape, motion.shape[2]))
        return self.filter.white(motion, local, poses).reshape(-1, motion.shape[2])

    @cached_property
    def innovated(self) -> Array:
        """(M,) innovations at the linearisation, for lasting errors of zero."""
        rows = self.rows
        parts = (rows.motion[..., None], rows.local[..., None], rows.poses.residual[..., None])
        columns, found = self._lasting
        return np.asarray(self.filter.white(*parts).reshape(-1) - columns @ found)

    def changed(self, common: Array, effects: tuple[PushEffect, ...]) -> tuple[Array, Array]:
        """Change of rows (N, D) of the motion and (P, 3) of poses by other numbers.

        Args:
            common: (p + k,) numbers, and parameters of the effects.
            effects: of the model there.
        """
        pushes, rows = self.pushes, self.rows
        lack = pushes.lack(common, effects, self.friction) / pushes.noise(self.sharp)
        motion = np.zeros_like(rows.motion)
        motion[pushes.middle] = lack - rows.motion[pushes.middle]
        late = pushes.delay(common, effects) - pushes.delay(pushes.common, pushes.effects)
        return motion, rows.poses.by_common[:, :, pushes.names.index("delay")] * late

    def field(self, length: float) -> Array:
        """Rows (N, D, K) by spots of a table whose friction differs over a length, m."""
        return field_rows(self.pushes, self.sharp, length)

    @property
    def lasting_rows(self) -> tuple[Array, Array]:
        """Rows (N, D, k) and (P, 3, k) per standard deviation of errors that last."""
        rows, places = self.rows, self._places
        std = self.pushes.prior[1][places]
        by_motion, by_poses = rows.motion_by_common, rows.poses.by_common
        return by_motion[:, :, places] * std, by_poses[:, :, places] * std

    @property
    def _places(self) -> NDArray[np.intp]:
        """Places of the common numbers that are lasting errors."""
        return np.setdiff1d(np.arange(len(self.pushes.names)), self.pushes.own)

    @cached_property
    def _lasting(self) -> tuple[Array, Array]:
        """Innovations (M, k) per standard deviation of lasting errors, and what is found (k,).

        Height, place, clock and pressure; and friction over the table, of which nothing is found.
        """
        mean, std = self.pushes.prior
        places = self._places
        motion, poses = self.lasting_rows
        found = (self.pushes.common[places] - mean[places]) / std[places]
        if self.table.field:
            field = self.table.field * self.field(self.table.length)
            motion = np.concatenate([motion, field], axis=2)
            more = field.shape[2]
            poses = np.concatenate([poses, np.zeros((*poses.shape[:2], more))], axis=2)
            found = np.append(found, np.zeros(more))
        return self.innovations(motion, poses), found

    @cached_property
    def _spread(self) -> tuple[Array, Array]:
        """Directions U (M, k) of lasting errors and their variances."""
        vectors, sizes, _ = np.linalg.svd(self._lasting[0], full_matrices=False)
        return vectors, np.square(sizes)

    def whiten(self, rows: Array) -> Array:
        """White form of innovations (M, ...), whose lasting errors have the spread of the prior."""
        vectors, variances = self._spread
        flat = rows.reshape(len(rows), -1)
        shrunk = (1.0 - 1.0 / np.sqrt(1.0 + variances))[:, None] * (vectors.T @ flat)
        return np.asarray((flat - vectors @ shrunk).reshape(rows.shape))

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) innovations of noise, and one draw of lasting errors."""
        columns = self._lasting[0]
        draw = columns @ random.normal(size=columns.shape[1])
        return np.asarray(random.normal(size=len(columns)) + draw)
