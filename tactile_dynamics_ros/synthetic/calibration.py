"""How large an effect must be to raise the whitened error of a rigid-body fit to a given value.

Everything here is free of noise: the excess is the part of the readings that no rigid body
explains, over the spectrum that the sensors' noise gives each channel. White noise of a pose
becomes noise of the inertial force that grows with the square of the frequency: a fast
disturbance can only be distinguished from a fast motion if it is large. Correlations between
channels are left out: the whitened error of a careful estimator comes near the target but does not
equal it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline

from tactile_dynamics_ros.synthetic.effects import HiddenEffect
from tactile_dynamics_ros.synthetic.motion import MotionSamples
from tactile_dynamics_ros.synthetic.scenario import Scenario, Truth
from tactile_dynamics_ros.synthetic.sensors import Readings, SensorOptions, perfect_readings


def magnitude_for_whitened_rms(
    effect: HiddenEffect,
    target: float,
    scenario: Scenario,
    sensors: SensorOptions | None = None,
    tolerance: float = 0.02,
) -> float:
    """Find the magnitude at which the whitened error is about the target.

    Args:
        effect: drawn at any magnitude; its directions are kept.
        target: whitened RMS; 1 is the noise floor and gives magnitude 0.
        scenario: what the effect disturbs.
        sensors: their noise.
        tolerance: relative, on the excess above the noise floor.

    Returns:
        The magnitude, or the largest that the effect allows where the target is out of reach.
    """
    wanted = np.sqrt(max(target**2 - 1.0, 0.0))
    if wanted == 0.0:
        return 0.0
    largest = getattr(effect, "maximal_magnitude", np.inf)
    magnitude = min(1.0, largest)
    for _ in range(12):
        found = excess_rms(dataclasses.replace(effect, magnitude=magnitude), scenario, sensors)
        ratio = wanted / max(found, 1e-6)
        if abs(ratio - 1) < tolerance or (ratio > 1 and magnitude == largest):
            break
        magnitude = min(magnitude * np.clip(ratio, 0.05, 20.0), largest)
    return float(magnitude)


def excess_rms(
    effect: HiddenEffect, scenario: Scenario, sensors: SensorOptions | None = None
) -> float:
    """Whitened RMS of what a rigid body leaves unexplained in readings without noise."""
    truth, left, density = _unexplained(effect, scenario, sensors or SensorOptions())
    return float(np.sqrt(_excess(left, truth.scene.time, *density).mean()))


def excess_by_channel(
    effect: HiddenEffect, scenario: Scenario, sensors: SensorOptions | None = None
) -> dict[str, np.ndarray]:
    """Squares of `excess_rms` of each channel (6,) in body axes and in world axes.

    In world axes the noise of forces, and of torques, counts as the same along all axes.
    """
    truth, left, density = _unexplained(effect, scenario, sensors or SensorOptions())
    turned = np.einsum("nij,nkj->nki", truth.scene.motion.rotation, left.reshape(-1, 2, 3))
    alike = [np.repeat(values.reshape(2, 3).mean(axis=1), 3) for values in density]
    time = truth.scene.time
    return {
        "body": _excess(left, time, *density),
        "world": _excess(turned.reshape(-1, 6), time, *alike),
    }


def _unexplained(
    effect: HiddenEffect, scenario: Scenario, sensors: SensorOptions
) -> tuple[Truth, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Truth, the wrench (N, 6) that no rigid body explains (body axes) and the noise densities."""
    stride = max(1, round(scenario.options.physics_rate_hz / 100.0))
    truth = scenario.simulate((effect,), stride)
    readings = effect.output(effect.transduce(perfect_readings(truth)))
    measured = measured_wrench(readings)
    slow, fast = noise_density(truth, sensors)
    regressor = rigid_body_regressor(truth.scene.motion, truth.scene.gravity)
    rows = (regressor / slow[:, None]).reshape(-1, 10)
    aim = (measured / slow).reshape(-1)
    parameters = np.linalg.lstsq(rows, aim, rcond=None)[0]
    return truth, measured - regressor @ parameters, (slow, fast)


