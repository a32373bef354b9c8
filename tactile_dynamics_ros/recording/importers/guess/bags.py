"""A mapping for a recording of a robot: which topics are the wrench and the pose of a load."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording.frames import BASES
from tactile_dynamics_ros.recording.importers.bag_tables import (
    TF,
    frame_chain,
    has_frames,
    read_frame,
    read_frames,
    topic_types,
)
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.bag_links import (
    Arm,
    Mount,
    fitting_mount,
    mounts_of,
)
from tactile_dynamics_ros.recording.importers.guess.bag_topics import Topic, read_topics
from tactile_dynamics_ros.recording.importers.guess.orientations import readings_of
from tactile_dynamics_ros.recording.importers.guess.sources import Source
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Scene, Weighing
from tactile_dynamics_ros.recording.importers.guess.wrist import WristGuess
from tactile_dynamics_ros.recording.topics import RECEIVE, suffice

Note = Callable[[str, str], None]
"""Takes label and text of what was understood."""

_TOOLS = ("tool0", "flange", "tcp", "panda_hand_tcp", "panda_link8", "fr3_link8", "iiwa_link_ee")
"""Frames at the wrist of common arms, the likeliest first, if the wrench's frame is not known."""
_MOTION_SHOWN = 0.5
"""Misfit over the change of the forces below which they follow the motion, whether or not a weight
is in them."""


@dataclass(frozen=True)
class Chosen:
    """Where poses come from.

    Attributes:
        source: the poses.
        frame: that they are of; "" if nothing says it.
        topic: of them; None for frames of /tf and links of a URDF.
    """

    source: Source
    frame: str
    topic: Topic | None = None


def bag_mapping(path: Path, answers: Answers, note: Note) -> dict[str, Any]:
    """Return the mapping of a recording.

    Args:
        path: of the recording.
        answers: to questions.
        note: takes what was understood.

    Raises:
        Question: several topics may be meant, or none, or the numbers contradict.
        BadInputError: the recording cannot be read.
    """
    if suffice(topic_types(path)):
        raise BadInputError(f"{path} has the topics of a recording already: `estimate {path}`")
    topics = read_topics(path)
    wrench = _wrench(path, topics, answers)
    chosen = _poses(path, topics, wrench, answers)
    forces = chosen.source if chosen.topic is wrench else wrench.source(path, answers)
    _require_one_clock(path, chosen, forces, topics, wrench, answers)
    for source in {id(s): s for s in (chosen.source, forces)}.values():
        stamps = "".join(f"; {line}" for line in source.table.problems)
        note(source.label, f"{len(source.table.values)} messages; {source.table.layout}{stamps}")
    mount = _mount(path, chosen, wrench, forces, answers, note)
    poses = chosen.source if mount is None else mount.apply(chosen.source)
    forces = poses if wrench is chosen.topic else forces
    mapping = _guessed(poses, forces, wrench.frame, answers, note)
    return _by_section(mapping, mount)


def _by_section(mapping: dict[str, Any], mount: Mount | None) -> dict[str, Any]:
    """Say in the section of the pose what is not in its table: a mounting, or a URDF."""
    sections = [mapping.get("object_pose"), mapping["contacts"]["wrist"].get("pose")]
    for section in filter(None, sections):
        if mount is not None:
            section["sensor_pose"] = mount.entry
        if "urdf" in section:
            del section["position"], section["quaternion"]
    return mapping


