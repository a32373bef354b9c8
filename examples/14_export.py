"""How do I hand the estimate to a simulator or a robot's controller?

    python examples/14_export.py [RUN.mcap]

Prints the body as a URDF, and as the payload in URScript. docs/everyday.md lists the other formats.
"""

import sys

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Read or simulate, estimate, print in two formats."""
    streams = generate(1, scenario=ScenarioOptions(duration=10.0)).streams
    found = td.estimate(td.read(*arguments) if arguments else Recording(streams, "synthetic"))
    for form in ("urdf", "ur"):
        print(found.export(form).text)


if __name__ == "__main__":
    main(sys.argv[1:])
