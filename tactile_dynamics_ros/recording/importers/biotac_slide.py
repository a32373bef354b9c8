"""A fingertip that an arm slides over a fixed plate; the force is the arm's own estimate."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np

from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.importers.tables import read_table
from tactile_dynamics_ros.recording.recording import Recording


class BiotacSlideImporter(Importer):
    """The plate is the object and does not move; the fingertip is the one contact "biotac".

    The force that the arm feels is turned to the force on the plate. The arm's torque is about
    its own flange, not about the contact point, and is left out, as are the tactile channels:
    they are differences from an unknown baseline rather than counts.
    """

    name = "biotac-slide"
    summary = "a fingertip sliding over a plate: contact force and path, object at rest"
    source_help = "folder or .tar.gz and trial, such as slides_20mat_x4.tar.gz/mat3_1"

    def read(self, source: Path, options: Namespace) -> Recording:
        """Read one trial."""
        wrench, path = (
            read_table(source.with_name(f"{source.name}_{kind}.csv")) for kind in ("cw", "cp")
        )
        time = path.column("timestamp")
        contact = {
            "time": wrench.column("timestamp"),
            "force": -wrench.columns("fx", "fy", "fz"),
            "pose_time": time,
            "position": path.columns("posx", "posy", "posz"),
            "quaternion": path.columns("ox", "oy", "oz", "ow"),
        }
        plate = {
            "time": time,
            "position": np.zeros((len(time), 3)),
            "quaternion": [0.0, 0.0, 0.0, 1.0],
        }
        return Recording.from_arrays({"biotac": contact}, plate, source=str(source))
