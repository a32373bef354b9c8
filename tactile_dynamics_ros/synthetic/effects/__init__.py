"""Hidden effects by name: those that the product's catalogue knows and those that it does not."""

from __future__ import annotations

from tactile_dynamics_ros.synthetic import randomness
from tactile_dynamics_ros.synthetic.effects import (
    external,
    internal,
    measurement,
    outside_sensor,
    outside_world,
)
from tactile_dynamics_ros.synthetic.effects.base import Bounds, Gated, HiddenEffect, Quantity
from tactile_dynamics_ros.synthetic.scenario import Scenario

_CATALOGUED = (
    external.ViscousDrag,
    external.QuadraticDrag,
    external.RotationalDrag,
    external.TetherSpring,
    external.HangingCable,
    external.UnsensedContact,
    internal.SpinningRotor,
    internal.SloshingMass,
    internal.AddedMass,
    internal.MassChange,
    internal.GravityTilt,
    measurement.ContactTorsion,
    measurement.ContactOffset,
    measurement.ForceBias,
    measurement.ForceDrift,
    measurement.ForceScale,
    measurement.SensorRotation,
    measurement.SensorLag,
    measurement.TimeOffset,
)
_UNKNOWN = (
    outside_world.MotorVibration,
    outside_world.MagneticPull,
    outside_world.DipolePull,
    outside_world.ChargePull,
    outside_world.StiffeningSpring,
    outside_world.CableStickSlip,
    outside_world.DryRubbing,
    outside_world.AerodynamicLift,
    outside_world.ExternalTaps,
    outside_world.WallContact,
    outside_sensor.SkinCreep,
    outside_sensor.TemperatureStep,
    outside_sensor.DeadZone,
    outside_sensor.CrossTalk,
    outside_sensor.PoseBacklash,
    outside_sensor.ForceHysteresis,
    outside_sensor.SaturatingSensor,
    outside_sensor.ElectricHum,
    outside_sensor.NonlinearGain,
)
_EVENTS = (internal.PayloadChange, internal.GraspShift)
CATALOGUE = tuple(effect.name for effect in _CATALOGUED)
EVENTS = (internal.PayloadChange.name,)
"""Names of what happens to an object in a hand; a grasp that shifts shows in its pose."""
OUTSIDE = tuple(effect.name for effect in _UNKNOWN)
_BY_NAME = {effect.name: effect for effect in (*_CATALOGUED, *_UNKNOWN, *_EVENTS)}


def create_hidden_effect(
    name: str, magnitude: float, seed: int, scenario: Scenario
) -> HiddenEffect:
    """Create a hidden effect; its direction, place and so on are drawn from the seed.

    Args:
        name: one of CATALOGUE, OUTSIDE or the events, with bounds where it acts in part:
            ``name[z<0.6]``.
        magnitude: multiple of the effect's typical size, 0 is off.
        seed: of the draw; equal seeds give equal directions at every magnitude.
        scenario: where and on what the effect acts.

    Raises:
        KeyError: there is no such effect; names those that exist.
        ValueError: the bounds cannot be read.
    """
    name, _, bounds = name.partition("[")
    if bounds:
        inner = create_hidden_effect(name, magnitude, seed, scenario)
        return Gated(magnitude, inner, Bounds.read(bounds.removesuffix("]")))
    if name not in _BY_NAME:
        raise KeyError(f"no hidden effect {name!r}; there are {', '.join(_BY_NAME)}")
    return _BY_NAME[name].draw(randomness.stream(seed, "effect", name), magnitude, scenario)


__all__ = ["CATALOGUE", "EVENTS", "OUTSIDE", "HiddenEffect", "Quantity", "create_hidden_effect"]
