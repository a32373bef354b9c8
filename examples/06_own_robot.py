"""Is the file of my robot right?

    python examples/06_own_robot.py [my_robot.yaml]

Prints the joints of a robot's file (the default robot if none is given), and where each fingertip
sensor is in the base frame at the start, to be compared with a ruler. docs/robots.md has the keys.
"""

import sys

from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot


def main(arguments: list[str]) -> None:
    """Read the file, print what it says."""
    robot = load_robot(*(arguments or [DEFAULT_ROBOT]))
    print(f"{robot.arm_dof} joints of the arm, {robot.dof - robot.arm_dof} of the hand")
    print("  " + ", ".join(robot.joint_names))
    kinematics = HandKinematics(robot)
    for finger in robot.fingers:
        x, y, z = 1e3 * kinematics.sensor_pose(finger, robot.start)[:3, 3]
        print(f"{finger:10s} sensor at x {x:.1f}, y {y:.1f}, z {z:.1f} mm")


if __name__ == "__main__":
    main(sys.argv[1:])
