"""Where does the model of a rigid body fail?

    python examples/08_where_the_model_fails.py [RUN.mcap]

Prints the error in units of the sensor noise, whether that is adequate, and at which times, speeds
and forces most of the error occurs; without a recording, of a simulated one with a sloshing fluid.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms


def main(arguments: list[str]) -> None:
    """Read or simulate, compare, print."""
    if arguments:
        print(td.compare(td.read(*arguments)))
        return
    scenario = ScenarioOptions(duration=5.0)
    made = generate_at_whitened_rms(2, {"sloshing_mass": 3.0}, scenario)
    print(td.compare(Recording(made.streams, "synthetic")))


if __name__ == "__main__":
    main(sys.argv[1:])
