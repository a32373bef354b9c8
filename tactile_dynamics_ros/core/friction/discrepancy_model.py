"""Coulomb friction of a probed surface as a model that the diagnosis can question."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.discrepancy.model.least_squares import LeastSquaresModel
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Condition, Family, Residuals
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.friction.effects import FRICTION, FrictionEffect
from tactile_dynamics_ros.core.friction.slip_log import LEAST_SPEED, SlipTable, slip_scalars

OfSlips = Callable[[SlipTable], Array]
"""Forces (N, 2) of slips, N: static and kinetic."""

_FORCES = (0.3, 0.5, 0.8, 1.2, 1.8)
"""Normal forces of the slips that are compared, N: what a probe presses with (up to 1.7 N). Values
beyond would propose slips that no probe makes, finer ones cost time."""
_SPEEDS = (LEAST_SPEED, 1e-2, 4e-2)
"""Speeds of sliding that are compared, m/s: from where a fingertip creeps (`LEAST_SPEED`) to three
times those of a probe's slides. Faster ones would propose slides that no probe makes."""
_TURNS = 8
"""Directions that are compared: every 45 deg, half a period of the second harmonic of a grain.
Fewer miss where an effect shows most, more propose nearly the same direction."""
_LEAST_SEPARATION = 0.1
"""Difference of predictions from which a slip is proposed, in standard deviations of a single one:
nine hundred slips would then make three of them. Less is no proposal to anybody. More would
withhold proposals that some hundred slips can carry out."""


def plan_slips(
    best: OfSlips, rivals: Sequence[OfSlips], scatter_of: OfSlips
) -> dict[str, Any] | None:
    """Return the slip at which predictions differ most, over the scatter of one slip.

    Args:
        best: predicted tangential forces, N.
        rivals: those of other explanations.
        scatter_of: standard deviation of a measured force, N.

    Returns:
        {"description", "normal_force_n", "direction_deg", "sliding_speed_m_s", "rested",
        "separation_sigma", "slips"}, with the number of such slips that would make three standard
        deviations, or None if no slip tells them apart.
    """
    if not rivals:
        return None
    grid = _candidates()
    own = best(grid)
    gap = np.min([np.abs(own - rival(grid)) for rival in rivals], axis=0)
    separation = np.max(gap / scatter_of(grid), axis=1)
    most = int(np.argmax(separation))
    strength = float(separation[most])
    if strength < _LEAST_SEPARATION:
        return None
    force, angle = float(grid.normal[most, 0]), float(np.rad2deg(grid.angle[most]))
    speed, rested = float(grid.speed[most]), bool(grid.memory_normal[most] == 0.0)
    count = int(np.ceil((3.0 / strength) ** 2))
    return {
        "description": (
            f"{count} slip{'s' * (count > 1)} at {force:.1f} N along {angle:.0f} deg, sliding at "
            f"{1e3 * speed:.0f} mm/s, {'after a rest' if rested else 'soon after a hard press'}"
        ),
        "normal_force_n": force,
        "direction_deg": angle,
        "sliding_speed_m_s": speed,
        "rested": rested,
        "separation_sigma": strength,
        "slips": count,
    }


def _candidates() -> SlipTable:
    angles = 2.0 * np.pi * np.arange(_TURNS) / _TURNS
    rows = np.array(list(product(_FORCES, _SPEEDS, angles, (0.0, 1.5))))
    normal = np.repeat(rows[:, :1], 2, axis=1)
    return SlipTable(
        time=np.arange(len(rows), dtype=float),
        angle=rows[:, 2],
        normal=normal,
        tangential=np.zeros_like(normal),
        speed=rows[:, 1],
        memory_normal=rows[:, 3],
        memory_tangential=np.zeros(len(rows)),
    )


_REFINEMENTS = 3
"""Fits, each with the covariance at the coefficients of the one before. On twelve synthetic probes
two leave the coefficients within 2.4 % of where they settle, three within 0.2 % (1e-6 where Coulomb
suffices), eight change nothing more."""
_LARGEST_GUESS = 0.4
"""Largest start of an effect's parameter, in its unit. Linear forms overshoot where an effect is
large; a lean of 1 rad, or a grain above 1, would start a fit where forces are infinite or negative.
No parameter of a known surface exceeds it (a soft sphere has a power of 1/3). Smaller starts need
more steps to large effects."""


