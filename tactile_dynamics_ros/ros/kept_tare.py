"""The last tare of the fingertips in a file, which outlives the node."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.files import own_folder, written_whole
from tactile_dynamics_ros.core.reading import require_file


class KeptTare:
    """Frames of the last tare in a file, so that a restarted node need not open the hand.

    Args:
        fingers: how many there are.
        path: path of the file; if empty, one per ROS domain and namespace in the user's own folder.
        namespace: namespace of the node, so that each of several hands has its own.

    Raises:
        BadInputError: there is no folder of this user alone.
    """

    def __init__(self, fingers: int, path: str = "", namespace: str = "/") -> None:
        self._shape = (fingers, 44)
        parts = [os.environ.get("ROS_DOMAIN_ID", "0"), *namespace.split("/")]
        name = "_".join(str(part) for part in ["biotac_tare", *parts] if part != "")
        self.path = Path(path) if path else own_folder() / f"{name}.npy"

    def read(self, max_age: float) -> NDArray[np.float64] | None:
        """Return the frames (K, F, 44), or None if none were in use within `max_age` seconds."""
        try:
            if time.time() - self.path.stat().st_mtime > max_age:
                return None
            frames = np.load(require_file(self.path))
        except (BadInputError, OSError, ValueError, EOFError):
            return None
        return frames if frames.ndim == 3 and frames.shape[1:] == self._shape else None

    def refresh(self) -> None:
        """Note that the tare is in use."""
        with contextlib.suppress(OSError):
            os.utime(self.path)

    def write(self, frames: NDArray[np.float64]) -> None:
        """Keep frames (K, F, 44)."""
        try:
            with written_whole(self.path) as part, part.open("wb") as stream:
                np.save(stream, frames)
        except BadInputError as error:
            raise NotIdentifiableError(f"tare cannot be kept: {error}") from error
