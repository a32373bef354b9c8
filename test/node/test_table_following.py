"""The vision tracker follows the links that /object/shape tells, from a moving camera."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image

from benchmarks.following.script import write_script
from benchmarks.following.stage import LENS, Stage
from benchmarks.following.trial import camera_pose
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.nodes.vision_tracker import VisionTrackerNode
from tactile_dynamics_ros.ros import conversions as cv
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.names import CAMERA_INFO, CAMERA_POSE, DEPTH_IMAGE, OBJECT_SHAPE
from tactile_dynamics_ros.ros.shape_messages import LENGTHS
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM
from tactile_dynamics_ros.sim.objects import planar_object


def told(shape, name, stamp):
    """A message of /object/shape with one link."""
    rows = {key: np.full(count, 5e-4) for key, count in LENGTHS.items()}
    rows |= {"semi_axes_m": shape.semi_axes, "exponents": shape.exponents, "taper": shape.taper}
    yaw = 0.5 * np.arctan2(shape.pose[1, 0], shape.pose[0, 0])
    rows |= {"position_m": shape.pose[:3, 3], "quaternion": [0, 0, np.sin(yaw), np.cos(yaw)]}
    text = {key: " ".join(f"{value:.9g}" for value in row) for key, row in rows.items()}
    return DiagnosticArray(header=cv.header(stamp, "world"), status=[status_message(name, text)])


def test_links_of_the_shape_are_told_with_the_stamp_of_the_image(bench):
    node = bench.start(VisionTrackerNode)
    poses = bench.follow(PoseWithCovarianceStamped, "/object/pose")
    thing = planar_object(6)
    moment = write_script(thing, 2)[0]
    part, pose = thing.parts[0], moment.parts[0]
    half = [*(0.5 * np.ptp(part.corners, axis=0)), 0.5 * part.height]
    middle = pose.copy()
    middle[:3, 3] += pose[:3, :3] @ [0.0, 0.0, half[2]]
    shape = Superquadric(np.array(half), np.array([0.05, 0.05]), np.zeros(2), middle)
    publishers = {
        topic: node.create_publisher(kind, topic, profile)
        for kind, topic, profile in (
            (DiagnosticArray, OBJECT_SHAPE, LATCHED),
            (CameraInfo, CAMERA_INFO, STREAM),
            (PoseStamped, CAMERA_POSE, STREAM),
            (Image, DEPTH_IMAGE, STREAM),
        )
    }
    publishers[OBJECT_SHAPE].publish(told(shape, "link_1", 1.0))
    bench.until(lambda: node._table is not None)
    stage = Stage([part.solid()], 1)
    stage.place((pose,), None)
    stamps = 1.0 + 0.1 * np.arange(20)
    for k, when in enumerate(stamps):
        place = camera_pose(0.5, 0.4, 0.1 * k)
        info = cv.camera_info(LENS.intrinsics, LENS.width, LENS.height, when, "camera")
        publishers[CAMERA_INFO].publish(info)
        for side in (-0.01, 0.01):
            around = cv.pose_to_message(camera_pose(0.5, 0.4, 0.1 * k + side), when + side, "world")
            publishers[CAMERA_POSE].publish(around)
        bench.work(0.1)
        publishers[DEPTH_IMAGE].publish(cv.depth_to_message(stage.measure(place), when, "camera"))
        bench.work(0.2)
        if poses:
            break
    stage.close()
    assert poses, dict(node.faults.counts)
    found, covariance = cv.uncertain_pose_to_core(poses[-1], "/object/pose", "world")
    assert np.abs(cv.to_seconds(poses[-1].stamp) - stamps).min() < 1e-6
    assert np.linalg.norm(found[:3, 3] - middle[:3, 3]) < 3e-3
    assert 1e-5 < np.sqrt(covariance[3, 3]) < 5e-3
