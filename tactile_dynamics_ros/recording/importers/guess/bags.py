"""Which topics of a recording are the wrench and the pose of a load."""

from __future__ import annotations

from pathlib import Path

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.importers.bag_frames import (
    TF,
    frame_chain,
    read_frame,
    read_frames,
)
from tactile_dynamics_ros.recording.importers.bag_tables import frame_of, read_topic, topic_types
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.topics import suffice

WRENCHES = frozenset(["WrenchStamped"])
"""Types of messages, without their package, that hold a wrench."""
POSES = frozenset(["PoseStamped", "PoseWithCovarianceStamped", "TransformStamped", "Odometry"])
"""Types that hold a pose."""
_TOOLS = ("tool0", "flange", "tcp", "panda_hand_tcp", "panda_link8", "fr3_link8", "iiwa_link_ee")
"""Frames at the wrist of common arms, the likeliest first, if the wrench's frame is not on /tf."""


def bag_sources(path: Path, answers: Answers) -> tuple[Source, Source]:
    """Return the poses and the forces of a recording.

    Raises:
        Question: several topics may be meant, or none.
        BadInputError: the recording cannot be read.
    """
    types = topic_types(path)
    if suffice(types):
        raise BadInputError(f"{path} has the topics of a recording already: `estimate {path}`")
    wrenches = [t for t, kind in types.items() if kind.rpartition("/")[2] in WRENCHES]
    if not wrenches:
        raise Question(f"no topic holds a stamped wrench; there are {', '.join(sorted(types))}")
    wrench = wrenches[0]
    if len(wrenches) > 1:
        wrench = answers.choose("wrench", sorted(wrenches), "several topics hold a wrench")
    forces = {"file": path.name, "topic": wrench}
    poses = _pose_place(path, types, frame_of(path, wrench), answers)
    if poses["topic"] == TF:
        table = read_frame(path, poses["frame"])
    else:
        table = read_topic(path, poses["topic"])
    return (
        Source.of_topic(poses, table, answers),
        Source.of_topic(forces, read_topic(path, wrench), answers),
    )


def _pose_place(path: Path, types: dict[str, str], sensor: str, answers: Answers) -> dict[str, str]:
    """Return where the pose of the sensor is: its frame on /tf, or a topic.

    Raises:
        Question: several may be meant, or none.
    """
    topics = sorted(t for t, kind in types.items() if kind.rpartition("/")[2] in POSES)
    frames = _moving_frames(path, types)
    said = answers.get("pose")
    if said is not None:
        answers.choose("pose", [*topics, *frames], "")
        if said in topics:
            return {"file": path.name, "topic": said}
        return {"file": path.name, "topic": TF, "frame": said}
    if sensor in frames:
        return {"file": path.name, "topic": TF, "frame": sensor}
    if len(topics) == 1:
        return {"file": path.name, "topic": topics[0]}
    if topics:
        answers.choose("pose", topics, "several topics hold a pose")
    usual = [frame for frame in _TOOLS if frame in frames]
    if not frames:
        raise Question(f"no topic holds a stamped pose; there are {', '.join(sorted(types))}")
    answers.choose(
        "pose",
        usual or frames,
        f"the wrench is in '{sensor}', which is not on {TF}: which frame is",
    )
    return {}


def _moving_frames(path: Path, types: dict[str, str]) -> list[str]:
    """Return the frames of /tf that move in the root of their tree."""
    if TF not in types:
        return []
    edges = read_frames(path)
    chains = {child: frame_chain(edges, child, None, str(path)) for child in edges}
    return [name for name, parts in chains.items() if not all(edge.is_fixed for edge in parts)]