@dataclass(frozen=True)
class FrictionNoise:
    """What the forces of a slip are worth."""

    force_std: float = parameter(0.01, "of a tangential force at slip", "N", 1e-4, 1.0)
    relative_std: float = parameter(0.025, "scatter of single slips", "", 1e-4, 0.5)
    tilt_std_deg: float = parameter(5.0, "constant error of the force's direction", "deg", 0, 20)
    reading_std: float = parameter(
        0.004,
        "constant error of the force at slip, since the greatest ratio is taken",
        "N",
        0.0,
        1.0,
    )

    def __post_init__(self) -> None:
        check_ranges(self)

    def scatter(self, mu: Array, slips: SlipTable) -> Array:
        """Standard deviation (N, 2) of the forces of single slips, N, for coefficients (2,)."""
        return np.hypot(self.force_std, self.relative_std * mu * slips.normal)


@dataclass(frozen=True)
class FrictionModel(LeastSquaresModel[FrictionEffect]):
    """T = mu N with static and kinetic coefficient, and effects; residual measured - predicted.

    The covariance of the residuals holds the scatter of single slips and what all slips share: one
    constant error of the force's direction, and one of the force that is read as that of the slip;
    its Cholesky factor makes them white.

    Attributes:
        slips: what was measured.
        mu: (2,) static and kinetic coefficient.
        effects: of the model. theta: their parameters.
        noise: what the forces are worth.
        whitening_mu: (2,) coefficients at which the covariance was taken.
        catalogue: names of the effects that may be tried.
    """

    slips: SlipTable
    mu: Array
    effects: tuple[FrictionEffect, ...]
    theta: tuple[Array, ...]
    noise: FrictionNoise
    whitening_mu: Array
    catalogue: tuple[str, ...]

    @classmethod
    def fit(
        cls,
        slips: SlipTable,
        effects: Sequence[str] = (),
        noise: FrictionNoise | None = None,
    ) -> FrictionModel:
        """Fit coefficients and named effects to the slips of a probe."""
        mu = np.median(slips.tangential / slips.normal, axis=0)
        chosen = FRICTION.create_all(effects)
        theta = tuple(np.zeros(len(effect.parameters)) for effect in chosen)
        model = cls(slips, mu, chosen, theta, noise or FrictionNoise(), mu, FRICTION.names())
        return model.refined()

    @property
    def own(self) -> Array:
        """(2,) static and kinetic coefficient."""
        return self.mu

    @property
    def own_names(self) -> tuple[tuple[str, str, str], ...]:
        """The coefficients, as ``coulomb``."""
        return (("coulomb", "mu_static", ""), ("coulomb", "mu_kinetic", ""))

    @cached_property
    def time(self) -> Array:
        """(2 N,) s, from the first slip."""
        return np.repeat(self.slips.time - self.slips.time[0], 2)

    @property
    def measured(self) -> Array:
        """(2 N,) tangential forces, N, static and kinetic of each slip."""
        return self.slips.tangential.reshape(-1)

    def predict(self, x: Array, effects: Sequence[FrictionEffect]) -> Array:
        """(2 N,) the same, for parameters [mu_s, mu_k, theta ...]."""
        return self.predict_slips(x, effects, self.slips).reshape(-1)

    def predict_slips(self, x: Array, effects: Sequence[FrictionEffect], slips: SlipTable) -> Array:
        """Tangential force (N, 2) of any slips."""
        mu = x[:2]
        force, added = mu * slips.normal, np.zeros_like(slips.normal)
        first = 2
        for effect in effects:
            theta = x[first : first + len(effect.parameters)]
            force = force * effect.factor(slips, theta)
            added = added + effect.term(slips, mu, theta)
            first += len(theta)
        return np.asarray(force + added)

    @cached_property
    def _factor(self) -> Array:
        """Lower Cholesky factor (2 N, 2 N) of the residuals' covariance."""
        tilt = np.deg2rad(self.noise.tilt_std_deg) ** 2
        waves, static = self._waves, self.noise.reading_std * self._at_slip
        shared = tilt * waves @ waves.T + np.outer(static, static)
        return np.linalg.cholesky(
            np.diag(self._scatter(self.whitening_mu).reshape(-1) ** 2) + shared
        )

    @property
    def _waves(self) -> Array:
        """(2 N, 2) change of the tangential force, N/rad, by a turn of all measured forces."""
        steep = ((1.0 + self.whitening_mu**2) * self.slips.normal).reshape(-1)
        angle = np.repeat(self.slips.angle, 2)
        return np.asarray(steep[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))

    @property
    def _at_slip(self) -> Array:
        """(2 N,) 1 for forces at slip, 0 for those while sliding."""
        return np.tile([1.0, 0.0], len(self.slips.time))

    def whiten(self, rows: Array) -> Array:
        """White form of rows (2 N, ...)."""
        return np.asarray(np.linalg.solve(self._factor, rows))

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(2 N,) scatter of every slip, one turn of all forces and one error of those at slip."""
        own = random.normal(0.0, self._scatter(self.whitening_mu)).reshape(-1)
        turn = random.normal(0.0, np.deg2rad(self.noise.tilt_std_deg), 2)
        reading = random.normal(0.0, self.noise.reading_std)
        return np.asarray(own + self._waves @ turn + reading * self._at_slip)

    @property
    def lasting_freedom(self) -> float:
        """Two of the force's direction and one of the force at slip."""
        return 3.0

    def parameters_of(self, effect: FrictionEffect) -> tuple[EffectParameter, ...]:
        """Parameters of an effect."""
        return effect.parameters

    def with_parameters(
        self, own: Array, effects: tuple[FrictionEffect, ...], theta: tuple[Array, ...]
    ) -> FrictionModel:
        """The model at other parameters, at the same whitening."""
        return replace(self, mu=own, effects=effects, theta=theta)

    def effect_named(self, name: str) -> FrictionEffect:
        """An effect of the catalogue."""
        return FRICTION.create(name)

    def refined(self) -> FrictionModel:
        """Fit again with the covariance at the fitted coefficients."""
        model = self
        for _ in range(_REFINEMENTS):
            fitted = model.fitted_from(model.effects, model.theta)
            model = replace(fitted, whitening_mu=model.mu)
        return model

    def families_of(self, name: str) -> list[Family]:
        """Linear form of an effect that the model lacks, and what it fills where it is large."""
        effect = self.effect_named(name)
        count = len(effect.parameters)
        start = np.concatenate([self.x, np.zeros(count)])
        linear = -self.evaluate(start, (*self.effects, effect))[1][:, -count:]
        curved = effect.curvature(self.slips, self.mu)
        columns = np.hstack([linear, self.whiten(curved.reshape(len(linear), -1))])
        kept = tuple(range(columns.shape[1]))
        return [Family(name, name, name, columns, kept, source=effect, regional=True)]

    def conditions(self) -> list[Condition]:
        """Scalars of the slips."""
        return [
            Condition(name, unit, values, symbol=symbol)
            for symbol, (name, unit, values) in slip_scalars(self.slips).items()
        ]

    def guess(self, family: Family, coefficients: Array) -> Array:
        """Coefficients of the linear form, no larger than effects are."""
        return np.clip(super().guess(family, coefficients), -_LARGEST_GUESS, _LARGEST_GUESS)

    def residuals(self) -> Residuals:
        """Residuals of the force at slip and while sliding, with what was going on."""
        slips = self.slips
        direction = [np.cos(slips.angle), np.sin(slips.angle)]
        twice = [np.cos(2.0 * slips.angle), np.sin(2.0 * slips.angle)]
        return Residuals(
            time=slips.time - slips.time[0],
            white=self.residual.reshape(-1, 2),
            physical=self.lack(self.x, self.effects).reshape(-1, 2),
            alone="Coulomb alone",
            about="The model predicts, from the normal forces of a probing finger, the tangential "
            "forces at which it slips and slides.",
            channels=("static", "kinetic"),
            units=("N", "N"),
            conditions=(
                Condition("normal force", "N", slips.normal[:, 0]),
                Condition("sliding speed", "m/s", slips.speed),
                Condition("direction cosine", "", direction[0], cosine_of="the direction from x"),
                Condition("direction sine", "", direction[1], cosine_of="the direction from y"),
                Condition("time", "s", slips.time - slips.time[0]),
            ),
            drivers=np.column_stack([*direction, *twice, slips.normal[:, 0], slips.speed]),
        )

    def library(self) -> list[Family]:
        """Simple functions of named quantities, for a residual that no effect explains."""
        slips = self.slips
        quantities = {
            "time": (slips.time - slips.time.mean())[:, None] * slips.normal,
            "normal_force_squared": slips.normal**2,
            "sliding_speed": slips.speed[:, None] * slips.normal,
        }
        symbols = {"time": "N t", "normal_force_squared": "N^2", "sliding_speed": "N v"}
        return [
            Family(n, n, n, self.whiten(c.reshape(-1, 1)), (0,), symbols=(symbols[n],))
            for n, c in quantities.items()
        ]

    def plan_against(self, rivals: Sequence[FrictionModel]) -> dict[str, Any] | None:
        """The slip that would tell this model from others."""
        return plan_slips(
            self._of_slips,
            [rival._of_slips for rival in rivals],
            lambda slips: self.noise.scatter(self.mu, slips),
        )

    def _of_slips(self, slips: SlipTable) -> Array:
        return self.predict_slips(self.x, self.effects, slips)

    def _scatter(self, mu: Array) -> Array:
        return self.noise.scatter(mu, self.slips)
