"""Recordings of loggers that are slow, have poses far slower than forces, or pause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.streams.joining import contact_rows, pose_rows
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.synthetic.recordings import HiddenRecording, generate
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions

FOLLOWED = 10.0
"""Samples per period of the fastest motion that a logger follows: polynomials of degree 6 through
ten samples then leave 1 % of the acceleration out. At 4 they leave half of it."""
_SLOWEST_SHARE = 0.2
"""Lowest over highest frequency of the motion."""


def slow_logger(
    seed: int,
    rate_hz: float,
    duration: float,
    force_rate_hz: float | None = None,
    effects: dict[str, float] | None = None,
    followed: float = FOLLOWED,
) -> HiddenRecording:
    """Generate what a slow logger keeps of a motion that it can, or cannot, follow.

    Args:
        seed: of everything.
        rate_hz: of poses.
        duration: s.
        force_rate_hz: of forces; that of poses by default.
        effects: hidden effects with their magnitudes.
        followed: pose samples per period of the fastest motion; from about 4 downwards the
            recording does not show the motion.
    """
    fastest = rate_hz / followed
    return generate(
        seed,
        effects,
        ScenarioOptions(
            duration=duration, physics_rate_hz=100.0, band_hz=(_SLOWEST_SHARE * fastest, fastest)
        ),
        SensorOptions(force_rate_hz=force_rate_hz or rate_hz, pose_rate_hz=rate_hz),
    )


def with_pauses(streams: Streams, pauses: Sequence[tuple[float, float]]) -> Streams:
    """Streams of pose and contacts without what was measured in pauses.

    Args:
        streams: measurements.
        pauses: first and last second of each.
    """

    def kept(time: np.ndarray) -> np.ndarray:
        return ~np.any([(time > start) & (time < stop) for start, stop in pauses], axis=0)

    pose = None if streams.pose is None else pose_rows(streams.pose, kept(streams.pose.time))
    contacts = {
        name: contact_rows(contact, kept(contact.time), kept(contact.pose_time))
        for name, contact in streams.contacts.items()
    }
    return replace(streams, pose=pose, contacts=contacts)
