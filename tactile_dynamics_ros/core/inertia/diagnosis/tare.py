"""The zero of a single sensor: what it is, and whether the load hung on it when it was zeroed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_parameters

_START = 0.1
"""First part of a recording, s, whose mean reading says whether the sensor was zeroed there: some
ten samples. Longer takes in the motion of an arm that does not wait, shorter noise."""
_TARED = 0.1
"""Reading at the start over the zero below which the sensor was zeroed with the load on it: of
zeros as large as the weight, of any direction, one in 4000 does so by chance. Higher calls chance a
tare, lower misses one of an arm that moves at once."""
_CERTAIN = 5.0
"""Standard deviations by which a zero is known to be none. Lower speaks of zeros that noise makes,
higher is silent of small ones."""


def describe_zero(zero: Mapping[str, Mapping[str, Any]], tared: bool) -> str:
    """What a sensor reads with nothing on it, for people.

    Args:
        zero: its parameters, with standard deviations.
        tared: whether it was zeroed with the load on it.
    """
    said = (
        f"The zero of the sensor is part of the model: with nothing on it, it reads "
        f"{write_parameters(zero)}, as a force on the object (as one on the sensor, the opposite)."
    )
    tare = " It was zeroed with the load on it: it reads nothing at the start."
    return said + tare if tared else said


def was_tared(samples: WrenchSamples, zero: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether a single sensor was zeroed with the load on it, at the start of the recording.

    Its reading there is then far smaller than its zero: it was taken for zero as the load hung.

    Args:
        samples: of one contact.
        zero: its parameters, force first, with standard deviations.
    """
    first = samples.time < samples.time[0] + _START
    reading = float(np.linalg.norm(samples.contact_force[first, 0].mean(axis=0)))
    value, std = (
        float(np.linalg.norm([entry[key] for entry in list(zero.values())[:3]]))
        for key in ("value", "std")
    )
    return value > _CERTAIN * std and reading < _TARED * value
