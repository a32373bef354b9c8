"""Tosses of a cube onto a table: poses from tags on its faces, no forces."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import open_arrays
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.recording import Recording

ARCHIVE = "cube_tosses_550.npz"
RATE_HZ = 148.0
QUATERNION, POSITION = [1, 2, 3, 0], [4, 5, 6]


class ContactnetsCubeImporter(Importer):
    """The object's motion alone; nothing was measured at its contacts."""

    name = "contactnets-cube-tosses"
    summary = "one toss of a cube: object poses without contacts"
    source_help = "folder and toss, such as contactnets_cube_tosses/toss_017"

    def read(self, source: Path, options: Namespace) -> Recording:
        """Read one toss; quaternions are stored scalar first."""
        archive = source.parent / ARCHIVE
        with open_arrays(archive, "the archive of all tosses") as tosses:
            if source.name not in tosses:
                first, last = min(tosses), max(tosses)
                raise BadInputError(f"{archive} holds {first} to {last}, not '{source.name}'")
            rows = np.asarray(tosses[source.name], dtype=np.float64)
        pose = {
            "time": np.arange(len(rows)) / RATE_HZ,
            "position": rows[:, POSITION],
            "quaternion": rows[:, QUATERNION],
        }
        return Recording.from_arrays({}, pose, source=str(source))
