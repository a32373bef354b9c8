"""Hidden effects of the simulated robot, physically, by code of its own.

The estimation side never imports this package, and this package never imports the catalogue of
effects: what is found has to be found in the measurements.
"""

from __future__ import annotations

import zlib

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError, nearest
from tactile_dynamics_ros.sim.hidden_effects import forces, outside, touch
from tactile_dynamics_ros.sim.hidden_effects.base import HiddenEffect, Plant, SensorView

_EFFECTS: tuple[type[HiddenEffect], ...] = (
    forces.ViscousDrag,
    forces.QuadraticDrag,
    forces.RotationalDrag,
    forces.TetherSpring,
    forces.HangingCable,
    forces.UnsensedContact,
    forces.SpinningRotor,
    forces.SloshingMass,
    forces.AddedMass,
    forces.MassChange,
    forces.GravityTilt,
    touch.ContactTorsion,
    touch.ContactOffset,
    touch.ForceBias,
    touch.ForceDrift,
    touch.ForceScale,
    touch.SensorRotation,
    touch.SensorLag,
    touch.TimeOffset,
    outside.MotorVibration,
    outside.MagneticPull,
    outside.CableStickSlip,
    outside.DryRubbing,
    outside.ExternalTaps,
    outside.SkinCreep,
    outside.TemperatureStep,
    outside.DeadZone,
    outside.CrossTalk,
    outside.PoseBacklash,
)
_BY_NAME = {effect.name: effect for effect in _EFFECTS}
CATALOGUED = tuple(effect.name for effect in _EFFECTS if effect.in_catalogue)
OUTSIDE = tuple(effect.name for effect in _EFFECTS if not effect.in_catalogue)


def known_effect(name: str) -> None:
    """Refuse the name of a hidden effect that does not exist.

    Raises:
        BadInputError: there is no such effect.
    """
    known = ("none", "random", "outside", *_BY_NAME)
    if name and name not in known:
        raise BadInputError(
            f"hidden effect '{name}' does not exist{nearest(name, known)}; expected one of "
            f"{', '.join(known)}"
        )


def create_hidden_effect(name: str, magnitude: float = 1.0, seed: int = 0) -> HiddenEffect:
    """Create a hidden effect for the simulated robot.

    Args:
        name: of an effect; "none" (or empty) for no effect; "random" for one of the catalogue and
            "outside" for one that is not in it, chosen by the seed.
        magnitude: multiple of the effect's typical size; 0 is off.
        seed: of everything that is drawn.

    Raises:
        BadInputError: there is no such effect, or the magnitude is negative or not a number.
    """
    if not (np.isfinite(magnitude) and magnitude >= 0):
        raise BadInputError(f"hidden effect magnitude {magnitude}: expected zero or more")
    choice = np.random.default_rng([seed, zlib.crc32(b"choice")])
    if name == "random":
        name = str(choice.choice(CATALOGUED))
    elif name == "outside":
        name = str(choice.choice(OUTSIDE))
    if name in ("", "none"):
        return HiddenEffect()
    known_effect(name)
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    return _BY_NAME[name](magnitude=magnitude, rng=rng)


__all__ = [
    "CATALOGUED",
    "OUTSIDE",
    "HiddenEffect",
    "Plant",
    "SensorView",
    "create_hidden_effect",
    "known_effect",
]
