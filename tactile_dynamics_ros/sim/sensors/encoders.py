"""Joint encoders: noise, quantisation, calibration offset and gear play."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.robot.robot import Robot

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

    def __post_init__(self) -> None:
        check_ranges(self)


class JointEncoders:
    """What the drivers report for true joint positions of arm and hand.

    Args:
        robot: whose joints they read.
        config: errors; in m and mm (for deg) of joints that slide.
        seed: of noise and of the constant offsets.
    """

    def __init__(self, robot: Robot, config: EncoderConfig | None = None, seed: int = 0) -> None:
        self.config = config = config or EncoderConfig()
        self._rng = np.random.default_rng([seed, 11])
        arm, hand = robot.arm_dof, len(robot.hand_joints)
        self._noise = np.concatenate(
            [np.full(arm, config.arm_noise), np.full(hand, config.hand_noise)]
        )
        resolution = [
            np.full(arm, robot.arm_resolution),
            np.full(hand, robot.hand_resolution),
        ]
        self._resolution = np.concatenate(resolution)
        scale = [np.full(arm, config.arm_offset), np.full(hand, np.deg2rad(config.hand_offset_deg))]
        self.offset = np.concatenate(scale) * self._rng.standard_normal(arm + hand)
        self._play = np.concatenate(
            [np.zeros(arm), np.full(hand, np.deg2rad(config.hand_play_deg))]
        )

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
