"""Do the stated standard deviations hold on my own recording, whose truth nobody knows?

    python examples/27_parts_of_a_recording.py [RUN.mcap]

Prints mass and centre of mass of four parts, each estimated alone, and their scatter in units of
the stated standard deviations: about 1 if they hold, more if the model misses something.
"""

import sys

import numpy as np

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Read or simulate, estimate each part, print."""
    streams = generate(1, scenario=ScenarioOptions(duration=12.0)).streams
    recording = td.read(*arguments) if arguments else Recording(streams, "synthetic")
    values, stds = [], []
    for start, stop in np.linspace(0.0, recording.duration, 5)[[[0, 1], [1, 2], [2, 3], [3, 4]]]:
        found = td.estimate(recording.between(start, stop)).found
        values.append([found.inertia.mass, *found.inertia.com])
        stds.append(found.parameter_std[:4])
        print(f"{start:.0f} to {stop:.0f} s: mass, centre {np.round(values[-1], 5)} kg, m")
    weight = np.array(stds) ** -2.0
    mean = np.sum(weight * values, axis=0) / np.sum(weight, axis=0)
    scatter = np.sqrt(np.sum(weight * (values - mean) ** 2) / (4 * 3))
    print(f"scatter {scatter:.2f} times the stated standard deviations")


if __name__ == "__main__":
    main(sys.argv[1:])
