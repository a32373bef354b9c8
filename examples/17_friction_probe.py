"""What is the friction of the surface that a finger has probed, and is it Coulomb's law?

    python examples/17_friction_probe.py [PROBE.mcap]

Prints the coefficient and whether the model is adequate, from the slips that `tactile-dynamics
record` keeps of a probe; without a recording, from simulated slips with mu = 0.6.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.api.discrepancies import Comparison
from tactile_dynamics_ros.api.questions import question_friction
from tactile_dynamics_ros.core.friction.estimate import SlipEvent
from tactile_dynamics_ros.recording.probe_slips import write_slips


def simulate() -> Path:
    """Write 20 slips in all directions."""
    random, slips = np.random.default_rng(0), []
    for k in range(20):
        normal, ratio = random.uniform(0.5, 1.5), 0.6 + 0.015 * random.normal()
        where = {"time": 2.0 * k + 1.0, "region": "body", "angle": random.uniform(0, 6.28)}
        where |= {"kinetic": 0.5 + 0.015 * random.normal(), "speed": 0.01, "sliding_normal": normal}
        slips.append(SlipEvent(**where, normal=normal, tangential=ratio * normal, std=0.015))
    return write_slips(slips, Path(tempfile.mkdtemp()) / "probe.mcap")


def main(arguments: list[str]) -> None:
    """Read or simulate, compare with Coulomb's law, print."""
    question = question_friction(Path(arguments[0]) if arguments else simulate())
    print(f"mu {question.model.mu[0]:.3f}")
    print(Comparison.of(question))


if __name__ == "__main__":
    main(sys.argv[1:])
