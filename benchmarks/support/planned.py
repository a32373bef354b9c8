"""A second recording of the same object and effect, along a motion that somebody asked for."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.synthetic.motion import MotionSamples
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording
from tactile_dynamics_ros.synthetic.sensors import SensorOptions, read_sensors

_STEP = 1e-3


@dataclass(frozen=True)
class PlannedMotion:
    """Turns and shifts in world axes, sums of sines that fade in and out, from a pose.

    Attributes:
        centre: (3,) position from which the object is shifted, m.
        mean_rotation: (3, 3) attitude from which it is turned.
        frequency_hz: (K,); sine, cosine: (6, K) of rotation vector (rad) and shift (m).
        duration: s; ramp: s of the fading.
    """

    centre: np.ndarray
    mean_rotation: np.ndarray
    frequency_hz: np.ndarray
    sine: np.ndarray
    cosine: np.ndarray
    duration: float
    ramp: float

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Return the motion; derivatives by central differences over 1 ms."""
        before, now, after = (self._pose(time + shift) for shift in (-_STEP, 0.0, _STEP))
        omega = self._spin(now[0], before[0], after[0])
        earlier = self._spin(before[0], self._pose(time - 2 * _STEP)[0], now[0])
        later = self._spin(after[0], now[0], self._pose(time + 2 * _STEP)[0])
        return MotionSamples(
            time=time,
            position=now[1],
            velocity=(after[1] - before[1]) / (2 * _STEP),
            acceleration=(after[1] - 2 * now[1] + before[1]) / _STEP**2,
            rotation=now[0],
            angular_velocity=omega,
            angular_acceleration=(later - earlier) / (2 * _STEP),
        )

    def _pose(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = 2 * np.pi * time[:, None] * self.frequency_hz
        value = np.sin(angle) @ self.sine.T + np.cos(angle) @ self.cosine.T
        share = np.clip(np.minimum(time, self.duration - time) / self.ramp, 0.0, 1.0)
        value *= (share**3 * (10 - 15 * share + 6 * share**2))[:, None]
        return _turn(value[:, :3]) @ self.mean_rotation, self.centre + value[:, 3:]

    @staticmethod
    def _spin(now: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """World angular velocity from R' R^T."""
        rate = (after - before) @ np.swapaxes(now, 1, 2) / (2 * _STEP)
        return 0.5 * np.stack(
            [
                rate[:, 2, 1] - rate[:, 1, 2],
                rate[:, 0, 2] - rate[:, 2, 0],
                rate[:, 1, 0] - rate[:, 0, 1],
            ],
            axis=1,
        )


def _turn(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' rotation by (N, 3) rotation vectors."""
    angle = np.linalg.norm(vector, axis=1)[:, None, None]
    x, y, z = (vector / np.maximum(angle[:, 0], 1e-12)).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def record_plan(
    recording: HiddenRecording, plan: Mapping[str, Any], sensors: SensorOptions
) -> HiddenRecording:
    """Record the same object with the same hidden effects once more, moved as planned.

    Args:
        recording: the first one.
        plan: `separating_motion` of its diagnosis; of kind "regrasp", all fingers move half-way.
        sensors: as of the first one.
    """
    first = recording.scenario
    motion = PlannedMotion(
        first.motion.centre,
        first.motion.mean_rotation,
        *(np.asarray(plan[key]) for key in ("frequency_hz", "sine", "cosine")),
        plan["duration_s"],
        plan["ramp_s"],
    )
    options = dataclasses.replace(
        first.options,
        duration=plan["duration_s"],
        regrasp=plan["kind"] == "regrasp",
        thumb_moves=True,
        contact_breaks=0,
    )
    scenario = first.moved(motion, options)
    truth = scenario.simulate(recording.effects)
    streams = read_sensors(truth, recording.effects, sensors, first.seed + 1)
    return HiddenRecording(streams, scenario, recording.effects)
