"""How much friction does an object on a table have, and where is its centre of mass?

    python examples/03_pushed_object.py [PUSHES.mcap]

Prints the friction force, the centre of mass and, where the pushes determine them, mass and
friction coefficient; without a recording, of three simulated pushes.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import pushed


def main(arguments: list[str]) -> None:
    """Read or simulate pushes, estimate, print."""
    if arguments:
        print(td.estimate(td.read(*arguments, model="pushed")))
        return
    options = pushed.PushOptions(actions=pushed.ActionOptions(3))
    (made,) = pushed.generate([1], {}, options)
    print(td.estimate(PushedRecording(made.streams, "synthetic")))
    (true,) = made.truth()["links"]
    print(f"true friction force {true['friction_force_n']:.3f} N, mass {true['mass']:.3f} kg")


if __name__ == "__main__":
    main(sys.argv[1:])
