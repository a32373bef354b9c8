"""The PyBullet stand-in for the hardware; the only part of the package that imports pybullet."""

from tactile_dynamics_ros.core.errors import require_extra

require_extra("pybullet", "sim", "the simulated robot")
