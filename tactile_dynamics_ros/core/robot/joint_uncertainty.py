"""How far joint positions can be trusted, and since when a robot stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.robot.robot import Robot, column

Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointUncertaintyConfig:
    """Standard deviations of what makes a joint position wrong.

    Source: Allegro encoders 2e-4 rad; offset 0.5 to 1 deg and backlash 0.3 to 0.5 deg as
    delivered, the defaults hold for a calibrated hand that keeps its load direction; iiwa
    encoders 1e-5 rad, repeatability 0.1 to 0.15 mm. A joint that slides, of arm or
    hand, has numbers of its own: jaws of grippers repeat to 0.1 mm.
    """

    hand_noise: float = parameter(2e-4, "encoder noise of a hand joint", "rad", 0.0, 0.1)
    hand_offset: float = parameter(0.0035, "calibration offset of a hand joint", "rad", 0.0, 0.2)
    hand_backlash: float = parameter(5e-4, "play of a hand joint under load", "rad", 0.0, 0.1)
    arm_noise: float = parameter(1e-5, "encoder noise of an arm joint", "rad", 0.0, 0.1)
    arm_offset: float = parameter(1e-4, "calibration offset of an arm joint", "rad", 0.0, 0.1)
    slide_noise: float = parameter(1e-5, "encoder noise of a joint that slides", "m", 0.0, 0.01)
    slide_offset: float = parameter(2e-4, "offset and play of a joint that slides", "m", 0.0, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)

    def varying_variance(self, robot: Robot) -> Array:
        """Return the variance (J,) of what changes from reading to reading, rad^2 or m^2."""
        hand = self.hand_noise**2 + self.hand_backlash**2
        return _per_joint(robot, self.arm_noise**2, hand, self.slide_noise**2)

    def constant_variance(self, robot: Robot) -> Array:
        """Return the variance (J,) of what stays the same during a run, rad^2 or m^2."""
        return _per_joint(robot, self.arm_offset**2, self.hand_offset**2, self.slide_offset**2)


def _per_joint(robot: Robot, arm: float, hand: float, slide: float) -> Array:
    turning = np.where(np.arange(robot.dof) < robot.arm_dof, arm, hand)
    return np.where(column(robot.joints, "slides") > 0.0, slide, turning)


_STILL = 0.005
"""Joint motion, rad (m where joints slide), up to which a robot stands still: 4 mm of a fingertip
0.8 m from the joint, a third of the motion of the object that ends a probe. Less takes noise and
the settling of drives for motion, more takes a slow motion for rest."""


class Standstill:
    """Follows joint positions, and says since when none has moved by more than 0.005 rad.

    Attributes:
        since: s, stamp since which the robot stands still; infinity before the first positions.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Know nothing."""
        self._place: Array | None = None
        self.since = np.inf

    def update(self, time: float, positions: Array) -> None:
        """Take positions (J,) at a time, s, not decreasing."""
        if self._place is None or np.max(np.abs(positions - self._place)) > _STILL:
            self._place, self.since = np.array(positions), time