def _guessed(
    poses: Source, forces: Source, frame: str, answers: Answers, note: Note
) -> dict[str, Any]:
    """Return the mapping that the weight tests, or the motion where no weight shows.

    Raises:
        Question: neither does.
    """
    try:
        return WristGuess(poses, forces, answers, note).mapping()
    except Question:
        given = {"frame", "orientation", "reads"} & set(answers.given)
        weighed = _weighing(poses, forces)
        if given or weighed is None or weighed.inertial is None:
            raise
        if weighed.seen or weighed.rms > _MOTION_SHOWN * weighed.spread:
            raise
    reads = "object" if weighed.inertial > 0.0 else "load"
    axes = "world" if BASES.fullmatch(frame) else "sensor"
    turn = poses.turn(answers)
    label = readings_of(turn, poses.table)[0].label
    note(
        "weight",
        f"none in the forces (zeroed with the load on?); axes of the {axes}, and the sign by "
        f"accelerations of about {abs(weighed.inertial):.2g} kg: check them",
    )
    known = Answers({**answers.given, "frame": axes, "orientation": label, "reads": reads})
    return WristGuess(poses, forces, known, note).mapping()


def _weighing(poses: Source, forces: Source) -> Weighing | None:
    """Return the load that the forces show in axes of the sensor, None without clocks or poses."""
    answers = Answers()
    if poses.time is None or forces.time is None or not poses.groups.turn:
        return None
    turn, force = poses.turn(answers), forces.groups.force[0]
    position = poses.position(turn, answers)
    if position is None:
        return None
    measured = Measured(
        forces.table.columns(*force.columns),
        forces.time.values,
        readings_of(turn, poses.table)[0].rotations(poses.table),
        poses.time.values,
        poses.table.columns(*position.columns),
    )
    return Scene(measured).weigh("sensor")


def _wrench(path: Path, topics: Sequence[Topic], answers: Answers) -> Topic:
    """Return the topic of the wrench.

    Raises:
        Question: there are several, or none.
    """
    holding = [topic for topic in topics if topic.groups.force]
    sure = [topic for topic in holding if topic.is_wrench]
    arrays = [topic for topic in holding if not topic.is_twist]
    found = sure or arrays or [topic for topic in holding if topic.may_be_wrench]
    if not found:
        known = ", ".join(f"{name} ({kind})" for name, kind in sorted(topic_types(path).items()))
        raise Question(f"no topic holds a wrench; there are {known}")
    own = [topic for topic in found if topic.frame and not BASES.fullmatch(topic.frame)]
    found = own if len(own) == 1 else found
    if answers.get("wrench") is not None:
        found = holding
    elif len(found) == 1:
        return found[0]
    names = sorted(topic.name for topic in found)
    name = answers.choose("wrench", names, "several topics hold a wrench")
    return next(topic for topic in found if topic.name == name)


def _poses(path: Path, topics: Sequence[Topic], wrench: Topic, answers: Answers) -> Chosen:
    """Return the poses: of the sensor's own frame if that is known, else of a topic or a link.

    Raises:
        Question: several may be meant, or none.
    """
    arm = Arm.find(path, topics, answers.get("urdf"))
    frames = _moving_frames(path)
    links = arm.links if arm else []
    poses = {t.name: t for t in topics if t.is_pose or t.groups.turn}
    said = answers.get("pose")
    if said is not None:
        said = answers.choose("pose", [*poses, *frames, *links], "")
    wanted = said or (wrench.frame if wrench.frame in (*frames, *links) else None)
    if wanted is None and wrench.groups.turn:
        wanted = wrench.name
    if wanted is None and answers.get("urdf") is None and poses:
        plain = sorted(name for name, topic in poses.items() if topic.is_pose)
        names = plain or sorted(poses)
        wanted = names[0]
        if len(names) > 1:
            wanted = answers.choose("pose", names, "several topics hold a pose")
    if wanted is None and arm is not None:
        wanted = arm.tip(_TOOLS, answers)
    if wanted is None:
        wanted = _usual_frame(topics, frames, wrench.frame, answers)
    if wanted in poses:
        topic = wrench if wanted == wrench.name else poses[wanted]
        return Chosen(topic.source(path, answers), topic.child, topic)
    if wanted in frames:
        return Chosen(_frame_source(path, wanted, answers), wanted)
    assert arm is not None
    return Chosen(arm.source(wanted, answers), wanted)


