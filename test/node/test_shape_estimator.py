"""The shape estimator as a node: where it sends the camera, what it answers, what stops it."""

import json

import numpy as np
import pytest
import trimesh
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from benchmarks.following.stage import LENS, Stage
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3
from tactile_dynamics_ros.core.shape.superquadric.views import looking_at
from tactile_dynamics_ros.nodes import shape_estimator
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.names import (
    CAMERA_INFO,
    CAMERA_POSE,
    CAMERA_TARGET,
    DEPTH_IMAGE,
    EMERGENCY_STOP,
    SUPPORT_POSE,
)
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

LARGE, SMALL = np.array([0.5, 0.0]), np.array([0.5, 0.12])
STEP = 0.02
"""Time between poses, s."""


def block(x, y, z, at):
    return trimesh.creation.box((x, y, z)).apply_translation([*at, 0.5 * z])


class Arm:
    """Carries a camera before two boxes to where it is sent, at 1 m/s."""

    def __init__(self, bench, *arguments):
        self.bench = bench
        self.node = bench.start(shape_estimator.ShapeEstimatorNode, *arguments)
        self.targets = bench.follow(PoseStamped, CAMERA_TARGET)
        self.stage = Stage([block(0.1, 0.06, 0.05, LARGE), block(0.05, 0.04, 0.06, SMALL)], 3)
        self.stage.place((np.eye(4), np.eye(4)), None)
        self.pose = looking_at(np.array([0.75, 0.3, 0.35]), np.array([0.5, 0.05, 0.02]))
        self.time, self.speed, self.seen = 1.0, 1.0, ()
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, profile)
            for kind, topic, profile in (
                (PoseStamped, SUPPORT_POSE, LATCHED),
                (PoseStamped, CAMERA_POSE, STREAM),
                (CameraInfo, CAMERA_INFO, STREAM),
                (Image, DEPTH_IMAGE, STREAM),
            )
        }
        for publisher in self.publishers.values():
            bench.until(lambda p=publisher: p.get_subscription_count() > 0)

    def tell_table(self):
        message = cv.pose_to_message(np.eye(4), self.time, "world")
        self.publishers[SUPPORT_POSE].publish(message)
        self.bench.until(lambda: self.node._support._pose is not None)

    def tell(self):
        """Move on a little, tell where the camera is, and ten times less often what it sees."""
        self.time += STEP
        if self.targets:
            self.move(cv.pose_to_core(self.targets[-1], CAMERA_TARGET, "world"))
        message = cv.pose_to_message(self.pose, self.time, "world")
        self.publishers[CAMERA_POSE].publish(message)
        if round(self.time / STEP) % 10 == 0:
            info = cv.camera_info(LENS.intrinsics, LENS.width, LENS.height, self.time, "camera")
            self.publishers[CAMERA_INFO].publish(info)
            depth = cv.depth_to_message(self.see(), self.time, "camera")
            self.publishers[DEPTH_IMAGE].publish(depth)
        self.bench.work(0.004)

    def see(self):
        """Draw what the camera sees, once while it rests."""
        if not self.seen or np.max(np.abs(self.seen[0] - self.pose)) > 1e-9:
            self.seen = self.pose, self.stage.measure(self.pose)
        return self.seen[1]

    def move(self, target):
        away = target[:3, 3] - self.pose[:3, 3]
        share = min(1.0, self.speed * STEP / max(float(np.linalg.norm(away)), 1e-9))
        turn = log_so3(target[:3, :3] @ self.pose[:3, :3].T)
        self.pose = self.pose.copy()
        self.pose[:3, 3] += share * away
        self.pose[:3, :3] = exp_so3(share * turn) @ self.pose[:3, :3]

    def ask(self):
        """Call the service; return how to look for its answer."""
        service = next(s for s in self.node.services if s.srv_name == "shape_estimator/start")
        running = service.callback(Trigger.Request(), Trigger.Response())

        def answer():
            try:
                running.send(None)
            except StopIteration as end:
                return end.value
            return None

        return answer

    def until(self, found):
        """Let time pass until there is something."""
        for _ in range(5000):
            got = found()
            if got:
                return got
            self.tell()
        raise AssertionError("nothing came")


@pytest.fixture
def arm(request, bench):
    made = Arm(bench, *getattr(request, "param", ()))
    yield made
    made.stage.close()


@pytest.mark.parametrize("arm", [("-p", "object:=2")], indirect=True)
def test_the_second_object_is_looked_at_from_where_the_camera_is_sent(arm):
    arm.tell_table()
    arm.until(lambda: arm.time > 1.3)
    answer = arm.until(arm.ask())
    assert answer.success, answer.message
    told = json.loads(answer.message)
    assert told["looks"] == len(arm.targets) + 1 > 1
    (part,) = told["parts"]
    assert [part["x"], part["y"]] == pytest.approx(SMALL, abs=2e-3)
    assert 2.0 * np.sort(part["semi_axes_m"]) == pytest.approx([0.04, 0.05, 0.06], abs=2e-3)
    assert any("2 objects: this is 2" in text for text in told["remarks"])


def test_an_emergency_stop_keeps_the_camera_where_it_is_until_a_new_call(arm):
    arm.tell_table()
    arm.until(lambda: arm.time > 1.3)
    arm.speed = 0.1
    answer = arm.ask()
    assert answer() is None
    arm.until(lambda: arm.targets)
    sent = cv.pose_to_core(arm.targets[-1], CAMERA_TARGET, "world")
    arm.until(lambda began=arm.time: arm.time > began + 0.5)
    arm.bench.send(EMERGENCY_STOP, Bool(data=True), profile=LATCHED)
    told = arm.until(answer)
    assert not told.success and "emergency stop" in told.message
    arm.until(lambda began=arm.time: arm.time > began + 0.5)
    kept = cv.pose_to_core(arm.targets[-1], CAMERA_TARGET, "world")
    assert np.linalg.norm(kept[:3, 3] - sent[:3, 3]) > 0.05
    assert np.linalg.norm(kept[:3, 3] - arm.pose[:3, 3]) < 1e-6
    count = len(arm.targets)
    assert "emergency stop is on" in arm.until(arm.ask()).message
    arm.bench.send(EMERGENCY_STOP, Bool(data=False), profile=LATCHED)
    arm.until(lambda: not arm.node.stop.active)
    arm.until(lambda began=arm.time: arm.time > began + 0.5)
    assert len(arm.targets) == count
    again = arm.ask()
    assert again() is None
    arm.until(lambda: len(arm.targets) > count)


def test_what_is_missing_is_said(arm, monkeypatch):
    assert "no support/pose yet" in arm.until(arm.ask()).message.replace("/support", "support")
    arm.tell_table()
    assert "camera/pose yet" in arm.until(arm.ask()).message
    arm.until(lambda: arm.time > 1.3)
    monkeypatch.setattr(shape_estimator, "PATIENCE", 0.5)
    arm.speed = 0.0
    told = arm.until(arm.ask())
    assert not told.success and "the arm does not go there" in told.message
