"""Names of topics, services and actions: relative to the node's namespace; global with a slash.

With `--ros-args -r __ns:=/left` a node listens to /left/object/pose, so that two hands live side by
side. What belongs to the whole robot or to ROS stays global.
"""

from __future__ import annotations

ROBOT_DESCRIPTION = "robot_description"
JOINT_STATES = "joint_states"
JOINT_COMMAND = "joint_command"
BIOTAC_RAW = "biotac/raw"
DEPTH_IMAGE = "camera/depth/image_rect"
CAMERA_INFO = "camera/depth/camera_info"
WRIST_WRENCH = "wrist/wrench"
JOINT_TRAJECTORY = "joint_trajectory_controller/joint_trajectory"

OBJECT_POSE = "object/pose"
HAND_POSE = "object/pose/kinematic"
VISION_POSE = "object/pose/vision"
OBJECT_IMU = "object/imu"
OBJECT_HELD = "object/held"
OBJECT_SHAPE = "object/shape"
OBJECT_FOOTPRINT = "object/footprint"
OBJECT_MARKERS = "object/markers"
SUPPORT_POSE = "support/pose"
CAMERA_POSE = "camera/pose"
CAMERA_TARGET = "camera/target"
PUSHER_POSE = "pusher/pose"
PUSHER_TARGET = "pusher/target"
GRIPPER_WIDTH = "gripper/width"
GRIPPER_TARGET = "gripper/target"

CONTACTS = ("index", "middle", "ring", "thumb")
"""Contacts that estimators hear unless they are told others: the fingers of an Allegro hand."""

TARE = "biotac_force/tare"
GRASP_PHASE = "grasp_controller/phase"
GRASP_START = "grasp_controller/start"
INERTIA = "inertial_estimator/inertia"
ESTIMATE = "inertial_estimator/estimate"
ESTIMATOR_STATUS = "inertial_estimator/status"
ESTIMATOR_RESET = "inertial_estimator/reset"
MODEL_ERROR = "model_check/error"
MODEL_RESIDUAL = "model_check/residual"
MODEL_VERDICT = "model_check/verdict"
MODEL_DIAGNOSIS = "model_check/diagnosis"
DIAGNOSE = "model_check/diagnose"
LEARN = "model_check/learn"
PROBE = "friction_probe/probe"
PROBE_ACTIVE = "friction_probe/active"
PROBE_ESTIMATE = "friction_probe/estimate"
PROBE_PROGRESS = "friction_probe/progress"
PROBE_SLIP = "friction_probe/slip"
SHAPE_START = "shape_estimator/start"
GOAL_POSE = "goal_pose"
PUSH = "push_controller/push"
PUSH_STOP = "push_controller/stop"
PUSH_PROGRESS = "push_controller/progress"
EXPLORE = "explorer/explore"
EXPLORE_CHANGE = "explorer/explore_change"
EXPLORE_PROGRESS = "explorer/progress"
PROPERTY_STATUS = "property_estimator/status"
PROPERTY_RESET = "property_estimator/reset"
REVEAL = "robot_sim/reveal"
BEGIN = "robot_sim/begin"
ATTACH = "robot_sim/attach"
DETACH = "robot_sim/detach"
SET_PAYLOAD = "arm/set_payload"
VISION_SCORE = "vision_tracker/score"
VISION_RESET = "vision_tracker/reset"

PAYLOAD_APPLY = "payload/apply"
WEIGH = "weigher/weigh"
WEIGH_PLAN = "weigher/plan"
WEIGH_PROCEED = "weigher/proceed"
WEIGH_STOP = "weigher/stop"
WEIGH_PROGRESS = "weigher/progress"
WEIGH_MOTION = "weigher/motion"
WEIGH_MARKERS = "weigher/markers"
MONITOR_MODEL = "joint_monitor/model_torque"
MONITOR_EXTERNAL = "joint_monitor/external_torque"
MONITOR_WRENCH = "joint_monitor/wrench"
MONITOR_WRENCH_STD = "joint_monitor/wrench_std"
MONITOR_VALID = "joint_monitor/valid"
MONITOR_STATUS = "joint_monitor/status"
COMPENSATED = "wrench_compensator/wrench"
COMPENSATED_STD = "wrench_compensator/wrench_std"
COMPENSATED_VALID = "wrench_compensator/valid"

CLOCK = "/clock"
DIAGNOSTICS = "/diagnostics"
EMERGENCY_STOP = "/emergency_stop"
TF = "/tf"
TF_STATIC = "/tf_static"

ENCLAVES = "/tactile_dynamics_ros"
"""Parent of the security enclaves of nodes and tools; the policy has one for each."""


def contact_topic(name: str, kind: str) -> str:
    """Return the topic of a contact's force, force_std or pose in the world."""
    return f"contact/{name}/{kind}"


def link_topic(link: str, kind: str) -> str:
    """Return the topic of the pose or footprint of a part of the object.

    Args:
        link: link_1, whose topics are the object's, link_2 and so on.
        kind: pose or footprint.
    """
    return f"object/{kind}" if link == "link_1" else f"object/{link}/{kind}"


def fingertip_topic(finger: str, kind: str, sensor: str = "biotac") -> str:
    """Return the topic of a fingertip's force, force_std or slip in its sensor's frame.

    Args:
        finger: name of the finger.
        kind: what of it.
        sensor: kind of the robot's fingertips.
    """
    return f"{sensor}/{finger}/{kind}"


def enclave_of(name: str) -> list[str]:
    """Return the arguments, after `--ros-args`, that put a node into its own security enclave.

    They mean nothing where security is off, as it is unless ROS_SECURITY_ENABLE is true.
    """
    return ["--enclave", f"{ENCLAVES}/{name}"]
