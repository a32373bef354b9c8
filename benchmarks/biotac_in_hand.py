"""Whole chain in the simulated hand: do the estimated contact forces add up to m (a - g)?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.biotac_press_rig import calibrate_units
from benchmarks.support.hand_contacts import hand_contacts
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.contact_state import (
    Contact,
    ContactState,
    ContactStateConfig,
)
from tactile_dynamics_ros.core.manipulation.grasp_controller import GraspController, Phase
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator
from tactile_dynamics_ros.core.tactile.calibration import NORMAL_90
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.sim.simulated_robot import Readings, SimulatedRobot, SimulatedRobotConfig

ROBOT = load_robot()


TARE_FRAMES = 40
ALOFT = (Phase.CARRY, Phase.EXCITE, Phase.RETURN)


class Touch:
    """Forces of the four fingers in the world, as the live nodes compute them.

    Args:
        kinematics: of the hand.
        model: of the force.
        tips: configurations of the four fingertips, from their calibration.
    """

    def __init__(
        self, kinematics: HandKinematics, model: str, tips: Sequence[FingertipConfig] | None = None
    ) -> None:
        self._tips = create_force_estimator(model, tips or [FingertipConfig()] * len(ROBOT.fingers))
        self._state = ContactState(kinematics)
        self._rest: list[Array] = []

    def update(self, readings: Readings) -> dict[str, Contact]:
        """Return the fingers in contact; the first frames are the tare."""
        if len(self._rest) < TARE_FRAMES:
            self._rest.append(readings.counts)
            if len(self._rest) == TARE_FRAMES:
                self._tips.tare(self._rest)
            return {}
        tips = self._tips.observe(readings.counts)
        return hand_contacts(self._state, readings.position, tips)


class PadTouch:
    """Contacts of flat fingertips that measure force and torque, as `contact_state` places them.

    Args:
        kinematics: of the robot.
        force_std: (3,) of the sensors, N.
        touch_force: force below which nothing is touched, N.
    """

    def __init__(self, kinematics: HandKinematics, force_std: Array, touch_force: float) -> None:
        self._state = ContactState(kinematics, ContactStateConfig(touch_force=touch_force))
        self._std = force_std

    def update(self, readings: Readings) -> dict[str, Contact]:
        """Return the fingers in contact."""
        fingers = self._state.kinematics.fingers
        wrench, std = readings.wrenches, np.tile(self._std, (len(fingers), 1))
        positions = np.tile(readings.position, (len(fingers), 1))
        found = self._state.update_all(fingers, positions, wrench[:, 3:], std, wrench[:, :3])
        return {contact.finger: contact for contact in found if contact.touching}


def balance_in_hand(seed: int = 0, seconds: float = 40.0, model: str = "network") -> dict[str, Any]:
    """Grasp, lift and move an object; compare the net force with what moves it.

    Every seed has fingertips of its own, calibrated by warming up and a minute of presses.

    Returns:
        rms and mean of the difference per world axis (N), the weight (N), and the share of samples
        within the 90 % interval of the stated covariance.
    """
    robot = SimulatedRobot(SimulatedRobotConfig(seed=seed, unit_seed=seed))
    kinematics = HandKinematics()
    controller = GraspController(kinematics, robot.world.model.grasp)
    touch = Touch(kinematics, model, calibrate_units(seed) if model == "network" else None)
    inertia = robot.world.model.inertia
    net, variance, velocity, pose = [], [], [], None
    while robot.world.time < seconds and not controller.done:
        readings = robot.advance()
        contacts = touch.update(readings)
        pose = readings.vision if readings.vision is not None else pose
        forces = {finger: contact.force for finger, contact in contacts.items()}
        known = pose if robot.world.time > 0.01 * TARE_FRAMES else None
        robot.world.command(controller.update(readings.time, readings.position, forces, known))
        if controller.phase in ALOFT and contacts:
            net.append(sum(forces.values()))
            variance.append(sum(np.diag(c.force_covariance) for c in contacts.values()))
            velocity.append(_com_velocity(robot, inertia.com))
    robot.world.close()
    acceleration = np.gradient(np.array(velocity), robot.period, axis=0)
    needed = inertia.mass * (acceleration + np.array([0.0, 0.0, 9.81]))
    error = np.array(net) - needed
    inside = np.abs(error) < NORMAL_90 * np.sqrt(np.array(variance))
    return {
        "object": robot.world.model.name,
        "weight_n": 9.81 * inertia.mass,
        "samples": len(error),
        "mean_error_n": error.mean(axis=0).round(4).tolist(),
        "rms_error_n": np.sqrt((error**2).mean(axis=0)).round(4).tolist(),
        "stated_std_n": np.sqrt(np.mean(variance, axis=0)).round(4).tolist(),
        "coverage_90": float(inside.mean()),
    }


def _com_velocity(robot: SimulatedRobot, com: Array) -> Array:
    """Return the true velocity (3,) of the centre of mass, world axes, m/s."""
    angular, linear = robot.world.object_velocity()
    return linear + np.cross(angular, robot.world.object_pose()[:3, :3] @ com)
