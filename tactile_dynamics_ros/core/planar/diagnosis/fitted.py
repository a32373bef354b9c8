"""What the diagnosis asks of a fit of pushes, of one part or of two."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import Predicted
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.latent_model import USUAL_FRICTION, Sharpness
from tactile_dynamics_ros.core.planar.streams import PushedStreams

Index = NDArray[np.intp]

FRICTION_SPREAD = 0.4
"""Standard deviation of the logarithm of friction beforehand: nearly all tables within 0.1 and 0.9.
Narrower than in an estimate, since a fit at fixed whitening does not see that heavy objects on ice
explain whatever the model lacks."""


class FittedPushes(ABC):
    """Motion and common numbers of a pushed object, as a fit found them.

    Attributes:
        fit: with all effects of the model.
        names: of the p common numbers, before the parameters of effects.
        own: places of those numbers that a fit at fixed whitening may change. The others are known
            beforehand to within their priors, which is part of the whitening.
    """

    fit: Any

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the common numbers."""

    @property
    @abstractmethod
    def own(self) -> Index:
        """(q,) places of the own numbers."""

    @property
    @abstractmethod
    def frictions(self) -> list[tuple[int, int]]:
        """Places of ln product and ln mass of each body."""

    @property
    def catalogue(self) -> tuple[str, ...]:
        """Names of the effects that the model may have."""
        return PUSHED.names()

    @property
    def common(self) -> Array:
        """(p + k,) common numbers, and parameters of the effects."""
        return np.asarray(self.fit.common)

    @property
    def effects(self) -> tuple[PushEffect, ...]:
        """Effects of the model."""
        return tuple(self.fit.model.effects)

    @property
    def variation(self) -> float:
        """Relative standard deviation of friction from place to place."""
        return float(self.fit.variation)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the common numbers.

        A mass that is no own number is that of the usual friction at the product that was found.
        """
        mean, std = (column[: len(self.names)].copy() for column in self.fit.model.prior)
        for product, mass in self.frictions:
            if mass not in self.own:
                mean[mass] = self.common[product] - np.log(USUAL_FRICTION)
                std[mass] = FRICTION_SPREAD
        return mean, std

    @property
    def intervals(self) -> Intervals:
        """Forces and poses."""
        cut: Intervals = self.fit.model.intervals
        return cut

    @property
    def middle(self) -> Index:
        """(R,) nodes whose equations count."""
        return np.asarray(self.fit.model.middle)

    def noise(self, sharp: Sharpness) -> Array:
        """(R, D) standard deviations of the equations."""
        return np.asarray(self.fit.model.noise(sharp.floor))

    @abstractmethod
    def sharp(self, along: float) -> Sharpness:
        """How strictly the model is taken at a variation of friction along the way."""

    @abstractmethod
    def rows(self, sharp: Sharpness) -> PushRows:
        """Linearisation."""

    @abstractmethod
    def friction(self, sharp: Sharpness) -> Any:
        """Friction to first order around the motion."""

    @abstractmethod
    def lack(self, common: Array, effects: tuple[PushEffect, ...], friction: Any) -> Array:
        """(R, D) force, N, torque about the contact, N m, and what else the motion lacks."""

    @abstractmethod
    def delay(self, common: Array, effects: tuple[PushEffect, ...]) -> float:
        """Delay of the stamps of the forces, s."""

    @abstractmethod
    def feet(self) -> Array:
        """Places (R, n, 2) of the points that carry, m, axes of the support."""

    @abstractmethod
    def lack_by_shares(self, sharp: Sharpness, shares: Iterable[Array]) -> Array:
        """Change (R, D, K) of `lack` by relative changes of friction (R, n) under the points."""

    @abstractmethod
    def motion(self) -> PlanarMotion:
        """Motion of the (first) footprint's centroid."""

    @abstractmethod
    def refitted(self, effects: tuple[PushEffect, ...], common: Array, variation: float) -> Self:
        """The same pushes fitted with effects, from a start of all numbers.

        Raises:
            NotIdentifiableError: the equations are singular.
        """

    def suspecting(self, streams: PushedStreams, suspects: Sequence[str]) -> Self:
        """The fit with an effect from its first stage on, where one without has not converged.

        Args:
            streams: as they were fitted.
            suspects: effects to try, likeliest first.
        """
        return self

    @abstractmethod
    def steady(self) -> Predicted | None:
        """The object in pushes that were not made; None where none can be predicted."""

    def families(self, effect: PushEffect) -> Sequence[PushEffect]:
        """An effect, or for sudden ones one for each push with which it may begin; or none."""
        return effect.beginnings(self.intervals.push_starts) if effect.identifiable else []

    def regional(self) -> Sequence[PushEffect]:
        """Effects in a regime that are compared with friction that differs over the table."""
        return ()

    def imitators(self, name: str) -> tuple[str, ...]:
        """Effects that are not in the catalogue of these parts and may do what one there does."""
        return ()
