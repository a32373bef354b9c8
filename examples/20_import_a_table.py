"""My data are a CSV whose columns nobody documented: how do they become a recording?

    python examples/20_import_a_table.py [LOG.csv]

Prints what each column was found to mean, and the estimate; without a table, of a simulated log.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import tactile_dynamics_ros as td
from tactile_dynamics_ros.recording.importers.csv_mapping import read_mapping
from tactile_dynamics_ros.recording.importers.guess import guess_tables

NAMES = "t_ms,x,y,z,qx,qy,qz,qw,fx,fy,fz,tx,ty,tz"


def log() -> Path:
    """Write the log of a wrist that turns a tool of 1.2 kg."""
    time, path = np.arange(0.0, 40.0, 0.05), Path(tempfile.mkdtemp()) / "log.csv"
    turn = Rotation.from_rotvec(np.transpose([np.sin(0.19 * time), np.sin(0.26 * time), 0 * time]))
    force = turn.inv().apply([0.0, 0.0, 9.81 * 1.2])
    noise = np.random.default_rng(0).normal(size=(len(time), 6)) * np.repeat([0.05, 2e-3], 3)
    wrench = np.hstack([force, np.cross([0.0, 0.01, 0.06], force)]) + noise
    table = np.hstack([1e3 * time[:, None], 0 * force + 300.0, turn.as_quat(), wrench])
    np.savetxt(path, table, "%.6f", ",", header=NAMES, comments="")
    return path


path = Path(sys.argv[1]) if sys.argv[1:] else log()
guess = guess_tables([path])
for what, meaning in guess.understood:
    print(f"{what}: {meaning}")
print(guess.question or td.estimate(read_mapping(guess.mapping, path.parent, str(path))))
