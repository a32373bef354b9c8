"""Effects that several joints feel at once: neighbours, cables, gravity, warmth, clocks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.joints.effects import (
    JOINTS,
    JointEffect,
    JointReading,
    LinearJointEffect,
    ReadingGroup,
)
from tactile_dynamics_ros.core.joints.situation import Situation

_STEP = 1e-4
"""Step of central differences along the logarithm of a time; their error is its square."""
_INSTANT = 2e-3
"""Step of differences along a delay, s: a sample at 500 Hz. Within less, reversals make steps."""
_TIMES = (8.0, 20.0, 60.0)
"""Time constants of warming from which a fit begins, s: those of minutes look like 60 s in the
recordings of a minute that people make; steps of a factor of three leave little between them."""


@JOINTS.register
@dataclass(frozen=True)
class FrictionWarming(JointEffect):
    """Cold gears rub more: friction falls towards its warm value while the arm moves.

    Attributes:
        after: time constant at which the search began, s.
    """

    after: float = 20.0

    name = "friction_warming"
    family = "friction"
    formula = "c exp(-t/T) (F sign(q') + B q')"
    looks_like = "All joints rub more at the beginning than at the end of the recording."
    sentence = "friction falls as the gears warm up"
    remedy = "Let the arm move for some minutes before recordings that are compared."

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Share at the beginning, and the time constant over where its search began."""
        return (
            EffectParameter("c", "", 1.0, "friction in excess at the beginning, as a share", 0.4),
            EffectParameter("ln_T", "", 0.7, f"logarithm of T over {self.after:g} s", 0.05),
        )

    def _column(self, situation: Situation, after: float) -> Array:
        samples = situation.samples
        cold = np.exp(-samples.t / after)[..., None]
        return np.asarray(np.mean(cold * situation.rubbing, axis=1))

    def torque(self, situation: Situation, theta: Array) -> Array:
        """Excess of friction."""
        return np.asarray(theta[0] * self._column(situation, self.after * np.exp(theta[1])))

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """By the share, and by differences along the time constant."""
        more, less = (
            self._column(situation, self.after * np.exp(theta[1] + step))
            for step in (_STEP, -_STEP)
        )
        middle = self._column(situation, self.after * np.exp(theta[1]))
        return np.stack([middle, theta[0] * (more - less) / (2.0 * _STEP)], axis=2)

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """One reading for each time constant."""
        found = []
        for after in _TIMES:
            own = FrictionWarming(after)
            columns = self._column(situation, after)[..., None]
            label = f"{self.name}:{after:g}"
            found.append(ReadingGroup(columns, (JointReading(own, self.name, (0,)),), label))
        return found

    def scales(self) -> dict[str, tuple[str, float, str]]:
        """The time constant."""
        return {"ln_T": ("T", self.after, "s")}

    def start(self, coefficients: Array) -> Array:
        """The share, and no change of the time constant."""
        return np.append(coefficients, 0.0)


