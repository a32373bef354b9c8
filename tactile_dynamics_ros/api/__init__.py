"""The product from Python: `import tactile_dynamics_ros as td`, then the verbs of the command."""

from tactile_dynamics_ros.api.verbs import check, compare, diagnose, estimate, explain, read, shape
from tactile_dynamics_ros.api.wrist import read_wrist

__all__ = ["check", "compare", "diagnose", "estimate", "explain", "read", "read_wrist", "shape"]
