"""Fields of frozen configuration dataclasses: description, unit and range beside the default."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from tactile_dynamics_ros.core.errors import BadInputError


def parameter(
    default: Any,
    description: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
) -> Any:
    """Return a dataclass field that carries what a ROS parameter descriptor needs."""
    metadata = {"description": description, "unit": unit, "minimum": minimum, "maximum": maximum}
    return dataclasses.field(default=default, metadata=metadata)


def check_ranges(config: Any) -> None:
    """Check every numeric field of a configuration against its declared range.

    Raises:
        BadInputError: a value lies outside its range; names the field, value and range.
    """
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        low, high = field.metadata.get("minimum"), field.metadata.get("maximum")
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        above, below = low is None or value >= low, high is None or value <= high
        if not (above and below) or math.isnan(value):
            expected = "a number" if low is None and high is None else describe_range(low, high)
            unit = field.metadata.get("unit", "")
            raise BadInputError(
                f"{type(config).__name__}.{field.name} = {value} {unit}: expected {expected}"
            )


def describe_range(low: float | None, high: float | None) -> str:
    """Return bounds, of which at least one is given, in words."""
    if high is None:
        return f"at least {low}"
    return f"at most {high}" if low is None else f"between {low} and {high}"
