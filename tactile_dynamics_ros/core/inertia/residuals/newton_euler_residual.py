"""Newton-Euler as an errors-in-variables model: noisy motion and forces, exact equations.

Motion, forces and contact points x are measured as z ~ N(x, S S^T); at every grid time
e(x, theta) = Y(x) phi - w(x) - Delta(x, theta) = 0. The residual e(z) has covariance
C = A A^T = L L^T with A = (de/dx) S, banded because motion is read from short windows of raw
poses. Hence L^-1 e is white, N(0, 1), exactly when the model is right. Sensitivities, regressors
and effects are taken at better estimates of x (wide windows on signals moved by their expected
error given the residual), so that their noise does not correlate with that of the residual: a
plain regression on noisy regressors is biased, and "explains" clean data by gains of the forces.
Source: Fuller 1987, Measurement Error Models, ch. 3; Lenzmann & Lenzmann 2004 (Gauss-Helmert).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.wrench_samples import GRAVITY_W, WrenchSamples
from tactile_dynamics_ros.core.effects.present import PresentEffects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.residuals.carried import carried_places
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import (
    ContactSignals,
    choose_grid,
    contact_signals,
)
from tactile_dynamics_ros.core.inertia.residuals.latent import LatentSignal, Sensitivity
from tactile_dynamics_ros.core.inertia.residuals.motion import motion_period, motion_signals
from tactile_dynamics_ros.core.inertia.residuals.sampled_signals import (
    SampledSignals,
    balance_contacts,
)
from tactile_dynamics_ros.core.inertia.residuals.sensitivity import (
    contact_sensitivity,
    force_sensitivity_of_effects,
    motion_sensitivity,
)
from tactile_dynamics_ros.core.numerics.banded import VARIANCE_FLOOR, BandedWhitener
from tactile_dynamics_ros.core.numerics.local_polynomial import Window
from tactile_dynamics_ros.core.numerics.noise import expected_noise
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.streams.streams import Streams, nearest_samples

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


_UNREAD_VARIANCE = 1e6
"""Variance that removes samples whose time-shifted motion is not recorded: (1 kN)^2, (1 kN m)^2."""
_READ_NEAR = 0.75
"""Distance from a sample, in periods, up to which time-shifted motion counts as recorded: at 1 the
motion before a recording does; below 0.5 that between two samples does not."""
_MINIMUM_SAMPLES = 10
"""Samples with motion and contact that a recording needs: sixty equations for ten unknowns. More
would refuse short recordings that show a mass; of fewer the noise could not be read either."""
_SMOOTHING_PERIODS = 5.5
"""Half width of the regressors' windows in periods of the poses, at least: eleven poses for the
seven coefficients of their polynomials. It widens windows of poses below 34 Hz; less would hardly
smooth these, more would cut their motion."""


@dataclass(frozen=True)
class ProblemConfig:
    """How raw streams become residuals."""

    window_half_width: float = parameter(
        0.07,
        "half width of the tapered motion windows of the residual",
        "s",
        0.005,
        0.5,
    )
    window_degree: int = parameter(6, "their degree", "", 2, 6)
    regressor_half_width: float = parameter(
        0.16,
        "half width of the motion windows of the regressors",
        "s",
        0.005,
        0.5,
    )
    regressor_degree: int = parameter(6, "their degree", "", 2, 6)
    maximum_rate: float = parameter(125.0, "grid rate above which forces are averaged", "Hz", 1.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)

    def windows(self, period: float) -> tuple[Window, Window]:
        """Those of residuals and of regressors, of poses with this period.

        Slow poses would leave the latter too few samples to smooth.
        """
        wide = max(self.regressor_half_width, _SMOOTHING_PERIODS * period)
        return (
            Window(self.window_half_width, self.window_degree, tapered=True),
            Window(wide, self.regressor_degree),
        )


@dataclass(frozen=True)
class WrenchProblem:
    """Residuals of one stretch of a recording.

    Attributes:
        raw: measured signals, motion with the short windows of the residual.
        wide: the same with the wide windows of the regressors.
        smooth: wide windows on signals at their expected true values.
        extra_variance: (N,) additional variance of each residual, for isolated outliers.
        lacking: (valid samples, 6) wrench that the contact forces of `samples` take on so that they
            balance the model; None before the first fit.
    """

    raw: SampledSignals
    wide: SampledSignals
    smooth: SampledSignals
    extra_variance: Array
    lacking: Array | None = None

    @classmethod
    def from_streams(
        cls,
        streams: Streams,
        config: ProblemConfig | None = None,
        span: tuple[float, float] | None = None,
        start: float | None = None,
    ) -> WrenchProblem:
        """Read the streams on a grid.

        Args:
            streams: measurements.
            config: windows and rates.
            span: only grid times in [span[0], span[1]) are used.
            start: time origin that effects see; the first grid time by default.

        Raises:
            BadInputError: too few samples with contact and motion.
        """
        config = config or ProblemConfig()
        grid = choose_grid(streams, config.maximum_rate)
        origin = float(grid[0]) if start is None else start
        if span is not None:
            grid = grid[(grid >= span[0]) & (grid < span[1])]
        motion, smooth = (
            motion_signals(streams, grid, window, GRAVITY_W)
            for window in config.windows(motion_period(streams))
        )
        places = carried_places(streams)
        contacts = tuple(
            contact_signals(c, grid, places.get(c.name), len(streams.contacts) == 1)
            for c in streams.contacts.values()
            if len(c.time) > 1 and len(c.pose_time) > 1
        )
        held = np.any([c.in_contact for c in contacts], axis=0)
        valid = np.all([motion.valid, smooth.valid, held, *(c.valid for c in contacts)], axis=0)
        if valid.sum() < _MINIMUM_SAMPLES:
            raise BadInputError(
                f"only {int(valid.sum())} of {len(grid)} samples have motion and contact together; "
                f"expected at least {_MINIMUM_SAMPLES}: check that /contact/*/force and "
                "/object/pose overlap"
            )
        raw = SampledSignals(grid, origin, valid, motion, contacts, streams.session_starts)
        wide = replace(raw, motion=smooth)
        return cls(raw, wide, wide, np.zeros(len(grid)))

    @classmethod
    def try_from_streams(
        cls,
        streams: Streams,
        config: ProblemConfig,
        span: tuple[float, float],
        start: float,
    ) -> WrenchProblem | None:
        """`from_streams`, or None where the stretch holds too few samples."""
        try:
            return cls.from_streams(streams, config, span, start)
        except BadInputError:
            return None

    @property
    def grid(self) -> Array:
        """(N,) s."""
        return self.raw.grid

    @property
    def start(self) -> float:
        """Time (s) that is zero for effects."""
        return self.raw.start

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(N,) grid times that enter the estimation."""
        return self.raw.valid

    @property
    def contacts(self) -> tuple[ContactSignals, ...]:
        """Measured contact signals."""
        return self.raw.contacts

    @property
    def count(self) -> int:
        """Number N of valid samples."""
        return int(self.valid.sum())

    @property
    def measured(self) -> WrenchSamples:
        """Measured forces and motion by short windows, valid samples only."""
        return self.raw.samples

    @cached_property
    def samples(self) -> WrenchSamples:
        """Denoised forces and motion by wide windows, valid samples only; what effects see."""
        samples = self.smooth.samples
        return samples if self.lacking is None else balance_contacts(samples, self.lacking)

    @property
    def regressor(self) -> Array:
        """(N, 6, 10) Newton-Euler regressor of the denoised samples."""
        return self.smooth.regressor

    def regressor_noise(self, linearisation: Linearisation, seed: int = 0) -> Array:
        """(N, 6, 10) one draw of how noise that is left of the poses moves `regressor`."""
        denoised = self.smooth is not self.wide
        left = linearisation.draw_errors(np.random.default_rng(seed), denoised)
        return np.asarray(self.smooth.corrected(left).regressor - self.regressor)

    def residual(
        self, phi: Array, effects: Sequence[Effect] = (), theta: Sequence[Array] = ()
    ) -> Array:
        """Residual e = Y phi - w - sum Delta(theta), (N, 6) [torque, force], body frame.

        As `linearise` assumes, what effects add to the load is moved as is measured, noise
        included; effects on the forces correct the measured ones, noise included; and those on the
        clocks shift the measured motion by whole samples.
        """
        present = PresentEffects(effects, theta)
        moved = present.moved_load(phi)
        value = self._measured_regressor @ moved - self.regressor @ (moved - phi)
        value = value - self.measured.measured_wrench
        value = value - present.wrench(self._measured_contacts, phi)
        for effect, parameters in zip(effects, theta, strict=True):
            late, rounded = effect.whole_samples_late(parameters, self._period)
            if late:
                value = value + effect.wrench(self._measured_contacts, moved, rounded)
                value = value - effect.wrench(self.measured, moved, rounded)
        return np.asarray(value)

    @cached_property
    def _measured_regressor(self) -> Array:
        """(N, 6, 10) regressor of the measured motion, linear in the noise of its angular velocity.

        Y(w) - Y(w - w_smooth) with no acceleration: the square of that noise, which a covariance by
        first order does not know, is as large as the noise of the forces where poses are slow.
        """
        noise = self.measured.angular_velocity - self.smooth.samples.angular_velocity
        return self.raw.regressor - regressor(np.zeros_like(noise), noise, np.zeros_like(noise))

    @cached_property
    def _measured_contacts(self) -> WrenchSamples:
        """Denoised motion with measured forces and torques."""
        measured = self.measured
        return self.samples.with_forces(measured.contact_force, measured.contact_torque)

    def smooth_residual(
        self, phi: Array, effects: Sequence[Effect] = (), theta: Sequence[Array] = ()
    ) -> Array:
        """Predicted minus measured wrench, (N, 6), with motion by wide windows."""
        predicted = self.wide.regressor @ phi - self.wide.samples.measured_wrench
        return np.asarray(predicted - PresentEffects(effects, theta).wrench(self.samples, phi))

    def linearise(
        self, phi: Array, effects: Sequence[Effect] = (), theta: Sequence[Array] = ()
    ) -> Linearisation:
        """Covariance and whitening of the residual for given parameters."""
        by_force = force_sensitivity_of_effects(self.samples, phi, effects, theta)
        moved = PresentEffects(effects, theta).moved_load(phi)
        late = sum(
            effect.whole_samples_late(value, self._period)[0]
            for effect, value in zip(effects, theta, strict=True)
        )
        now, places = np.arange(self.count), np.flatnonzero(self.valid)
        wanted = self.samples.time - late * self._period
        then = nearest_samples(self.samples.time, wanted)
        unread = np.abs(wanted - self.samples.time[then]) > _READ_NEAR * self._period
        names, found = [], []
        for name, signal, sensitivity in self._signals(moved):
            if name in by_force:
                sensitivity = sensitivity + by_force[name]
            rows = now if name.startswith(("force:", "torque:")) else then
            names.append(name)
            found.append(Sensitivity(signal, sensitivity[rows], places[rows]))
        extra = np.where(unread, _UNREAD_VARIANCE, self.extra_variance[self.valid] + VARIANCE_FLOOR)
        matrices = [one.matrix() for one in found]
        whitener = BandedWhitener.from_sensitivities(matrices, np.repeat(extra, 6))
        return Linearisation(tuple(names), tuple(found), whitener)

    def denoised(self, corrections: dict[str, Array]) -> WrenchProblem:
        """Return the problem whose regressors see the measured signals moved by corrections."""
        return replace(self, smooth=self.wide.corrected(corrections), lacking=None)

    def balanced(
        self, phi: Array, effects: Sequence[Effect] = (), theta: Sequence[Array] = ()
    ) -> WrenchProblem:
        """Return the problem whose denoised contact forces balance the model."""
        lacking = self.regressor @ phi - self.samples.measured_wrench
        present = PresentEffects(effects, theta)
        return replace(self, lacking=lacking - present.wrench(self.samples, phi))

    def with_extra_variance(self, extra_variance: Array) -> WrenchProblem:
        """Return the problem with isolated outliers down-weighted; (valid samples,) variances."""
        spread = np.zeros(len(self.grid))
        spread[self.valid] = extra_variance
        return replace(self, extra_variance=spread)

    def _signals(self, load: Array) -> list[tuple[str, LatentSignal, Array]]:
        """Latent signals with what they do to the residual of an accelerated load (10,)."""
        samples, motion = self.samples, self.raw.motion
        carried = np.array([contact.carried for contact in self.contacts])
        by_motion = motion_sensitivity(
            samples, load, motion.specific_force is not None, motion.gyro is not None, carried
        )
        found = [(n, signal, by_motion[n]) for n, signal in motion.charted_signals.items()]
        for index, contact in enumerate(self.contacts):
            by_contact = contact_sensitivity(samples, index, contact.carried)
            found += [
                (f"{name}:{contact.name}", signal, by_contact[name])
                for name, signal in contact.signals.items()
            ]
        return found

    @property
    def _period(self) -> float:
        """Of the grid, s."""
        return float(np.median(np.diff(self.grid)))


