"""One recording is too short: how do I ask several recordings of one object together?

    python examples/18_several_recordings.py [FIRST.mcap SECOND.mcap ..]

Prints the standard deviation of the mass from each of two simulated recordings, and from both.
"""

import sys
from dataclasses import replace

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import Scenario, ScenarioOptions
from tactile_dynamics_ros.synthetic.recordings import record


def main(arguments: list[str]) -> None:
    """Read or simulate, estimate each and all together, print."""
    first, second = (Scenario.draw(seed, ScenarioOptions(duration=4.0)) for seed in (1, 2))
    runs = [td.read(path) for path in arguments] or [
        Recording(record(scenario, (), None).streams, f"run {k}")
        for k, scenario in enumerate((first, replace(second, body=first.body)))
    ]
    for recording in (*runs, Recording.join(runs)):
        mass = td.estimate(recording).to_json()["mass"]
        print(f"{recording.source:14s} mass {mass['value']:.5f} ± {mass['std']:.5f} kg")


if __name__ == "__main__":
    main(sys.argv[1:])
