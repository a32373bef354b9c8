"""The force node in this process: tare, restart, bad frames."""

import os
import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from sensor_msgs.msg import Image

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.nodes.biotac_force import BiotacForce, BiotacForceConfig
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_values
from tactile_dynamics_ros.ros.object_memory import KeptTare
from tactile_dynamics_ros.ros.shell import STREAM
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray

PAD = np.array([-6e-3, 0.0, -7e-3])


@pytest.fixture
def node(tmp_path, ros):
    """Return a function that makes a node; all share one kept tare."""
    ros.try_shutdown()
    nodes = []

    def create():
        if not rclpy.ok():
            rclpy.init(args=["--ros-args", "-p", f"tare_file:={tmp_path / 'tare.npy'}"])
        nodes.append(BiotacForce())
        return nodes[-1]

    yield create
    for made in nodes:
        made.destroy_node()


class Driver:
    """Publishes simulated frames and collects the forces of the index finger."""

    def __init__(self, node):
        self.node = node
        self.sensors = BioTacArray(4, seed=3)
        self.publisher = node.create_publisher(Image, "/biotac/raw", STREAM)
        self.forces = []
        node.listen(WrenchStamped, "/biotac/index/force", self.forces.append)
        self.slips = []
        node.listen(Vector3Stamped, "/biotac/index/slip", self.slips.append)
        self.slip_speed = 0.0
        self.time = 1.0

    def frame(self, force=(0.0, 0.0, 0.0), time=None):
        """Publish one frame with a force on the index finger and let the node work."""
        forces = np.zeros((4, 3))
        forces[0] = force
        counts = self.sensors.measure(forces, np.tile(PAD, (4, 1)), self.slip_speed)
        self.time += 0.01
        message = cv.biotac_to_message(counts, self.time if time is None else time, "hand")
        self.send(message)

    def send(self, message):
        """Publish a message and let the node work on it."""
        self.publisher.publish(message)
        deadline = time.monotonic() + 0.02
        while time.monotonic() < deadline:
            self.node.work()

    def until(self, condition, force=(0.0, 0.0, 0.0), frames=400):
        """Publish frames until the condition holds."""
        for _ in range(frames):
            if condition():
                return
            self.frame(force)
        raise AssertionError("condition not met")


def test_diagnostics_tell_how_long_frames_take(node):
    driver, told = Driver(node()), {}
    driver.node.listen(
        DiagnosticArray, "/diagnostics", lambda m: told.update(status_values(m.status[0]))
    )
    driver.until(lambda: "frame_ms_p99" in told)
    assert 0.0 < float(told["frame_ms_median"]) <= float(told["frame_ms_p99"])
    assert 0.0 < float(told["frame_cpu_ms_p99"]) < 1.1 * float(told["frame_ms_p99"])


def test_forces_come_after_the_tare_and_point_into_the_object(node):
    driver = Driver(node())
    driver.until(lambda: driver.forces)
    assert not cv.wrench_to_core(driver.forces[-1], "/f").any()
    driver.until(lambda: driver.forces[-1].values[2] < -0.5, force=(0.0, 0.0, -1.0))
    wrench = cv.wrench_to_core(driver.forces[-1], "/f", "biotac_index")
    assert wrench[5] == pytest.approx(-1.0, abs=0.4)


def test_slip_is_published_with_the_stamp_of_its_frame(node):
    driver = Driver(node())
    driver.until(lambda: driver.forces)
    driver.until(lambda: driver.slips[-1].values[1] > 0.0 and driver.time > 2.0, (0.0, 0.0, -1.0))
    assert driver.slips[-1].values[0] < 1.0 and driver.slips[-1].values[2] == 0.0
    driver.slip_speed = 0.03
    driver.until(lambda: driver.slips[-1].values[2] == 1.0, force=(0.0, 0.0, -1.0), frames=8)
    assert driver.slips[-1].values[0] > 1.0
    assert cv.to_seconds(driver.slips[-1].stamp) == pytest.approx(driver.time, abs=0.03)
    driver.until(lambda: driver.slips[-1].values[0] == 0.0)


def test_gains_are_one_or_nine_numbers_per_finger():
    robot, tip = load_robot(), FingertipConfig()
    assert len(BiotacForceConfig(gains=tuple(np.eye(3).ravel()) * 4).fingertips(robot, tip)) == 4
    with pytest.raises(BadInputError, match="5 values, expected 1, 4 or 36"):
        BiotacForceConfig(gains=(1.0,) * 5).fingertips(robot, tip)


def test_restarted_node_continues_with_the_kept_tare_under_load(node):
    first = Driver(node())
    first.until(lambda: first.forces)
    second = Driver(node())
    second.sensors = first.sensors
    second.until(lambda: second.forces and second.forces[-1].values[2] < -0.5, (0, 0, -1.0))


def test_kept_tare_expires_and_survives_damage(tmp_path):
    kept = KeptTare(4, str(tmp_path / "tare.npy"))
    assert kept.read(30.0) is None
    kept.write(np.zeros((5, 4, 44)))
    assert kept.read(30.0).shape == (5, 4, 44)
    assert kept.read(0.0) is None
    kept.path.write_bytes(b"not an array")
    assert kept.read(30.0) is None
    kept.path.unlink()
    os.mkfifo(kept.path)
    assert kept.read(30.0) is None, "and nobody waits for what comes out of a pipe"


def test_every_hand_keeps_a_tare_of_its_own():
    paths = [KeptTare(4, "", namespace).path for namespace in ("/", "/left", "/right", "/a/b")]
    assert len(set(paths)) == len(paths)


def test_bad_frames_are_counted_and_harmless(node):
    driver = Driver(node())
    driver.until(lambda: driver.forces)
    wrong = cv.biotac_to_message(np.zeros((2, 44), np.uint16), 9.0, "hand")
    driver.send(wrong)
    driver.frame(time=driver.time - 0.5)
    driver.send(cv.biotac_to_message(np.full((4, 44), 5000, np.uint16), driver.time + 0.01, "h"))
    driver.until(lambda: {"wrong_shape", "stamp_jumped_back", "bad_input"} <= set(counts(driver)))
    before = len(driver.forces)
    driver.until(lambda: len(driver.forces) > before + 3)


def counts(driver):
    """Return the node's fault counts."""
    return driver.node.faults.counts


def test_each_finger_takes_its_own_numbers():
    config = BiotacForceConfig(
        gains=(1.1, 1.2, 1.3, 1.4), drift=tuple(float(k) for k in range(4 * 19))
    )
    tip = FingertipConfig(touch_counts=12.0)
    *_, thumb = config.fingertips(load_robot(), tip)
    assert thumb.touch_counts == 12.0
    assert thumb.gain_matrix[0, 0] == pytest.approx(1.4)
    assert thumb.drift == tuple(float(k) for k in range(57, 76))
    with pytest.raises(BadInputError, match="drift: 3 values, expected 1, 4 or 76"):
        BiotacForceConfig(drift=(30.0, 31.0, 32.0)).fingertips(load_robot(), tip)
