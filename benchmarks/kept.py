"""Results of an interrupted run: kept in files of this user alone, or a line for each answer."""

from __future__ import annotations

import json
import os
import pickle
import stat
from collections.abc import Callable, Hashable, Iterable, Sequence
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


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file, JSON in each line; a line that was cut off is left out."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [json.loads(line) for line in lines if line.strip().endswith("}")]


def continued(
    path: Path,
    keys: Sequence[Hashable],
    key_of: Callable[[dict[str, Any]], Hashable],
    answer: Callable[[list[int]], Iterable[dict[str, Any]]],
) -> list[dict[str, Any]]:
    """Return a row for each case; those that the file has are not asked again.

    Args:
        path: of the file, to which each new row is added at once.
        keys: of the cases.
        key_of: gives the key of a row.
        answer: gives the rows of the cases with these indices, in any order.
    """
    done = {key_of(row): row for row in read_rows(path)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        for row in answer([k for k, key in enumerate(keys) if key not in done]):
            done[key_of(row)] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
    return [done[key] for key in keys if key in done]
