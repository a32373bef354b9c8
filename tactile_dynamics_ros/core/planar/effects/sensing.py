"""Effects of the sensors: gains, directions, places and clocks of the forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.situation import Situation
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned


def _flat(situation: Situation, flat: Array) -> Situation:
    """The situation with other horizontal forces (R, 2)."""
    flat = np.where(situation.touching[:, None], flat, situation.force[:, :2])
    return replace(situation, force=np.column_stack([flat, situation.force[:, 2]]))


@PUSHED.register
class ForceBias(PushEffect):
    """The sensor reads a constant force too much, in its own axes."""

    name = "force_bias"
    family = "sensor"
    formula = "f_true = f_measured - R b, R by the pusher's axes"
    looks_like = "All pushes need as much force too much, or too little, at any load."
    sentence = "the force sensor reads a constant too much"
    remedy = "Tare the sensor while nothing is touched."
    parameters = (
        EffectParameter("b_n", "N", 1.0, "offset along the pusher's x axis, or the normal", 0.15),
        EffectParameter("b_t", "N", 1.0, "offset across it", 0.15),
    )
    of_parts = True
    lasting = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Forces without the offset."""
        offset = turned(np.broadcast_to(theta, (len(situation.time), 2)), situation.facing)
        return _flat(situation, situation.force[:, :2] - offset)


@PUSHED.register
class ForceScale(PushEffect):
    """The sensor's gain is wrong.

    Forces, mass and friction force times one factor obey the same equations: no push tells a wrong
    gain from another load, so that it is never named; a known mass would tell it.
    """

    name = "force_scale"
    family = "sensor"
    formula = "f_true = (1 + g) f_measured"
    looks_like = "All forces are too large or too small by one factor."
    sentence = "the gain of the force sensor is wrong"
    remedy = "Calibrate the sensor with a known weight."
    parameters = (EffectParameter("g", "", 0.3, "relative correction of the gain", 0.1),)
    of_parts = True
    lasting = True
    identifiable = False

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Forces by another gain."""
        return _flat(situation, situation.force[:, :2] + theta[0] * situation.expected[:, :2])


@PUSHED.register
class SensorRotation(PushEffect):
    """The sensor is mounted turned about the vertical."""

    name = "sensor_rotation"
    family = "sensor"
    formula = "f_true = R(a) f_measured"
    looks_like = "All forces point to the same side of where they should."
    sentence = "the force sensor is mounted turned"
    remedy = "Correct the mounting, or the transform of its frame."
    parameters = (EffectParameter("a", "rad", 0.2, "turn of the forces", 0.07),)
    of_parts = True
    lasting = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Forces turned back."""
        before = situation.expected[:, :2]
        after = turned(before, np.full(len(before), theta[0]))
        return _flat(situation, situation.force[:, :2] + after - before)


@PUSHED.register
class ContactOffset(PushEffect):
    """The contact is not where it is said to be, always by as much beside the tip."""

    name = "contact_offset"
    family = "sensor"
    formula = "point_true = point - R d, R by the pusher's axes"
    looks_like = "The object turns as if it were pushed beside the point that is reported."
    sentence = "the contact point is off"
    remedy = "Calibrate the tip of the pusher."
    parameters = (
        EffectParameter("d_n", "m", 0.01, "offset along the pusher's x axis, or the normal", 0.003),
        EffectParameter("d_t", "m", 0.01, "offset across it", 0.003),
    )
    of_parts = True
    lasting = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Points without the offset."""
        offset = turned(np.broadcast_to(theta, (len(situation.time), 2)), situation.facing)
        flat = situation.point[:, :2] - offset
        return replace(situation, point=np.column_stack([flat, situation.point[:, 2]]))


@PUSHED.register
class SensorLag(PushEffect):
    """The force sensor answers late, as a filter of first order does."""

    name = "sensor_lag"
    family = "sensor"
    formula = "f_true = f_measured + tau df/dt"
    looks_like = "The missing force follows the change of the force."
    sentence = "the force sensor lags"
    remedy = "Switch its filter off, or correct the lag."
    parameters = (EffectParameter("tau", "s", 0.03, "time constant", 0.01, least=0.0),)
    of_parts = True

    def changed(self, situation: Situation, theta: Array) -> Situation:
        """Forces ahead by the lag, to first order."""
        return _flat(situation, situation.force[:, :2] + theta[0] * situation.expected_rate[:, :2])


@PUSHED.register
class TimeOffset(PushEffect):
    """Forces and poses are stamped on clocks that differ by a constant."""

    name = "time_offset"
    family = "sensor"
    formula = "pose at t belongs to the force at t + d"
    looks_like = "Forces start and stop earlier, or later, than the object."
    sentence = "forces and poses are stamped on clocks that differ"
    remedy = "Synchronise the clocks, or shift the stamps."
    parameters = (EffectParameter("d", "s", 0.03, "delay of the forces' stamps", 0.01),)
    of_parts = True
    adds_to = "delay"