def _usual_frame(
    topics: Sequence[Topic], frames: Sequence[str], sensor: str, answers: Answers
) -> str:
    """Return a frame at the wrist by its name.

    Raises:
        Question: always but where it was answered before.
    """
    if not frames:
        joints = any(topic.is_joints for topic in topics)
        hint = "; joint angles are there: say --urdf FILE" if joints else ""
        names = ", ".join(sorted(topic.name for topic in topics))
        raise Question(f"no topic holds a pose; there are {names}{hint}")
    usual = [frame for frame in _TOOLS if frame in frames]
    return answers.choose(
        "pose",
        usual or frames,
        f"the wrench is in '{sensor}', which is not on {TF}: which frame is",
    )


def _frame_source(path: Path, frame: str, answers: Answers) -> Source:
    stamps = answers.get("stamps") or "header"
    place = {"file": path.name, "topic": TF, "frame": frame}
    place |= {} if stamps == "header" else {"stamps": stamps}
    return Source.of_topic(place, read_frame(path, frame, None, stamps), answers)


def _moving_frames(path: Path) -> list[str]:
    """Return the frames of /tf that move in the root of their tree."""
    if not has_frames(path):
        return []
    edges = read_frames(path)
    chains = {child: frame_chain(edges, child, None, str(path)) for child in edges}
    return [name for name, parts in chains.items() if not all(edge.is_fixed for edge in parts)]


def _require_one_clock(
    path: Path,
    chosen: Chosen,
    forces: Source,
    topics: Sequence[Topic],
    wrench: Topic,
    answers: Answers,
) -> None:
    """Check that stamps of poses and forces overlap.

    Raises:
        Question: they do not, but the times at which they were received do.
    """
    if _overlap(chosen.source, forces):
        return
    received = Answers({**answers.given, "stamps": RECEIVE})
    again = _poses(path, topics, wrench, received).source
    if answers.get("stamps") is None and _overlap(again, wrench.source(path, received)):
        raise Question(
            f"the stamps of {chosen.source.label} and of {forces.label} are of two clocks and "
            "never overlap; the times at which both were received do: say --stamps receive"
        )


def _overlap(poses: Source, forces: Source) -> bool:
    one, other = (source.table.column("time") for source in (poses, forces))
    return bool(np.min(one) <= np.max(other) and np.min(other) <= np.max(one))


def _mount(
    path: Path, chosen: Chosen, wrench: Topic, forces: Source, answers: Answers, note: Note
) -> Mount | None:
    """Return how the sensor sits on the frame of the poses, None if it is that frame.

    Raises:
        Question: frames that carry the sensor differ, and nothing tells which one the pose is of.
    """
    if not wrench.frame or chosen.frame == wrench.frame or BASES.fullmatch(wrench.frame):
        return None
    if not chosen.source.table.names[1:] or chosen.topic is wrench:
        return None
    mounts = mounts_of(path, wrench.frame)
    mount = _named_mount(mounts, chosen) or fitting_mount(
        mounts, lambda one: _weighing(one.apply(chosen.source), forces)
    )
    if mount is None:
        frames = [mount.frame for mount in mounts]
        name = answers.choose(
            "body", frames, f"which frame is {chosen.source.label} of, the one with the sensor"
        )
        mount = next(one for one in mounts if one.frame == name)
    if mount.is_none:
        return None
    note("sensor", f"'{wrench.frame}' sits on '{mount.frame}' as /tf_static says: {mount.words}")
    return mount


def _named_mount(mounts: Sequence[Mount], chosen: Chosen) -> Mount | None:
    """Return the mounting on the frame that the poses name, or the only one."""
    named = [mount for mount in mounts if mount.frame == chosen.frame]
    if len(mounts) == 1 or named:
        return (named or list(mounts))[0]
    if chosen.topic is None:
        return None
    called = [mount for mount in mounts if chosen.topic.is_called(mount.frame)]
    return called[0] if len(called) == 1 else None
