"""Effects that each joint of an arm has by itself, with sizes of its own."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.joints.effects import JointEffect, JointReading, ReadingGroup
from tactile_dynamics_ros.core.joints.situation import Situation

_STEP = 1e-5
"""Step of central differences along the logarithm of a shape; their error is its square."""
_SHAPE_STD = 0.7
"""Prior std of the logarithm of a shape about where its search began: a factor of two. Grids of
shapes have steps of about two, so that one end of a step is no less likely than its middle."""
_TYPICAL_SHAPE = 0.05
"""Logarithm of a shape over its start at which an effect is plainly present in checks: small, as
families hold the effect at the start of its shape."""


@dataclass(frozen=True)
class PerJointEffect(JointEffect):
    """An effect that each joint may have with amplitudes of its own, and perhaps a shape.

    Delta_j = sum_a theta_ja f_a(motion of j; shape_j e^s_j): with a shape, s_j is the last
    parameter of each joint.

    Attributes:
        joints: numbers of those that have it; None for all.
        shapes: where the shape of each of these begins; one for all, or empty without a shape.
        named: names of the joints, for parameters.
    """

    joints: tuple[int, ...] | None = None
    shapes: tuple[float, ...] = ()
    named: tuple[str, ...] = ()

    amplitudes: ClassVar[tuple[EffectParameter, ...]]
    shape: ClassVar[EffectParameter | None] = None
    grid: ClassVar[tuple[float, ...]] = ()

    @abstractmethod
    def column(self, situation: Situation, joint: int, shape: float) -> Array:
        """(K, a) mean torque of each block on one joint, per amplitude."""

    @property
    def label(self) -> str:
        """Name with the joints that have it."""
        if self.joints is None or len(self.joints) == len(self.named):
            return self.name
        return f"{self.name}:{'+'.join(self.named[j] for j in self.joints)}"

    @property
    def can_be_gated(self) -> bool:
        """One joint or all: what two have in a part of a recording only would be chance."""
        return self.regional and len(self.which) != 2

    @property
    def which(self) -> tuple[int, ...]:
        """Numbers of the joints that have it."""
        return tuple(range(len(self.named) or 1)) if self.joints is None else self.joints

    @property
    def _each(self) -> int:
        """Parameters of one joint."""
        return len(self.amplitudes) + (self.shape is not None)

    def _shape_of(self, place: int) -> float:
        return self.shapes[min(place, len(self.shapes) - 1)] if self.shapes else self.grid[0]

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Amplitudes of each joint, and the logarithm of its shape over where it began."""
        found = []
        for j in self.which:
            end = f"_{self.named[j]}" if self.named else ""
            found += [replace(p, name=p.name + end) for p in self.amplitudes]
            if self.shape is not None:
                shape = self.shape
                found.append(
                    EffectParameter(
                        f"ln_{shape.name}{end}",
                        "",
                        _SHAPE_STD,
                        f"logarithm of {shape.description} over that at which the search began",
                        _TYPICAL_SHAPE,
                    )
                )
        return tuple(found)

    def scales(self) -> dict[str, tuple[str, float, str]]:
        """The shape of each joint."""
        if self.shape is None:
            return {}
        ends = [f"_{self.named[j]}" if self.named else "" for j in self.which]
        name, unit = self.shape.name, self.shape.unit
        return {
            f"ln_{name}{end}": (f"{name}{end}", self._shape_of(place), unit)
            for place, end in enumerate(ends)
        }

    def _parts(self, theta: Array) -> list[tuple[int, Array, float, float]]:
        """Joint, amplitudes, shape and its start for each joint that has it."""
        each, count = self._each, len(self.amplitudes)
        found = []
        for place, j in enumerate(self.which):
            own = theta[place * each : (place + 1) * each]
            first = self._shape_of(place) if self.grid else 0.0
            bend = float(own[count]) if self.shape is not None else 0.0
            found.append((j, own[:count], first * float(np.exp(bend)), first))
        return found

    def torque(self, situation: Situation, theta: Array) -> Array:
        """Each joint's own law."""
        found = np.zeros(situation.samples.effort.shape)
        for j, own, shape, _ in self._parts(theta):
            found[:, j] = self.column(situation, j, shape) @ own
        return found

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """Columns of the amplitudes; differences along the shape."""
        each, count = self._each, len(self.amplitudes)
        found = np.zeros((*situation.samples.effort.shape, each * len(self.which)))
        for place, (j, own, shape, _) in enumerate(self._parts(theta)):
            at = place * each
            found[:, j, at : at + count] = self.column(situation, j, shape)
            if self.shape is not None:
                more = self.column(situation, j, shape * np.exp(_STEP))
                less = self.column(situation, j, shape * np.exp(-_STEP))
                found[:, j, at + count] = (more - less) @ own / (2.0 * _STEP)
        return found

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """For each shape of the grid: all joints, each alone, and every two."""
        names = situation.samples.arm.names
        everywhere = tuple(range(len(names)))
        chosen = [everywhere, *((j,) for j in everywhere), *combinations(everywhere, 2)]
        found = []
        for shape in self.grid or (0.0,):
            columns = self._columns(situation, shape)
            shapes = (shape,) if self.grid else ()
            each = len(self.amplitudes)
            reading = f"{self.name}:{shape:g}" if self.grid else self.name
            readings = []
            for joints in chosen:
                own = replace(
                    self,
                    joints=None if joints == everywhere else joints,
                    shapes=shapes,
                    named=names,
                )
                kept = tuple(each * j + a for j in joints for a in range(each))
                readings.append(JointReading(own, own.label, kept))
            found.append(ReadingGroup(columns, tuple(readings), reading))
        return found

    def _columns(self, situation: Situation, shape: float) -> Array:
        count, n = situation.samples.effort.shape
        each = len(self.amplitudes)
        found = np.zeros((count, n, each * n))
        for j in range(n):
            found[:, j, each * j : each * (j + 1)] = self.column(situation, j, shape)
        return found

    def start(self, coefficients: Array) -> Array:
        """Amplitudes as in the columns, shapes where the search began."""
        if self.shape is None:
            return coefficients
        rows = coefficients.reshape(len(self.which), -1)
        return np.hstack([rows, np.zeros((len(rows), 1))]).reshape(-1)

    def where(self, names: Sequence[str]) -> str:
        """The joints that have it."""
        if self.joints is None or len(self.joints) == len(names):
            return ""
        return " and ".join(names[j] for j in self.joints)
