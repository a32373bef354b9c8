"""Motion and contacts of one stretch on the grid, and forces that balance the model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import ContactSignals
from tactile_dynamics_ros.core.inertia.residuals.motion import Motion, MotionSignals
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor
from tactile_dynamics_ros.core.rigid_body.rotation import skew

_DAMPING = 1e-6
"""Added to the Gram matrix of the contacts' unit wrenches (about the number of contacts), so that
two fingers, which cannot resist a torque about their line, leave it solvable. Their share of that
torque is then left out; a force is short by a millionth of itself. A thousandth and more shortens
forces by as much, below rounding (1e-16) two fingers have no solution."""


def balance_contacts(samples: WrenchSamples, lacking: Array) -> WrenchSamples:
    """Change contact forces (and measured torques) least so that their wrench grows by `lacking`.

    Effects that scale or turn measured forces must not see the misfit in them: a common gain of
    -1 would remove any residual. With balanced forces a common gain is a larger mass, no more.

    Args:
        samples: motion and contacts.
        lacking: (N, 6) wrench that the model needs beyond the measured one, body frame.

    Returns:
        Samples with df = G^T (G G^T)^+ lacking, G the grasp map of the contacts that touch.
    """
    arms = skew(samples.contact_point)
    unit = np.broadcast_to(np.eye(3), arms.shape)
    length = max(float(np.sqrt(np.mean(samples.contact_point**2))), 1e-3)
    touching = samples.in_contact[:, :, None, None]
    scaled = np.concatenate([arms / length, unit], axis=2) * touching
    joined = scaled.swapaxes(1, 2).reshape(len(scaled), 6, -1)
    gram = joined @ joined.swapaxes(1, 2) + _DAMPING * np.eye(6)
    measured = bool(np.any(samples.contact_torque))
    if measured:
        gram[:, :3, :3] += samples.in_contact.sum(axis=1)[:, None, None] * np.eye(3)
    target = lacking * np.array([1.0 / length] * 3 + [1.0] * 3)
    weights = np.linalg.solve(gram, target[..., None])
    force = (weights.swapaxes(1, 2) @ joined).reshape(samples.contact_force.shape)
    torque = samples.contact_torque
    if measured:
        torque = torque + length * touching[..., 0] * weights[:, None, :3, 0]
    return samples.with_forces(samples.contact_force + force, torque)


@dataclass(frozen=True)
class SampledSignals:
    """Signals and what follows from them alone, computed once.

    Attributes:
        grid: (N,) s; start: s subtracted from the times that effects see.
        valid: (N,) grid times that enter the estimation.
        motion: kinematic signals. contacts: contact signals.
        session_starts: s on the grid, when each of several joined recordings begins.
    """

    grid: Array
    start: float
    valid: NDArray[np.bool_]
    motion: MotionSignals
    contacts: tuple[ContactSignals, ...]
    session_starts: tuple[float, ...] = ()

    @cached_property
    def _kinematics(self) -> Motion:
        return self.motion.evaluate()

    @cached_property
    def samples(self) -> WrenchSamples:
        """Forces and motion at the valid grid times."""
        motion, keep = self._kinematics, self.valid
        to_body = np.swapaxes(motion.rotation, 1, 2)[:, None]
        readings = [contact.evaluate() for contact in self.contacts]
        force, torque, point = (np.stack(part, axis=1) for part in zip(*readings, strict=True))
        frames = np.stack([contact.rotation for contact in self.contacts], axis=1)
        carried = np.array([contact.carried for contact in self.contacts])
        on_body = np.where(carried[:, None, None], frames, to_body @ frames)

        def body(vectors: Array) -> Array:
            return np.asarray((vectors @ motion.rotation)[keep])

        held = body(point - motion.position[:, None])

        return WrenchSamples(
            time=self.grid[keep] - self.start,
            position=motion.position[keep],
            rotation=motion.rotation[keep],
            velocity=motion.velocity[keep],
            acceleration=motion.acceleration[keep],
            angular_velocity=motion.angular_velocity_B[keep],
            angular_acceleration=motion.angular_acceleration_B[keep],
            contact_names=tuple(contact.name for contact in self.contacts),
            contact_point=np.where(carried[:, None], point[keep], held),
            contact_rotation=on_body[keep],
            contact_force=body(force),
            contact_torque=body(torque),
            in_contact=np.stack([contact.in_contact for contact in self.contacts], axis=1)[keep],
            gravity=self.motion.gravity,
            session_starts=tuple(start - self.start for start in self.session_starts),
            torque_measured=any(contact.carries_torque for contact in self.contacts),
        )

    @cached_property
    def regressor(self) -> Array:
        """(valid samples, 6, 10) Newton-Euler regressor, of the motion alone."""
        motion, keep = self._kinematics, self.valid
        from_gravity = motion.acceleration - self.motion.gravity
        specific_force = (from_gravity[:, None] @ motion.rotation)[:, 0]
        return regressor(
            specific_force[keep],
            motion.angular_velocity_B[keep],
            motion.angular_acceleration_B[keep],
        )

    def corrected(self, corrections: dict[str, Array]) -> SampledSignals:
        """Return the signals moved by corrections (K, 3) by name, `name:contact` for contacts."""
        contacts = tuple(
            contact.corrected(
                {
                    key.partition(":")[0]: value
                    for key, value in corrections.items()
                    if key.partition(":")[2] == contact.name
                }
            )
            for contact in self.contacts
        )
        return replace(self, motion=self.motion.corrected(corrections), contacts=contacts)
