"""What every effect is: a wrench that the rigid-body model lacks, with derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.parameter import EffectParameter, ParameterSum
from tactile_dynamics_ros.core.errors import BadInputError

_NO_LOAD = np.zeros(10)
"""Dynamic parameters of no body, for laws that do not depend on them and for effects that add none.
Another body would only matter to the latter: it would count as part of the load."""


class Effect(ABC):
    """A physical or sensing effect Delta(theta) with measured_wrench + Delta = Y phi.

    External wrenches on the object: Delta is that wrench. Errors of measurement: Delta is the
    corrected minus the measured wrench. [torque, force], body frame about the origin;
    theta = 0 is absent. An instance is one reading of the name; `readings` lists the others.

    Attributes:
        name: API name.
        family: group in the catalogue.
        formula: the law in one line.
        looks_like: one plain sentence on the residual that it leaves.
        sentence: subject and verb for a verdict, "the object drags through something viscous".
        remedy: what to do about it.
        rings: whether it can oscillate at a frequency that the motion does not have.
        lasting: whether it is an error of a sensor that lasts, or cannot be distinguished from one.
        external: whether it is a wrench on the object and no error of what sensors read: sensors
            that are late show it late.
        delays: whether it makes sensors late; `delayed` says how.
        linear: whether it is linear in theta, with columns that the load does not change.
        event: whether it is something that changes at one time: it acts from a time on only.
        contains: name of a simpler effect that it has in it, as a drift contains a bias.
        per_session: whether each of several recordings has its own parameters.
        reading: which reading of the name this instance is; empty for the default.
    """

    name: ClassVar[str] = ""
    family: ClassVar[str] = ""
    formula: ClassVar[str] = ""
    looks_like: ClassVar[str] = ""
    sentence: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    rings: ClassVar[bool] = False
    lasting: ClassVar[bool] = False
    external: ClassVar[bool] = True
    delays: ClassVar[bool] = False
    linear: ClassVar[bool] = False
    event: ClassVar[bool] = False
    contains: ClassVar[str] = ""
    per_session: ClassVar[bool] = False
    reading: str = ""

    @property
    def label(self) -> str:
        """Name with the reading, for example ``sensor_lag:world``."""
        return f"{self.name}:{self.reading}" if self.reading else self.name

    @property
    def screened_as(self) -> str:
        """What readings with the same `screening_basis` have in common; the label by default."""
        return self.label

    def with_reading(self, reading: str) -> Effect:
        """Return the reading of that name.

        Raises:
            BadInputError: the effect has no such reading.
        """
        if reading:
            raise BadInputError(f"effect '{self.name}' has no reading '{reading}'")
        return self

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """All readings of the name that these samples can tell apart, the default first."""
        return (self,)

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """Simpler forms of this reading, each with the columns of the screening basis it keeps.

        Effects of every finger restrict to some of the fingers; most have no simpler form.
        """
        return ()

    def freest(self) -> tuple[Effect, ...]:
        """Readings of the name that this one may be a restriction of, or look like, anywhere.

        Parameters of the same name mean the same, but for the axes that some recordings cannot
        tell.
        """
        return (self,)

    @abstractmethod
    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Parameters theta, k of them."""

    def sums(self, samples: WrenchSamples) -> tuple[ParameterSum, ...]:
        """Sums of parameters that may be known where the parameters are not; none by default."""
        return ()

    @abstractmethod
    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Delta (N, 6) for dynamic parameters (10,) and theta (k,)."""

    @abstractmethod
    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Derivative d Delta / d theta, (N, 6, k)."""

    def factored(self, samples: WrenchSamples, theta: Array) -> tuple[Array, Array] | None:
        """Jacobian as columns (N, 6, b) that neither theta nor the load changes, times (b, k).

        None where it has no such form.
        """
        if not self.linear:
            return None
        zero = self.zero(samples)
        return self.jacobian(samples, _NO_LOAD, zero), np.eye(len(zero))

    def coefficients(self, samples: WrenchSamples, theta: Array) -> Array | None:
        """Numbers (b,) by which the columns of `factored` give Delta; None where it has none."""
        return theta if self.linear else None

    def inertia_jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Derivative d Delta / d phi, (N, 6, 10); zero unless the effect depends on the load."""
        return np.zeros((len(samples.time), 6, 10))

    def screening_basis(self, samples: WrenchSamples, inertia: Array) -> Array:
        """Linear family (N, 6, m) that contains the effect near absence, for the score test."""
        return self.jacobian(samples, inertia, self.zero(samples))

    def initial_guess(
        self, samples: WrenchSamples, inertia: Array, coefficients: Array, residual: Array
    ) -> Array:
        """Start theta (k,) of a refit.

        Args:
            samples: motion and contacts.
            inertia: (10,) dynamic parameters.
            coefficients: (m,) of the screening basis.
            residual: (N, 6) what the present model lacks.
        """
        return np.asarray(coefficients, dtype=float)

    def zero(self, samples: WrenchSamples) -> Array:
        """Parameters of the absent effect."""
        return np.zeros(len(self.parameters(samples)))

    def delayed(self, samples: WrenchSamples, theta: Array, columns: Array) -> Array:
        """What sensors with this effect show of wrenches.

        Args:
            samples: motion and contacts.
            theta: (k,) parameters.
            columns: (N, 6, ...) wrenches, or their derivatives, body frame.
        """
        return columns

    def moved_load(self, inertia: Array, theta: Array) -> Array:
        """Dynamic parameters (10,) that are accelerated with the load, beyond its own.

        Noise of the motion acts on them as it does on the load.

        Args:
            inertia: (10,) dynamic parameters of the load.
            theta: (k,) parameters.
        """
        return _NO_LOAD

    def load_after(self, inertia: Array, theta: Array) -> Array | None:
        """Dynamic parameters (10,) of the load after an event; None for what does not change it.

        Args:
            inertia: (10,) dynamic parameters of the load before.
            theta: (k,) parameters.
        """
        return None

    def unseen_gain(self, samples: WrenchSamples, theta: Array, std: Array) -> float:
        """Standard deviation of a gain common to all sensors, which no data show; 0 for none.

        All measured wrenches times a factor are those of a body as many times as heavy, so that the
        ten dynamic parameters are uncertain by this share of themselves.

        Args:
            samples: of the recording.
            theta: (k,) found.
            std: (k,) of theta.
        """
        return 0.0

    def is_possible(self, samples: WrenchSamples, inertia: Array, theta: Array) -> bool:
        """Whether parameters are such that the effect can exist; a fit may leave that.

        Args:
            samples: of the recording.
            inertia: (10,) dynamic parameters.
            theta: (k,) parameters.
        """
        pairs = zip(self.parameters(samples), theta, strict=True)
        return all(parameter.allows(value) for parameter, value in pairs)

    def whole_samples_late(self, theta: Array, period: float) -> tuple[int, Array]:
        """By how many samples forces are late against the motion, and theta of exactly that.

        Args:
            theta: (k,) parameters.
            period: of the samples, s.
        """
        return 0, theta

    def typical(self, samples: WrenchSamples) -> Array:
        """Parameters at which the effect is plainly present."""
        return np.array([p.typical for p in self.parameters(samples)])


class LinearEffect(Effect):
    """An effect that is linear in theta: subclasses give the columns only."""

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Columns times theta."""
        return np.asarray(self.jacobian(samples, inertia, theta) @ theta)
