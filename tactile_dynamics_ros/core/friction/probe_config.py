"""How a probe presses, ramps and stops, and what it is given at one instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.estimate import FrictionEstimateConfig
from tactile_dynamics_ros.core.friction.hold import ImpedanceConfig
from tactile_dynamics_ros.core.friction.slip_detection import SlipFusionConfig


class ProbePhase(Enum):
    """Phases of a probe."""

    IDLE = "idle"
    BRACE = "brace"
    PRESS = "press"
    LOAD = "load"
    UNLOAD = "unload"
    DRAG = "drag"
    SLIDE = "slide"
    RESTORE = "restore"
    DONE = "done"
    FAILED = "failed"


VARIANTS = ("unload", "drag", "both")
"""How a slip is brought about: the normal force falls, the tangential force grows, or both in turn.
Names are API (a parameter of the node)."""


@dataclass(frozen=True)
class FrictionProbeConfig:
    """Forces, ramps and limits.

    Source: facts on practice: normal force 0.5 to 2 N, ramps 0.5 to 2 N/s, slow enough for the
    skin's relaxation.
    """

    finger: str = parameter("index", "that probes; the others hold")
    variant: str = parameter("unload", "unload: normal force down; drag: tangential up; both")
    press: float = parameter(1.7, "normal force before each slip", "N", 0.3, 3.0)
    tangential: float = parameter(0.6, "tangential force of the first slip", "N", 0.1, 2.0)
    slip_normal: float = parameter(0.9, "normal force at which slips are wanted", "N", 0.2, 2.0)
    grip: float = parameter(3.4, "normal force of the thumb while probing", "N", 0.3, 4.0)
    press_rate: float = parameter(4.0, "ramp of the press", "N/s", 0.1, 20.0)
    load_rate: float = parameter(1.5, "ramp of the tangential force", "N/s", 0.1, 20.0)
    fast_rate: float = parameter(1.5, "unloading far from slip", "N/s", 0.05, 10.0)
    slow_rate: float = parameter(0.5, "unloading near slip", "N/s", 0.02, 10.0)
    slide_time: float = parameter(0.15, "how long a slip goes on", "s", 0.02, 2.0)
    slide_push: float = parameter(0.12, "steps of extra pull, for several speeds", "N", 0.0, 1.0)
    least_slide: float = parameter(2e-4, "way on after a slip that confirms it", "m", 0.0, 0.01)
    brace_time: float = parameter(0.8, "time to build up the grip", "s", 0.1, 5.0)
    restore_time: float = parameter(0.8, "time to go back to the grip before", "s", 0.1, 5.0)
    directions: int = parameter(8, "number of slip directions", "", 2, 64)
    fewest_slips: int = parameter(4, "slips before a probe may end", "", 2, 200)
    most_slips: int = parameter(24, "slips after which it ends", "", 2, 200)
    width: float = parameter(0.04, "wanted width of the interval that repetition can shrink", "", 0)
    time_limit: float = parameter(18.0, "time after which a probe ends", "s", 2.0, 300.0)
    least_force: float = parameter(0.12, "force below which a finger does not hold", "N", 0.0, 2.0)
    lost_force: float = parameter(
        0.05, "force below which the probing finger lost contact", "N", 0, 1
    )
    lost_time: float = parameter(0.4, "time without contact that ends a probe", "s", 0.02, 5.0)
    force_limit: float = parameter(4.5, "force of any finger that ends a probe", "N", 0.5, 10.0)
    stale_time: float = parameter(0.25, "age of the touch that ends a probe", "s", 0.02, 2.0)
    most_motion: float = parameter(
        0.012, "motion of the object in the hand that ends a probe", "m", 1e-4, 0.1
    )
    impedance: ImpedanceConfig = field(default_factory=ImpedanceConfig)
    slip: SlipFusionConfig = field(default_factory=SlipFusionConfig)
    estimate: FrictionEstimateConfig = field(default_factory=FrictionEstimateConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.variant not in VARIANTS:
            raise BadInputError(f"variant = '{self.variant}': expected {', '.join(VARIANTS)}")


Array = NDArray[np.float64]


@dataclass(frozen=True)
class ProbeContact:
    """One touching finger.

    Attributes:
        point: (3,) m, world. force: (3,) N on the object, world axes. std: (3,) N.
    """

    point: Array
    force: Array
    std: Array


@dataclass(frozen=True)
class ProbeInput:
    """Everything that is measured at one instant.

    Attributes:
        time: s. touch_time: stamp of the newest touch, s.
        positions: (J,) rad.
        contacts: by finger; fingers that touch nothing are missing.
        object_pose: (4, 4) X_WO.
        vibration, electrodes: signals of the probing finger, see `SlipObservation`.
    """

    time: float
    touch_time: float
    positions: Array
    contacts: Mapping[str, ProbeContact]
    object_pose: Array
    vibration: float | None = None
    electrodes: float | None = None
