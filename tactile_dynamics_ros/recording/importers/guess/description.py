"""What a guess understood, for people: units, rates, frames and the first row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.recording.recording import Recording


def describe_understood(understood: Sequence[tuple[str, str]]) -> str:
    """Return one line per thing that was understood."""
    width = max((len(label) for label, _ in understood), default=0)
    return "\n".join(f"  {label:<{width}}  {text}" for label, text in understood)


def describe_first_row(recording: Recording) -> str:
    """Return where the object was at the first sample and what pushed it, in SI units."""
    pose, imu = recording.streams.pose, recording.streams.imu
    motion = pose or imu
    if motion is None or motion.rotation is None or not recording.streams.contacts:
        return "no orientation or no force"
    turn = log_so3(motion.rotation[:1])[0]
    angle = float(np.degrees(np.linalg.norm(turn)))
    axis = turn / max(float(np.linalg.norm(turn)), 1e-12)
    place = "" if pose is None else f"at ({_numbers(pose.position[0])}) m, "
    parts = [f"{place}turned {angle:.0f} deg about ({_numbers(axis)})"]
    for name, contact in recording.streams.contacts.items():
        k = int(nearest_samples(contact.time, motion.time[:1])[0])
        parts.append(f"{name} pushes it with ({_numbers(contact.force[k])}) N in world axes")
    return "; ".join(parts)


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in np.round(values, 4) + 0.0)
