"""Smooth prescribed motion of the object with analytic derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CENTRE_W = np.array([0.5, 0.0, 0.6])


@dataclass(frozen=True)
class SumOfSines:
    """One sum of sines per axis; (A, K) amplitudes, frequencies in Hz and phases in rad."""

    amplitude: np.ndarray
    frequency_hz: np.ndarray
    phase: np.ndarray

    def evaluate(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return value, first and second derivative, each (N, A)."""
        omega = 2 * np.pi * self.frequency_hz
        angle = omega * time[:, None, None] + self.phase
        sine, cosine = np.sin(angle), np.cos(angle)
        value = (self.amplitude * sine).sum(-1)
        rate = (self.amplitude * omega * cosine).sum(-1)
        return value, rate, -(self.amplitude * omega**2 * sine).sum(-1)

    def scaled(self, factor: float) -> SumOfSines:
        """The same tones with all amplitudes multiplied."""
        return SumOfSines(factor * self.amplitude, self.frequency_hz, self.phase)

    @classmethod
    def draw(
        cls,
        rng: np.random.Generator,
        peaks: np.ndarray,
        band_hz: tuple[float, float],
        tones: int = 5,
    ) -> SumOfSines:
        """Draw random tones whose sum reaches the given peak on each axis."""
        shape = (len(peaks), tones)
        frequency = np.exp(rng.uniform(*np.log(band_hz), size=shape))
        amplitude = rng.uniform(0.5, 1.0, size=shape) / frequency**0.25
        sines = cls(amplitude, frequency, rng.uniform(0, 2 * np.pi, size=shape))
        reached = np.abs(sines.evaluate(np.linspace(0.0, 60.0, 3001))[0]).max(axis=0)
        return cls(amplitude * (peaks / reached)[:, None], frequency, sines.phase)


@dataclass(frozen=True)
class MotionSamples:
    """Motion of the body frame at N instants; vectors in world axes unless said otherwise.

    Attributes:
        time: (N,) s.
        position: (N, 3) of the body origin, m.
        velocity: (N, 3) of the body origin, m/s.
        acceleration: (N, 3) of the body origin, m/s^2.
        rotation: (N, 3, 3) R_WO.
        angular_velocity: (N, 3) rad/s.
        angular_acceleration: (N, 3) rad/s^2.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    rotation: np.ndarray
    angular_velocity: np.ndarray
    angular_acceleration: np.ndarray

    def to_world(self, vector: np.ndarray) -> np.ndarray:
        """Rotate a body vector, (3,) or (N, 3), to world axes."""
        return np.einsum("nij,j->ni" if vector.ndim == 1 else "nij,nj->ni", self.rotation, vector)

    def to_body(self, vector: np.ndarray) -> np.ndarray:
        """Rotate a world vector, (3,) or (N, 3), to body axes."""
        return np.einsum("nji,j->ni" if vector.ndim == 1 else "nji,nj->ni", self.rotation, vector)

    def point(self, point: np.ndarray) -> np.ndarray:
        """World position (N, 3) of a point that is fixed in the body."""
        return self.position + self.to_world(point)

    def point_velocity(self, point: np.ndarray) -> np.ndarray:
        """World velocity (N, 3) of a point that is fixed in the body."""
        return self.velocity + np.cross(self.angular_velocity, self.to_world(point))

    def point_acceleration(self, point: np.ndarray) -> np.ndarray:
        """World acceleration (N, 3) of a point that is fixed in the body."""
        arm = self.to_world(point)
        omega = self.angular_velocity
        centripetal = np.cross(omega, np.cross(omega, arm))
        return self.acceleration + np.cross(self.angular_acceleration, arm) + centripetal


@dataclass(frozen=True)
class Motion:
    """Position and yaw, pitch, roll of the object as sums of sines about a mean pose."""

    centre: np.ndarray
    mean_rotation: np.ndarray
    position: SumOfSines
    angles: SumOfSines

    def evaluate(self, time: np.ndarray) -> MotionSamples:
        """Return the motion and its exact derivatives at the given instants."""
        position, velocity, acceleration = self.position.evaluate(time)
        rotation, omega, alpha = _rotate(*self.angles.evaluate(time))
        rotation = self.mean_rotation @ rotation
        return MotionSamples(
            time=time,
            position=self.centre + position,
            velocity=velocity,
            acceleration=acceleration,
            rotation=rotation,
            angular_velocity=np.einsum("nij,nj->ni", rotation, omega),
            angular_acceleration=np.einsum("nij,nj->ni", rotation, alpha),
        )


def _rotate(
    angles: np.ndarray, rates: np.ndarray, seconds: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation Rz(yaw) Ry(pitch) Rx(roll), body angular velocity and its derivative."""
    (cy, cp, cr), (sy, sp, sr) = np.cos(angles).T, np.sin(angles).T
    rotation = np.stack(
        [
            np.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr], -1),
            np.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], -1),
            np.stack([-sp, cp * sr, cp * cr], -1),
        ],
        axis=-2,
    )
    (yaw, pitch, roll), (yaw2, pitch2, roll2) = rates.T, seconds.T
    omega = np.stack([roll - yaw * sp, pitch * cr + yaw * cp * sr, yaw * cp * cr - pitch * sr], -1)
    alpha = np.stack(
        [
            roll2 - yaw2 * sp - yaw * pitch * cp,
            pitch2 * cr
            - pitch * roll * sr
            + yaw2 * cp * sr
            + yaw * (roll * cp * cr - pitch * sp * sr),
            yaw2 * cp * cr
            - yaw * (pitch * sp * cr + roll * cp * sr)
            - pitch2 * sr
            - pitch * roll * cr,
        ],
        axis=-1,
    )
    return rotation, omega, alpha
