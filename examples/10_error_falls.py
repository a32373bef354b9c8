"""How far does the error fall when missing effects are added one by one?

    python examples/10_error_falls.py [RUN.mcap]

Prints each added effect with the error after it, and mass before and after; without a recording,
of a simulated one with drag.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms


def main(arguments: list[str]) -> None:
    """Read or simulate, explain, print the steps."""
    scenario = ScenarioOptions(duration=5.0)
    made = generate_at_whitened_rms(3, {"viscous_drag": 3.0}, scenario)
    recording = td.read(*arguments) if arguments else Recording(made.streams, "synthetic")
    found = td.explain(recording)
    for step in found.to_json()["steps"]:
        print(step["added"], f"error {step['error']:.2f}")
    print(found)


if __name__ == "__main__":
    main(sys.argv[1:])
