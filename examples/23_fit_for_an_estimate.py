"""Is this recording fit for an estimate, and what should I record as well?

    python examples/23_fit_for_an_estimate.py [RUN.mcap]

Prints the rates, the faults, what is not known well enough, and a motion that would bring it;
without a recording, of a simulated one in which the object hardly turns.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Read or simulate, check, print."""
    calm = ScenarioOptions(duration=4.0, band_hz=(0.2, 0.8), angle_peak_deg=(2.0, 4.0))
    streams = generate(1, scenario=calm).streams
    found = td.check(td.read(*arguments) if arguments else Recording(streams, "synthetic"))
    print(found)
    print("ready" if found.ready else "not ready")


if __name__ == "__main__":
    main(sys.argv[1:])
