"""What was weighed: recordings kept as files, and what the verbs of the command say of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.weighing.arm import SerialArm
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.recording.recording import Recording
from tactile_dynamics_ros.ros.arm_motion import Taken

COMMAND = (sys.executable, "-P", "-m", "tactile_dynamics_ros.cli.main")


@dataclass(frozen=True)
class Weighed:
    """Answers about one body.

    Attributes:
        document: what `estimate --json` prints.
        file: what `estimate --save` wrote.
        doubts: why the numbers are not to be used; empty if nothing speaks against them.
    """

    document: dict[str, Any]
    file: Path
    doubts: tuple[str, ...]


def new_folder(parent: str) -> Path:
    """Return a new folder, made, for what one weighing leaves.

    Raises:
        BadInputError: it cannot be made.
    """
    folder = Path(parent) / f"{datetime.now():%Y%m%d-%H%M%S}"
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise BadInputError(f"folder {folder} cannot be made: {error.strerror}") from error
    return folder


def keep(taken: Taken, arm: SerialArm, sign: float, path: Path) -> Path:
    """Write a motion's measurements as a recording of one object on a wrist sensor.

    The object's frame is the sensor's; the arm's joints say how it moves.

    Args:
        taken: during the motion.
        arm: whose tip is the sensor.
        sign: -1 where the sensor reads what acts on it, 1 where it reads what it applies.
        path: file to write.

    Raises:
        BadInputError: too little was measured.
    """
    if len(taken.joint_time) < 2 or len(taken.wrench_time) < 2:
        raise BadInputError("weighing: hardly any joints or wrenches came during the motion")
    pose, wrench = arm.tip_poses(np.array(taken.positions)), sign * np.array(taken.wrenches)
    recording = Recording.from_arrays(
        {
            "wrist": {
                "time": np.array(taken.wrench_time),
                "force": wrench[:, :3],
                "torque": wrench[:, 3:],
                "position": np.zeros(3),
                "rotation": np.eye(3),
            }
        },
        {
            "time": np.array(taken.joint_time),
            "position": pose[:, :3, 3],
            "rotation": pose[:, :3, :3],
        },
        contact_frame="object",
        source=str(path),
    )
    return write_bag(recording.streams, path)


def ask(files: Sequence[Path], file: Path, tool: Path | None = None) -> Weighed:
    """Estimate and compare, as a person does with the command.

    Args:
        files: recordings of the same body.
        file: where its numbers are kept.
        tool: file of what is carried as well and taken out; None for nothing.

    Raises:
        NotIdentifiableError: the recordings do not tell the mass, or the model does not fit.
    """
    document = save(files, file, tool)
    compared = _verb("compare", *map(str, files))
    doubts = (
        [] if compared["adequate"] else [f"the model does not fit (p = {compared['p_value']:.1g})"]
    )
    if document["undetermined"]:
        doubts.append(f"undetermined: {', '.join(document['undetermined'])}")
    return Weighed(document, file, tuple(doubts))


def save(files: Sequence[Path], file: Path, tool: Path | None = None) -> dict[str, Any]:
    """Estimate a body and keep its numbers; arguments as of `ask`. Return the document."""
    taken_out = [] if tool is None else ["--tool", str(tool)]
    return _verb("estimate", *map(str, files), *taken_out, "--save", str(file))


def advise(file: Path) -> list[str]:
    """Return what `check` would record as well, one sentence each."""
    advice: list[str] = _verb("check", str(file))["advice"]
    return advice


def _verb(*words: str) -> dict[str, Any]:
    done = subprocess.run([*COMMAND, *words, "--json"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        said = lines[-1].removeprefix("error: ") if lines else "it ended without a word"
        raise NotIdentifiableError(f"{words[0]} {' '.join(words[1:2])}: {said}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document
