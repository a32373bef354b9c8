"""What stands on the table?

    python examples/16_shape_of_a_cloud.py [CLOUD.ply ..]

Prints the object as a superquadric with its size and place, the noise, and where to look from
next; without a cloud, for a simulated cylinder that is seen from one side.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import tactile_dynamics_ros as td


def cylinder() -> Path:
    """Write points of the near half and the top of a cylinder of 60 x 60 x 100 mm, in m."""
    random = np.random.default_rng(0)
    angle = np.pi * random.uniform(size=1500)
    side = [0.03 * np.cos(angle), -0.03 * np.sin(angle), 0.1 * random.uniform(size=1500)]
    radius, turn = 0.03 * np.sqrt(random.uniform(size=700)), 2 * np.pi * random.uniform(size=700)
    top = [radius * np.cos(turn), radius * np.sin(turn), np.full(700, 0.1)]
    points = np.concatenate([np.transpose(side), np.transpose(top)])
    path = Path(tempfile.mkdtemp()) / "cylinder.txt"
    np.savetxt(path, points + 3e-4 * random.normal(size=points.shape))
    return path


def main(arguments: list[str]) -> None:
    """Fit and print."""
    print(td.shape(*(arguments or [cylinder()]), support=0.0))


if __name__ == "__main__":
    main(sys.argv[1:])
