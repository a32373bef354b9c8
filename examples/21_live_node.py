"""How do I feed the live estimator from my own program, and read its estimate?

    python examples/21_live_node.py

Publishes a simulated recording on topics, lets the node work, and prints the mass that it reports.
"""

import numpy as np
import rclpy
from geometry_msgs.msg import InertiaStamped, PoseStamped, PoseWithCovarianceStamped, WrenchStamped

from tactile_dynamics_ros.nodes.inertial_estimator import InertialEstimatorNode
from tactile_dynamics_ros.ros import conversions as convert
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def make_pose(stream, k):
    """Return a pose (4, 4)."""
    return np.block([[stream.rotation[k], stream.position[k, :, None]], [np.zeros(3), 1.0]])


streams, seen = generate(1, scenario=ScenarioOptions(duration=6.0)).streams, []
rclpy.init(args=[])
node = InertialEstimatorNode()
node.listen(InertiaStamped, "/inertial_estimator/inertia", seen.append)
kinds = {"/object/pose": PoseWithCovarianceStamped}
for name in streams.contacts:
    kinds |= {f"/contact/{name}/pose": PoseStamped, f"/contact/{name}/force": WrenchStamped}
publish = {topic: node.create_publisher(kind, topic, 100).publish for topic, kind in kinds.items()}
for k, stamp in enumerate(streams.pose.time):
    now, where = stamp + 1.0, (make_pose(streams.pose, k), streams.pose.covariance[k])
    publish["/object/pose"](convert.uncertain_pose_to_message(*where, now, "world"))
    for name, contact in streams.contacts.items():
        place = convert.pose_to_message(make_pose(contact, k), now, "world")
        publish[f"/contact/{name}/pose"](place)
        wrench = np.append(np.zeros(3), contact.force[k])  # torque, force on the object
        publish[f"/contact/{name}/force"](convert.wrench_to_message(wrench, now, "world"))
    node.work()
print(f"{len(seen)} estimates, the last mass {seen[-1].inertia.m:.4f} kg")
rclpy.shutdown()
