"""Pushes of one part, as the diagnosis asks of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.diagnosis.rows import PushRows, rows_of_one
from tactile_dynamics_ros.core.planar.diagnosis.separating_push import SLIP, Steady
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.regional import is_regional, regional_hypotheses
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.core.planar.properties.balance import (
    NAMES,
    Balance,
    Friction,
)
from tactile_dynamics_ros.core.planar.properties.fit import (
    final_sharpness,
    fit_push,
    refit,
    with_expected_force,
)
from tactile_dynamics_ros.core.planar.properties.intervals import Intervals
from tactile_dynamics_ros.core.planar.properties.latent_model import Motion, Sharpness
from tactile_dynamics_ros.core.planar.properties.push_model import PushFit
from tactile_dynamics_ros.core.planar.streams import PushedStreams

Index = NDArray[np.intp]

_OWN = ("ln_product", "ln_mass", "com_x", "com_y")
"""Common numbers of which hardly anything is known before the data; no number of a threshold."""

_LEAN = "support_tilt"
"""Effect that a fit may need to find the motion: a heavy object on ice is the nearest to a table
that leans, and no path leads back from there."""
_ODD_INERTIA = 3.0
"""Standard deviations of ln inertia beforehand from which a fit is odd: leans at 5 % variation gave
4 and 14, clean pushes at most 1."""
_ODD_ERROR = 1.3
"""Error over the noise from which a fit is odd: clean recordings have 0.8 to 1. Lower costs further
fits where small effects are missing."""


_SUSPECTS = 3
"""Effects in a regime that are tried, 15 to 40 s each: there are four kinds, and the true one was
among the first two of them in all that was tuned on."""


@dataclass(frozen=True, eq=False)
class OnePart(FittedPushes):
    """A fit of one part.

    Attributes:
        fit: with all effects of the model.
        unconverged: streams, where the fit converged to a wrong optimum without an effect that the
            model misses; what acts in a regime is then fitted from the first stage on.
    """

    fit: PushFit
    unconverged: PushedStreams | None = None

    @classmethod
    def of_streams(
        cls, streams: PushedStreams, effects: Sequence[PushEffect], fit: PushFit | None = None
    ) -> OnePart:
        """Fit a model with effects, or with a lean besides where they end where no object is.

        Args:
            streams: forces, contact points and poses.
            effects: of the model.
            fit: of it, if there is one already.

        Raises:
            BadInputError: nothing is touched while poses are known.
            NotIdentifiableError: nothing slides long enough.
        """
        fit = fit or fit_push(streams, effects)
        if _is_odd(fit) and _LEAN not in [effect.name for effect in effects]:
            fit = _with_lean(fit, streams, effects)
        return cls(with_expected_force(fit))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the common numbers."""
        return NAMES

    @property
    def own(self) -> Index:
        """Product, mass and centre of mass."""
        return np.array([NAMES.index(name) for name in _OWN])

    @property
    def frictions(self) -> list[tuple[int, int]]:
        """Of the one body."""
        return [(NAMES.index("ln_product"), NAMES.index("ln_mass"))]

    def sharp(self, along: float) -> Sharpness:
        """How strictly the model is taken."""
        return final_sharpness(self.fit.model, self.fit.nodes, along)

    def rows(self, sharp: Sharpness) -> PushRows:
        """Linearisation."""
        return rows_of_one(self.fit.model, self.fit.nodes, self.fit.common, sharp)

    @cached_property
    def kinematics(self) -> Motion:
        """Motion of the intervals that count."""
        return self.fit.model.motion_of(self.fit.nodes)

    def friction(self, sharp: Sharpness) -> Friction:
        """Friction to first order around the motion."""
        balance = self.fit.model.balance
        return balance.linear_friction(self.kinematics, self.fit.common, sharp.slip)

    def lack(self, common: Array, effects: tuple[PushEffect, ...], friction: Friction) -> Array:
        """(R, 3) force, N, and torque about the contact, N m."""
        return self.fit.model.balance_with(effects).lack(self.kinematics, common, friction)

    def delay(self, common: Array, effects: tuple[PushEffect, ...]) -> float:
        """Delay of the stamps of the forces, s."""
        numbers = self.fit.model.balance_with(effects).numbers(common)
        return float(numbers[NAMES.index("delay")])

    def feet(self) -> Array:
        """Places (R, n, 2) of the points that carry, m."""
        return self.fit.model.balance.feet(self.kinematics)

    def lack_by_shares(self, sharp: Sharpness, shares: Iterable[Array]) -> Array:
        """Change (R, 3, K) of `lack` by relative changes of friction (R, n) under the points."""
        balance = self.fit.model.balance
        return balance.lack_by_shares(self.kinematics, self.fit.common, sharp.slip, shares)

    def motion(self) -> PlanarMotion:
        """Motion of the footprint's centroid."""
        return self.fit.model.balance.motion(self.kinematics)

    def regional(self) -> list[PushEffect]:
        """Those on a side of the table, or for a while."""
        return regional_hypotheses(self.motion())

    def refitted(self, effects: tuple[PushEffect, ...], common: Array, variation: float) -> OnePart:
        """The same pushes fitted with effects."""
        if self.unconverged is not None and any(is_regional(effect.name) for effect in effects):
            whole = fit_push(self.unconverged, effects)
            if whole.converged:
                return replace(self, fit=with_expected_force(whole))
        return replace(self, fit=refit(self.fit, effects, common, variation))

    def suspecting(self, streams: PushedStreams, suspects: Sequence[str]) -> OnePart:
        """The fit, or where that is odd the one of least variation with a suspect, if it is less.

        Less variation first, since the error is over it.
        """
        best = self.fit
        if not _is_odd(best):
            return self
        for name in suspects[:_SUSPECTS]:
            try:
                fit = fit_push(streams, (*self.effects, PUSHED.create(name)))
            except NotIdentifiableError:
                continue
            less = (fit.variation, fit.whitened_rms) < (best.variation, best.whitened_rms)
            best = fit if fit.converged and less else best
        return self if best is self.fit else OnePart(with_expected_force(best), streams)

    def steady(self) -> Steady:
        """The object in pushes that were not made."""
        model = self.fit.model

        def lacking(
            cut: Intervals,
            pose: Array,
            velocity: Array,
            common: Array,
            effects: tuple[PushEffect, ...],
        ) -> Array:
            none = np.zeros_like(pose)
            motion = Motion(pose, velocity, none, none)
            at = np.arange(len(pose))
            balance = Balance(
                cut, at, model.patch, model.data.gravity, model.balance.middle, effects
            )
            return balance.lack(motion, common, balance.linear_friction(motion, common, SLIP))

        size = float(np.sqrt(model.plate))
        middle, centroid = np.asarray(model.balance.middle), model.patch.centroid
        return Steady(model.intervals, model.typical_force, middle, centroid, size, lacking)


def _is_odd(fit: PushFit) -> bool:
    """Whether a fit ended where no object is, or far from the data."""
    place = NAMES.index("ln_inertia")
    inertia = abs(float(fit.common[place])) / fit.model.prior[1][place]
    return fit.mass_is_bound or inertia > _ODD_INERTIA or fit.whitened_rms > _ODD_ERROR


def _with_lean(fit: PushFit, streams: PushedStreams, effects: Sequence[PushEffect]) -> PushFit:
    """The fit with a lean from the first stage on, if it is better; else the fit without."""
    try:
        leaning = fit_push(streams, (*effects, PUSHED.create(_LEAN)))
    except NotIdentifiableError:
        return fit
    better = leaning.converged and leaning.whitened_rms < fit.whitened_rms
    return leaning if better and leaning.variation <= fit.variation else fit