@JOINTS.register
@dataclass(frozen=True)
class JointCoupling(LinearJointEffect):
    """The motion of a neighbour drags on a joint, as in wrists with a differential or belts.

    Attributes:
        joint: number of the joint that feels it. by: number of the one that moves.
        names: of all joints.
    """

    joint: int = 1
    by: int = 0
    names: tuple[str, ...] = ()

    name = "joint_coupling"
    regional = True
    family = "drive"
    formula = "C sign(q'_neighbour) + D q'_neighbour"
    looks_like = "A joint's error follows the direction and speed of its neighbour."
    sentence = "the motion of a neighbouring joint drags on a joint"
    remedy = "Read positions and torques of coupled drives through the coupling's matrix."

    @property
    def label(self) -> str:
        """Name with both joints."""
        if not self.names:
            return self.name
        return f"{self.name}:{self.names[self.joint]}<{self.names[self.by]}"

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Of one pair."""
        at = f"_{self.names[self.joint]}" if self.names else ""
        return (
            EffectParameter(f"C{at}", "N m", 2.0, "drag of the neighbour's direction", 1.0),
            EffectParameter(f"D{at}", "N m s/rad", 2.0, "drag per speed of the neighbour", 1.0),
        )

    def columns(self, situation: Situation) -> Array:
        """Direction and speed of the neighbour."""
        samples = situation.samples
        found = np.zeros((*samples.effort.shape, 2))
        found[:, self.joint, 0] = samples.direction[:, :, self.by].mean(axis=1)
        found[:, self.joint, 1] = samples.dq[:, :, self.by].mean(axis=1)
        return found

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """Each pair of neighbours, both ways."""
        names = situation.samples.arm.names
        pairs = [(k, k + way) for k in range(len(names)) for way in (-1, 1)]
        found = []
        for joint, by in pairs:
            if 0 <= by < len(names):
                own = JointCoupling(joint, by, names)
                reading = JointReading(own, own.label, (0, 1))
                found.append(ReadingGroup(own.columns(situation), (reading,), own.label))
        return found

    def where(self, names: Sequence[str]) -> str:
        """The joint that feels it."""
        return f"{names[self.joint]}, dragged by {names[self.by]}"


@JOINTS.register
@dataclass(frozen=True)
class LinkCable(LinearJointEffect):
    """A cable or hose pulls on a link with a constant force.

    Attributes:
        link: number of the joint whose link is pulled on, at its origin; None for the last.
        names: of all joints.
    """

    link: int | None = None
    names: tuple[str, ...] = ()

    name = "link_cable"
    regional = True
    family = "outside"
    formula = "-J_link^T F"
    looks_like = "All joints up to a link err as if a constant force pulled on it, in any pose."
    sentence = "something pulls on a link with a constant force"
    remedy = "Lead cables along the arm, or subtract the force in the link's Jacobian."

    @property
    def label(self) -> str:
        """Name with the link's joint."""
        at = len(self.names) - 1 if self.link is None else self.link
        return f"{self.name}:{self.names[at]}" if self.names else self.name

    def parameters(self) -> tuple[EffectParameter, ...]:
        """The force in the axes of the base."""
        at = f"_{self.names[-1 if self.link is None else self.link]}" if self.names else ""
        return tuple(
            EffectParameter(
                f"F{at}_{axis}", "N", 20.0, f"force on the link in the base, {axis}", 5.0
            )
            for axis in "xyz"
        )

    def columns(self, situation: Situation) -> Array:
        """Torques per newton."""
        last = len(situation.samples.arm.names) - 1
        return situation.pull_on(last if self.link is None else self.link)

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """Each link from the third on: what pulls on those before has hardly a lever."""
        names = situation.samples.arm.names
        found = []
        for link in range(min(2, len(names) - 1), len(names)):
            own = LinkCable(link, names)
            reading = JointReading(own, own.label, (0, 1, 2))
            found.append(ReadingGroup(own.columns(situation), (reading,), own.label))
        return found

    def where(self, names: Sequence[str]) -> str:
        """The link."""
        return f"the link of {names[-1 if self.link is None else self.link]}"


@JOINTS.register
@dataclass(frozen=True)
class BaseTilt(LinearJointEffect):
    """The base leans: gravity is not along its z axis."""

    name = "base_tilt"
    family = "outside"
    formula = "tau(gravity + g (a, b, 0)) - tau(gravity)"
    looks_like = "Joints that should not feel gravity do, as if the arm stood on a slope."
    sentence = "the base of the arm leans against gravity"
    remedy = "Level the base, or tell the controller how the arm is mounted."

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Lean along the axes of the base."""
        return (
            EffectParameter("a", "rad", 0.1, "share of gravity along x of the base", 0.03),
            EffectParameter("b", "rad", 0.1, "share of gravity along y of the base", 0.03),
        )

    def columns(self, situation: Situation) -> Array:
        """Torques per radian."""
        axes = 9.81 * np.eye(3)[:2]
        return np.stack([situation.gravity_change(axis) for axis in axes], axis=2)


@JOINTS.register
@dataclass(frozen=True)
class TorqueDelay(JointEffect):
    """Torques are stamped later than positions."""

    name = "torque_delay"
    family = "sensor"
    formula = "tau(t - d) - tau(t)"
    looks_like = "Errors follow the rate of the torque in all joints, most at reversals."
    sentence = "torques are late against positions"
    remedy = "Record both from one cycle of the controller, or shift the torques' stamps."

    def parameters(self) -> tuple[EffectParameter, ...]:
        """One delay for all joints."""
        return (EffectParameter("d", "s", 0.03, "delay of the torques", 0.002),)

    def torque(self, situation: Situation, theta: Array) -> Array:
        """The model's torque of earlier, in place of that of now."""
        return situation.shifted(float(theta[0]))

    def jacobian(self, situation: Situation, theta: Array) -> Array:
        """By differences over some milliseconds: reversals make steps of a sample."""
        more, less = (situation.shifted(float(theta[0]) + s) for s in (_INSTANT, -_INSTANT))
        return np.asarray((more - less) / (2.0 * _INSTANT))[..., None]

    def groups(self, situation: Situation) -> list[ReadingGroup]:
        """One reading."""
        own = JointReading(self, self.name, (0,))
        return [ReadingGroup(self.jacobian(situation, np.zeros(1)), (own,), self.name)]
