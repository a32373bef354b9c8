"""Joint encoders: noise, quantisation, calibration offset and gear play."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.robot.robot import Robot, column

Array = NDArray[np.float64]

PLAY_TORQUE = 0.01
"""Torque at which a gear's play is half taken up, N m."""


@dataclass(frozen=True)
class EncoderConfig:
    """Errors of joint readings.

    Source: Allegro driver (16-bit counts over 333.3 deg), noise 2e-4 rad; absolute accuracy is
    0.5 to 1 deg and play 0.3 to 0.5 deg as delivered, the defaults hold for a calibrated hand.
    """

    hand_noise: float = parameter(2e-4, "white noise of a hand joint", "rad", 0.0, 0.1)
    hand_offset_deg: float = parameter(0.2, "std of the offsets of hand joints", "deg", 0.0, 10.0)
    hand_play_deg: float = parameter(0.1, "gear play of a hand joint", "deg", 0.0, 10.0)
    arm_noise: float = parameter(1e-5, "white noise of an arm joint", "rad", 0.0, 0.1)
    arm_offset: float = parameter(5e-5, "std of the offsets of arm joints", "rad", 0.0, 0.1)
    slide_noise: float = parameter(1e-5, "white noise of a joint that slides", "m", 0.0, 0.01)
    slide_offset: float = parameter(1e-4, "std of the offsets of joints that slide", "m", 0.0, 0.05)

    def __post_init__(self) -> None:
        check_ranges(self)


class JointEncoders:
    """What the drivers report for true joint positions of arm and hand.

    Args:
        robot: whose joints they read.
        config: errors.
        seed: of noise and of the constant offsets.
    """

    def __init__(self, robot: Robot, config: EncoderConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or EncoderConfig()
        self._rng = np.random.default_rng([seed, 11])
        in_arm = np.arange(robot.dof) < robot.arm_dof
        slides = column(robot.joints, "slides") > 0.0

        def each(arm: float, hand: float, slide: float | None = None) -> Array:
            turning = np.where(in_arm, arm, hand)
            return turning if slide is None else np.where(slides, slide, turning)

        self._noise = each(config.arm_noise, config.hand_noise, config.slide_noise)
        self._resolution = each(robot.arm_resolution, robot.hand_resolution)
        offset = np.deg2rad(config.hand_offset_deg)
        scale = each(config.arm_offset, float(offset), config.slide_offset)
        self.offset = scale * self._rng.standard_normal(robot.dof)
        self._play = each(0.0, float(np.deg2rad(config.hand_play_deg)), 0.0)

    def read(self, position: Array, effort: Array | None = None) -> Array:
        """Return reported positions (J,) rad.

        The encoder sits on the motor's side of the gear, which leads the link by half the play in
        the direction of the torque.

        Args:
            position: (J,) true link positions, rad.
            effort: (J,) drive torques, N m; no play without them.
        """
        reported = position + self.offset + self._noise * self._rng.standard_normal(len(position))
        if effort is not None:
            reported = reported + 0.5 * self._play * effort / (np.abs(effort) + PLAY_TORQUE)
        return np.asarray(np.rint(reported / self._resolution) * self._resolution)
