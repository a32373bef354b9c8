"""How a probe presses, ramps and stops, and Coulomb's cone in which it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from tactile_dynamics_ros.core.array import Array
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


def split_force(force: Array, normal: Array) -> tuple[float, float]:
    """Return the normal force f . n and the tangential force |f - (f . n) n|, N.

    Args:
        force: (3,) on the object, N.
        normal: (3,) unit vector into the object, same axes.
    """
    press = float(force @ normal)
    return press, float(np.linalg.norm(force - press * normal))


def cone_share(force: Array, normal: Array, friction: float) -> float:
    """Return the share |f_t| / (mu f_n) of the friction cone that is used; above 1 it would slip.

    Infinite without normal force, but zero without any force.
    """
    press, drag = split_force(force, normal)
    if press <= 0.0:
        return np.inf if drag > 0.0 or press < 0.0 else 0.0
    return drag / (friction * press)


def distance_beyond(force: Array, normal: Array, friction: float) -> float:
    """Return how far (N) a force lies outside the cone |f_t| <= mu f_n, zero inside.

    Coulomb friction cannot hold such a force, so that a measurement of it is off by that much at
    least: |f_t - mu f_n| / sqrt(1 + mu^2), or |f| where the nearest point is the tip of the cone.
    """
    press, drag = split_force(force, normal)
    if drag <= friction * press:
        return 0.0
    if press + friction * drag <= 0.0:
        return float(np.hypot(press, drag))
    return (drag - friction * press) / float(np.hypot(1.0, friction))


def friction_coefficient(force: Array, normal: Array) -> float:
    """Return mu = tan(acos(f.n / |f|)), the slope of a force that is about to slip.

    Args:
        force: (3,) N on the object just before it slips.
        normal: (3,) into the object, same frame; need not be a unit vector.

    Raises:
        BadInputError: the force does not press, or there is no normal.

    Source: paper A, Eq. 1.
    """
    strength = float(np.linalg.norm(force) * np.linalg.norm(normal))
    pressing = float(np.dot(force, normal))
    if pressing <= 0.0:
        raise BadInputError(
            f"friction: the force {np.round(force, 3).tolist()} N does not press along the normal "
            f"{np.round(normal, 3).tolist()}; expected a normal into the object"
        )
    return float(np.tan(np.arccos(min(pressing / strength, 1.0))))


def tangent_basis(normal: Array, along: Array) -> Array:
    """Return two unit vectors (2, 3) that span the plane of contact, e1 x e2 = normal.

    Args:
        normal: (3,) unit vector.
        along: (3,) direction whose projection becomes e1; another is taken if it is too steep.
    """
    for candidate in (along, np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])):
        first = candidate - (candidate @ normal) * normal
        length = float(np.linalg.norm(first))
        if length > 0.3 * float(np.linalg.norm(candidate)):
            break
    first = first / length
    return np.stack([first, np.cross(normal, first)])


def probing_angles(count: int) -> Array:
    """Return angles (K,), rad, that cover the circle in opposite pairs, coarse to fine.

    A slip moves the fingertip; the opposite slip that follows moves it back, and errors of the
    force's direction cancel between the two.
    """
    pairs = np.array([0.0, 0.25, 0.125, 0.375])
    turns = np.stack([pairs, pairs + 0.5], axis=1).reshape(-1)
    return 2.0 * np.pi * np.resize(turns, count)
