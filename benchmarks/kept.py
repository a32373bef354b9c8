"""Results of an interrupted run, kept in files of this user alone."""

from __future__ import annotations

import os
import pickle
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import written_whole


def kept(path: Path | None, make: Callable[[], Any]) -> Any:
    """Return what a file keeps, or make it (and keep it there).

    Args:
        path: of the file; None to keep nothing.
        make: gives the result.

    Raises:
        BadInputError: others could have written the file, so that reading it runs what they want;
            or it cannot be written.
    """
    if path is None:
        return make()
    if not path.exists():
        found = make()
        with written_whole(path) as part:
            part.touch(mode=0o600)
            part.write_bytes(pickle.dumps(found))
        return found
    state = path.lstat()
    mine = stat.S_ISREG(state.st_mode) and state.st_uid == os.getuid()
    if not mine or state.st_mode & 0o022:
        raise BadInputError(f"{path}: others could have written it; remove it")
    return pickle.loads(path.read_bytes())
