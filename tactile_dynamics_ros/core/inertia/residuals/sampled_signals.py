"""Motion and contacts of one stretch read on the grid, as wrench samples in the body frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import ContactSignals
from tactile_dynamics_ros.core.inertia.residuals.motion import Motion, MotionSignals
from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor

Array = NDArray[np.float64]


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
        felt = ((motion.acceleration - self.motion.gravity)[:, None] @ motion.rotation)[:, 0]
        return regressor(
            felt[keep], motion.angular_velocity_B[keep], motion.angular_acceleration_B[keep]
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
