"""Live estimation of the held object's inertia with constant cost per update."""

from tactile_dynamics_ros.core.inertia.live.config import IncrementalConfig
from tactile_dynamics_ros.core.inertia.live.estimator import IncrementalInertialEstimator
from tactile_dynamics_ros.core.inertia.live.live_estimate import LiveEstimate

__all__ = ["IncrementalConfig", "IncrementalInertialEstimator", "LiveEstimate"]
