"""A simulated table, the camera that is sent around, and the shape that comes out, over DDS."""

import json
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock

from tactile_dynamics_ros.cli.bringup import write_parameters
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command
from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.ros.shape_messages import shape_from_message
from tactile_dynamics_ros.share import share_file


def test_one_call_looks_around_an_object_and_tells_its_size(listener, tmp_path):
    files = write_parameters(share_file("config/planar_pusher.yaml"), tmp_path / "parameters")
    with Supervisor(tmp_path / "logs") as system:
        for name, file in files.items():
            system.start(name, node_command(name, file))
        listener.follow(Clock, "/clock")
        listener.follow(PoseStamped, "/camera/target")
        listener.follow(DiagnosticArray, "/object/shape", latched=True)
        listener.follow(PoseWithCovarianceStamped, "/object/pose")
        listener.wait_for_new("/clock", 60.0, 50)
        client = listener.node.get_service_names_and_types
        listener.wait(
            lambda: "/shape_estimator/start" in dict(client()), 60.0, "the service is offered"
        )
        success, message = False, "no /camera/pose yet"
        deadline = time.monotonic() + 60.0
        while "yet" in message and time.monotonic() < deadline:  # discovery
            success, message = call_trigger(listener.node, "/shape_estimator/start", 120.0)
        assert success, message
        told = json.loads(message)
        truth = json.loads(call_trigger(listener.node, "/robot_sim/reveal", 20.0)[1])
        listener.wait(lambda: listener.seen["/object/shape"], 20.0, "/object/shape")
        listener.wait_for_new("/object/pose", 60.0, 3)  # by vision_tracker, image by image
    assert len(listener.seen["/camera/target"]) == told["looks"] - 1 > 0
    (link,) = shape_from_message(listener.seen["/object/shape"][-1])
    (part,) = truth["objects"][0]["parts"]
    size = np.sort([*np.ptp(part["corners"], axis=0), part["height"]])
    assert np.sort(2.0 * link.shape.semi_axes) == pytest.approx(size, abs=2e-3)
    followed = listener.seen["/object/pose"][-1].pose.pose.position
    told = link.shape.pose[:3, 3]
    assert [followed.x, followed.y, followed.z] == pytest.approx(told, abs=2e-3)
