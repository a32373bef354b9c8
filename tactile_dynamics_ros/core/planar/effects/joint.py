"""Effects of the joint of two parts."""

from __future__ import annotations

from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED


@PUSHED.register
class LooseJoint(PushEffect):
    """The joint of two parts has play: its pin is thinner than its hole."""

    name = "loose_joint"
    family = "joint"
    formula = "the pin lies anywhere within p of the middle of its hole"
    looks_like = "A part that is pushed moves by a millimetre before it takes the other along."
    sentence = "the joint of the two parts has play"
    remedy = "Tighten the joint; or keep the play, and push on each side of the joint."
    parameters = (
        EffectParameter("p", "m", 0.002, "radius of the hole less the pin's", 0.002, least=0.0),
    )
    of_joint = True
    identifiable = False
