"""How do I estimate a folder of recordings at once?

    python examples/07_many_recordings.py [FOLDER]

Prints the table with one row per recording (two simulated ones if no folder is given), and where
the page of reports is. From the shell: tactile-dynamics batch estimate 'FOLDER/*.mcap' --out OUT
"""

import sys
import tempfile
from pathlib import Path

from tactile_dynamics_ros.cli.main import main as tactile_dynamics
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.synthetic import ScenarioOptions, generate


def main(arguments: list[str]) -> None:
    """Write recordings if there are none, estimate all, print the table."""
    folder = Path(arguments[0] if arguments else tempfile.mkdtemp())
    for seed in () if arguments else (1, 2):
        streams = generate(seed, scenario=ScenarioOptions(duration=5.0)).streams
        Recording(streams, "synthetic").to_bag(folder / f"run_{seed}.mcap")
    out = Path(tempfile.mkdtemp())
    tactile_dynamics(["batch", "estimate", f"{folder}/*.mcap", "--out", f"{out}", "--workers", "1"])
    print((out / "table.csv").read_text())


if __name__ == "__main__":
    main(sys.argv[1:])
