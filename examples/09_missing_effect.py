"""Which physical effect is missing from the model?

    python examples/09_missing_effect.py [RUN.mcap]

Prints the missing effect in a sentence, the candidates in their order, and the verdict as a word
for programs; without a recording, of a simulated one with drag.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate_at_whitened_rms


def main(arguments: list[str]) -> None:
    """Read or simulate, diagnose, print."""
    scenario = ScenarioOptions(duration=5.0)
    made = generate_at_whitened_rms(3, {"viscous_drag": 3.0}, scenario)
    recording = td.read(*arguments) if arguments else Recording(made.streams, "synthetic")
    found = td.diagnose(recording)
    print(found)
    print(f"verdict {found.verdict}, effect {found.effect}")


if __name__ == "__main__":
    main(sys.argv[1:])
