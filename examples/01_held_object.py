"""What does the object in the hand weigh, and how sure is that?

    python examples/01_held_object.py [RUN.mcap]

Prints mass, centre of mass and inertia with their standard deviations; without a recording, those
of a simulated one, and the true mass.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Read or simulate, estimate, print."""
    if arguments:
        print(td.estimate(td.read(*arguments)))
        return
    made = generate(1, scenario=ScenarioOptions(duration=6.0))
    print(td.estimate(Recording(made.streams, "synthetic")))
    print(f"true mass {made.truth()['mass']:.5f} kg")


if __name__ == "__main__":
    main(sys.argv[1:])
