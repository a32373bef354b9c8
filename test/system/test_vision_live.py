"""Camera and vision tracker as processes: the object is found, and again after a reset."""

import json
import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Float64
from system_listener import as_read

from tactile_dynamics_ros.cli.topics import call_trigger
from tactile_dynamics_ros.ros import conversions as cv

VISION = "/object/pose/vision"


@pytest.mark.timeout(240)
def test_camera_to_pose_over_dds_and_reset(system, listener):
    for topic, kind in ((VISION, PoseWithCovarianceStamped), ("/vision_tracker/score", Float64)):
        listener.follow(kind, topic)
    system.start_node("robot_sim", world__object_name="pudding_box", seed=3)
    system.start_node("vision_tracker", object="pudding_box")
    message = listener.wait_for_new(VISION, timeout=120.0, count=3)
    pose, covariance = cv.uncertain_pose_to_core(as_read(message), VISION, "world")
    success, text = call_trigger(listener.node, "/robot_sim/reveal", 20.0)
    assert success, text
    truth = np.array(json.loads(text)["object_pose"])
    assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 4e-3
    assert 0.0 < math.sqrt(covariance[3, 3]) < 5e-3
    assert listener.seen["/vision_tracker/score"][-1].data > 0.9
    success, text = call_trigger(listener.node, "/vision_tracker/reset", 20.0)
    assert success, text
    message = listener.wait_for_new(VISION, 60.0, 3)
    again = cv.uncertain_pose_to_core(as_read(message), VISION, "world")[0]
    assert np.linalg.norm(again[:3, 3] - truth[:3, 3]) < 4e-3
