"""Settings of the live estimator."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.pose_noise import ASSUMED_POSITION_STD, ASSUMED_ROTATION_STD


@dataclass(frozen=True)
class IncrementalConfig:
    """How the live estimator reads its streams, weighs them and what it assumes beforehand."""

    residual_half_width: float = parameter(
        0.04, "half width of the windows that differentiate the residual's poses", "s", 0.005, 0.5
    )
    regressor_half_width: float = parameter(
        0.12, "half width of the windows that denoise the motion for the regressor", "s", 0.02, 1.0
    )
    window_degree: int = parameter(4, "degree of the local polynomials", "", 2, 6)
    maximum_rate: float = parameter(125.0, "poses closer in time than this are skipped", "Hz", 1.0)
    maximum_gap: float = parameter(0.1, "a longer gap between poses starts anew", "s", 0.01, 2.0)
    contact_timeout: float = parameter(
        0.1, "a contact silent for longer is taken as absent", "s", 0.01, 2.0
    )
    replay_duration: float = parameter(
        30.0, "raw samples kept, to be weighed again when the estimate has moved", "s", 1.0, 300.0
    )
    replay_batch: int = parameter(5, "kept samples processed again per update", "", 1, 200)
    point_std: float = parameter(
        0.0, "standard deviation of contact points, at least (scatter is measured)", "m", 0.0, 0.05
    )
    torque_std: float = parameter(
        1e-3, "standard deviation of torques until their scatter is measured", "N m", 0.0
    )
    force_std: float = parameter(
        0.03, "standard deviation of unstated forces until their scatter is measured", "N", 1e-6
    )
    rotation_std: float = parameter(
        ASSUMED_ROTATION_STD,
        "standard deviation of rotations until their scatter is measured, if none is stated",
        "rad",
        1e-6,
    )
    position_std: float = parameter(
        ASSUMED_POSITION_STD,
        "standard deviation of positions until their scatter is measured, if none is stated",
        "m",
        1e-7,
    )
    maximum_mass: float = parameter(
        100.0, "a heavier object is not believed: forces are not in N", "kg", 1e-3
    )
    prior_weight: float = parameter(
        0.02, "weight of the prior's log-det divergence, in nats", "", 1e-6, 1e3
    )
    outlier_gate: float = parameter(
        8.0, "whitened innovations beyond this many deviations are rejected", "", 3.0
    )
    huber_threshold: float = parameter(
        1.9, "whitened innovations beyond this many deviations lose weight", "", 1.0
    )

    def __post_init__(self) -> None:
        """Check ranges and that the regressor's window contains the residual's."""
        check_ranges(self)
        if self.regressor_half_width < self.residual_half_width:
            raise BadInputError(
                f"IncrementalConfig.regressor_half_width = {self.regressor_half_width} s: expected "
                f"at least residual_half_width = {self.residual_half_width} s"
            )