def _excess(left: np.ndarray, time: np.ndarray, slow: np.ndarray, fast: np.ndarray) -> np.ndarray:
    """Mean square (6,) of each channel over the spectrum of its noise."""
    left = left * np.sqrt(2.0 / len(left))
    spectrum = np.fft.rfft(left, axis=0)[1:]
    omega = 2 * np.pi * np.fft.rfftfreq(len(left), time[1] - time[0])[1:]
    power = np.abs(spectrum) ** 2 / (slow**2 + (fast * omega[:, None] ** 2) ** 2)
    constant = np.abs(left.sum(axis=0)) ** 2 / (2.0 * slow**2)
    return np.asarray((power.sum(axis=0) + constant) / len(left))


def measured_wrench(readings: Readings) -> np.ndarray:
    """Sum of the reported contact wrenches about the reported origin, (N, 6) body axes."""
    force_W = np.einsum("ncij,ncj->nci", readings.contact_rotation, readings.force)
    force_W = _shifted(force_W, readings, readings.force_delay - readings.pose_delay)
    point_W = _shifted(
        readings.contact_position, readings, readings.contact_delay - readings.pose_delay
    )
    arm = np.einsum("nji,ncj->nci", readings.rotation, point_W - readings.position[:, None])
    force = np.einsum("nji,ncj->nci", readings.rotation, force_W)
    force = np.where(readings.weight[..., None] > 0, force, 0.0)
    return np.concatenate([np.cross(arm, force).sum(1), force.sum(1)], axis=1)


def rigid_body_regressor(motion: MotionSamples, gravity: np.ndarray) -> np.ndarray:
    """(N, 6, 10) wrench per mass, first moment and inertia about the origin, body axes."""
    specific = motion.to_body(motion.acceleration - gravity)
    omega, alpha = (
        motion.to_body(motion.angular_velocity),
        motion.to_body(motion.angular_acceleration),
    )
    columns = [np.concatenate([np.zeros_like(specific), specific], axis=1)]
    for axis in np.eye(3):
        moment = np.broadcast_to(axis, specific.shape)
        force = np.cross(alpha, moment) + np.cross(omega, np.cross(omega, moment))
        columns.append(np.concatenate([np.cross(moment, specific), force], axis=1))
    for row, column in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):
        unit = np.zeros((3, 3))
        unit[row, column] = unit[column, row] = 1.0
        torque = alpha @ unit + np.cross(omega, omega @ unit)
        columns.append(np.concatenate([torque, np.zeros_like(torque)], axis=1))
    return np.stack(columns, axis=-1)


def noise_density(truth: Truth, sensors: SensorOptions) -> tuple[np.ndarray, np.ndarray]:
    """Noise of the wrench balance: (6,) white part and (6,) part per squared angular frequency.

    Both are standard deviations per sample of the forces.
    """
    contacts, body = truth.scene.contacts, truth.scene.body
    touching = (contacts.weight > 0).astype(float)
    arm, total = contacts.point, truth.contact_force.sum(1)
    leverage = ((arm**2).sum(-1, keepdims=True) - arm**2) * touching[..., None]
    slower = np.sqrt(sensors.force_rate_hz / sensors.pose_rate_hz)
    position_std = sensors.position_std * slower
    twist = np.radians(sensors.rotation_std_deg) * slower
    torque_variance = sensors.force_std**2 * leverage.sum(1).mean(0)
    torque_variance += position_std**2 * ((total**2).sum(-1, keepdims=True) - total**2).mean(0)
    force_variance = np.full(3, sensors.force_std**2 * touching.sum(1).mean())
    white = np.sqrt(np.concatenate([torque_variance, force_variance]))
    growing = np.concatenate(
        [np.diag(body.inertia_com) * twist, np.full(3, body.mass * position_std)]
    )
    return white, growing


def _shifted(values: np.ndarray, readings: Readings, delay: float) -> np.ndarray:
    """What is found at a stamp when stamps are late by the delay."""
    if delay == 0.0:
        return values
    return CubicSpline(readings.time, values, axis=0)(readings.time - delay)