@dataclass(frozen=True)
class Linearisation:
    """Whitening at one value of the parameters.

    Attributes:
        names: of the latent signals.
        sensitivities: A = (de/dx) S per signal.
        whitener: Cholesky factor L of C = sum A A^T.
    """

    names: tuple[str, ...]
    sensitivities: tuple[Sensitivity, ...]
    whitener: BandedWhitener

    @property
    def factors(self) -> tuple[Array, ...]:
        """Noise factors S per signal."""
        return tuple(moves.signal.noise_factor for moves in self.sensitivities)

    def whiten(self, values: Array) -> Array:
        """L^-1 of (N, 6) or (N, 6, m) values, as (6 N,) or (6 N, m)."""
        return self.whitener.whiten(values.reshape(-1, *values.shape[2:]))

    def draw_noise(self, rng: np.random.Generator) -> Array:
        """(6 N,) one draw of the residual's noise, from that of every signal."""
        pairs = zip(self.sensitivities, self.factors, strict=True)
        parts = [a.moved(rng.normal(size=(len(factor), 3))) for a, factor in pairs]
        return np.asarray(np.sum(parts, axis=0))

    def draw_errors(self, rng: np.random.Generator, denoised: bool) -> dict[str, Array]:
        """One draw of the errors z - x of the motion, (K, 3) by name, or of what `denoise` leaves.

        The latter is a draw from the posterior of x: draw the noise of all signals, and take from
        it what is expected given the residual that it makes. Source: Matheron's rule; Doucet 2010.
        """
        standard = [rng.normal(size=(len(factor), 3)) for factor in self.factors]
        pairs = zip(self.names, self.factors, standard, strict=True)
        motion = (pair for pair in pairs if ":" not in pair[0])
        errors = {name: np.einsum("kij,kj->ki", factor, z) for name, factor, z in motion}
        if not denoised:
            return errors
        made = sum(a.moved(z) for a, z in zip(self.sensitivities, standard, strict=True))
        expected = self.denoise(self.whitener.whiten(np.asarray(made)))
        return {name: error + expected[name] for name, error in errors.items()}

    def denoise(self, white_residual: Array, trusting: bool = False) -> dict[str, Array]:
        """Expected errors x - z = -S A^T L^-T r of every signal, (K, 3) by name.

        Of residuals that stay large, motion is charged with the share of the noise only, unless the
        model is trusted; contacts with all, so that effects see forces that balance the model.
        """
        noise = white_residual if trusting else expected_noise(white_residual)
        share = self.whitener.whiten_transposed(np.stack([white_residual, noise], axis=1))
        corrections = {}
        for name, moves, factor in zip(self.names, self.sensitivities, self.factors, strict=True):
            standard = -moves.pulled_back(share[:, 0 if ":" in name else 1])
            corrections[name] = np.einsum("kij,kj->ki", factor, standard)
        return corrections
