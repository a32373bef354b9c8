"""What every effect of a pushed object is."""

from __future__ import annotations

from abc import ABC
from typing import ClassVar, Self

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion, Situation


class PushEffect(ABC):
    """A change of what acts, of the friction, a further wrench, or another value of a number.

    Attributes:
        name: API name. family: group in the catalogue.
        formula: the law in one line.
        looks_like: one plain sentence on the error that it leaves.
        sentence: subject and verb for a verdict.
        remedy: what to do about it.
        parameters: theirs; all zero is absent.
        adds_to: name of the common number of the model to which the parameter is added, with a
            wider prior; empty for none.
        sudden: whether it begins at one time, which an instance carries.
        lasting: whether it is an error of the sensor.
        of_joint: whether it is one of two parts on a joint, which alone can have it.
        of_parts: whether it means the same of two parts on a joint: a law of each part where it is,
            or of the sensor. A wrench at a point of one object does not.
        identifiable: whether pushes of one part determine it; a wrong gain looks like another load.
        start: s, when it begins; None where it is there all along, or not yet known.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    formula: ClassVar[str]
    looks_like: ClassVar[str]
    sentence: ClassVar[str]
    remedy: ClassVar[str]
    parameters: ClassVar[tuple[EffectParameter, ...]]
    adds_to: ClassVar[str] = ""
    sudden: ClassVar[bool] = False
    lasting: ClassVar[bool] = False
    of_joint: ClassVar[bool] = False
    of_parts: ClassVar[bool] = False
    identifiable: ClassVar[bool] = True
    start: float | None = None

    def from_time(self, start: float) -> Self:
        """The effect that begins at a time, s."""
        made = type(self)()
        made.start = start
        return made

    def beginnings(self, push_starts: Array) -> list[Self]:
        """The effect, or if it is sudden one for each push after the first with which it may begin.

        Args:
            push_starts: (K,) s.
        """
        if not self.sudden or self.start is not None:
            return [self]
        return [self.from_time(float(start)) for start in push_starts[1:]]

    @property
    def label(self) -> str:
        """Name, with what has to be chosen of it: when it begins."""
        return self.name if self.start is None else f"{self.name} at {self.start:.2f} s"

    @property
    def choices(self) -> dict[str, float]:
        """What was chosen of it beside its parameters and its time, by name."""
        return {}

    def since(self, time: Array) -> Array:
        """(R,) 1 from its beginning on, else 0."""
        begin = -np.inf if self.start is None else self.start
        return np.asarray(time >= begin, dtype=float)

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """What acts really, given what was measured or presumed."""
        return situation

    def friction(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """Matrices (R, 2, 2) on the friction force, axes of the support; None for the identity.

        The torque is multiplied by half the trace.
        """
        return None

    def rise(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """Relative rise (R, 2) of friction under the footprint, 1/m, axes of the support.

        None where all points of the footprint have the same factor.
        """
        return None

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array | None:
        """Further force (axes of the support) and torque (R, 3) about the footprint's centroid."""
        return None

    def family_thetas(self) -> Array | None:
        """Parameters (m, k) whose effects, each over its size, span the effect; None: near zero.

        An effect whose parameters multiply each other is not linear near absence.
        """
        return None

    def guess(self, coefficients: Array) -> Array:
        """Parameters (k,) from the coefficients (m,) of what spans the effect."""
        return coefficients

    def is_possible(self, theta: Array) -> bool:
        """Whether parameters are such that the effect can exist."""
        pairs = zip(self.parameters, theta, strict=True)
        return all(parameter.allows(value) for parameter, value in pairs)


class WrappedEffect(PushEffect):
    """Another effect under a condition: what spans it and what can exist is as without.

    Attributes:
        inner: the effect.
    """

    inner: PushEffect

    def family_thetas(self) -> Array | None:
        """Those of the inner effect."""
        return self.inner.family_thetas()

    def guess(self, coefficients: Array) -> Array:
        """That of the inner effect."""
        return self.inner.guess(coefficients)

    def is_possible(self, theta: Array) -> bool:
        """Whether the inner effect can exist."""
        return self.inner.is_possible(theta)
