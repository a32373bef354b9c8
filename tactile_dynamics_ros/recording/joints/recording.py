"""A recording of an arm's joints: from a bag or a table, and back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_text
from tactile_dynamics_ros.core.streams.joint_streams import JointStreams
from tactile_dynamics_ros.recording.bag_files import read_messages, recorded_types
from tactile_dynamics_ros.recording.bag_writer import write_tables
from tactile_dynamics_ros.recording.cleaning import ranked_lines
from tactile_dynamics_ros.recording.joints.states import JOINT_STATE, decode_states, encode_states
from tactile_dynamics_ros.recording.topics import ROBOT_DESCRIPTION

TABLES = (".csv", ".txt", ".tsv")
"""Ends of the names of tables with a column for each joint's position and torque."""
_STRING = "std_msgs/msg/String"
_BESIDE = ("JointState", "String", "TFMessage", "tfMessage", "Clock", "Log", "ParameterEvent")
"""Ends of types of topics that a recording of joints alone may have beside them."""
_MORE_BESIDE = ("DiagnosticArray", "JointTrajectory", "JointTrajectoryControllerState")
"""The same, of what drives publish of themselves."""


def is_of_joints(path: Path, types: Mapping[str, str] | None = None) -> bool:
    """Whether a recording holds torques of joints and no forces: an arm without a wrist sensor.

    Args:
        path: of the recording.
        types: of its topics, if they are known.

    Raises:
        BadInputError: there is no recording at the path.
    """
    if path.suffix in TABLES:
        return True
    known = recorded_types(path) if types is None else types
    states = [topic for topic, kind in known.items() if kind == JOINT_STATE]
    if not states or not all(kind.endswith(_BESIDE + _MORE_BESIDE) for kind in known.values()):
        return False
    return any(_has_effort(path, topic) for topic in states)


def _has_effort(path: Path, topic: str) -> bool:
    few = [raw for (_, _, _, raw), _ in zip(read_messages(path, topic), range(20), strict=False)]
    return decode_states(few, [0] * len(few)) is not None


@dataclass(frozen=True, repr=False)
class JointRecording:
    """Positions and torques of an arm's joints, with what had to be left out.

    Attributes:
        streams: what was measured; time zero is the first sample.
        source: where the recording comes from, for messages to the user.
        problems: one line of text per kind of fault met, and how often it was met.
        epoch_ns: stamp of time zero in nanoseconds.
    """

    streams: JointStreams
    source: str
    problems: Mapping[str, int] = field(default_factory=dict)
    epoch_ns: int = 0

    def __repr__(self) -> str:
        """Return source, length and joints in one line; the arrays are in `streams`."""
        names = ", ".join(self.streams.names)
        return f"{type(self).__name__}({self.source}: {self.duration:.1f} s, joints {names})"

    @classmethod
    def read(
        cls,
        path: str | Path,
        urdf: str | Path | None = None,
        known: str = "",
        remap: Mapping[str, str | Sequence[str]] | None = None,
    ) -> JointRecording:
        """Read a bag, or a table.

        Args:
            path: rosbag2 directory, .mcap, .db3, ROS 1 .bag, or a table (.csv).
            urdf: of the arm; `/robot_description` of the bag if None.
            known: text of a URDF that is taken where there is neither.
            remap: of a table: columns, and what they are; see `read_joint_table`.

        Raises:
            BadInputError: it cannot be read, has no torques, or there is no URDF.
        """
        file = Path(path)
        text = None if urdf is None else read_text(Path(urdf), "a URDF")
        if file.suffix in TABLES:
            text = text or known
            if not text:
                raise BadInputError(
                    f"{path}: a table of an arm's joints needs its URDF (--urdf FILE); read one "
                    f"of forces and poses by: tactile-dynamics import {path} --guess"
                )
            from tactile_dynamics_ros.recording.joints.table import read_joint_table

            streams, start, problems = read_joint_table(file, text, remap)
            return cls(streams, str(path), problems, round(start * 1e9))
        from tactile_dynamics_ros.recording.importers.joint_angles import urdf_text

        text = text or urdf_text(ROBOT_DESCRIPTION, file.parent, file, required=False) or known
        if not text:
            raise BadInputError(
                f"{path}: no {ROBOT_DESCRIPTION} recorded; give the URDF of the arm: --urdf FILE"
            )
        return cls._from_bag(file, text)

    @classmethod
    def _from_bag(cls, path: Path, urdf: str) -> JointRecording:
        found = []
        for topic, kind in recorded_types(path).items():
            if kind == JOINT_STATE:
                messages = [(raw, received) for _, _, received, raw in read_messages(path, topic)]
                states = decode_states([m[0] for m in messages], [m[1] for m in messages])
                found += [] if states is None else [states]
        if not found:
            raise BadInputError(
                f"{path}: no {JOINT_STATE} with an effort for each joint; record /joint_states of "
                "a driver that reports torques"
            )
        states = max(found, key=lambda one: one.effort.size)
        start = float(states.time[0])
        streams = JointStreams(
            states.names, states.time - start, states.position, states.effort, urdf
        )
        return cls(streams, str(path), dict(states.problems), round(start * 1e9))

    @classmethod
    def join(cls, recordings: Sequence[JointRecording]) -> JointRecording:
        """Several recordings of one arm with the same payload as one.

        Raises:
            BadInputError: they are of different joints.
        """
        if len(recordings) == 1:
            return recordings[0]
        problems: Counter[str] = Counter()
        for recording in recordings:
            problems.update(recording.problems)
        streams = JointStreams.join([recording.streams for recording in recordings])
        source = " + ".join(recording.source for recording in recordings)
        return cls(streams, source, dict(problems), recordings[0].epoch_ns)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return self.streams.duration

    def between(self, start: float, stop: float) -> JointRecording:
        """What was measured from start to stop, s from the first sample.

        Raises:
            BadInputError: nothing was recorded then.
        """
        streams = self.streams.between(start, stop)
        if len(streams.time) < 2:
            raise BadInputError(
                f"from {start:g} to {stop:g} s: nothing was recorded then; {self.source} lasts "
                f"from 0 to {self.duration:.1f} s"
            )
        return replace(self, streams=streams, source=f"{self.source} from {start:g} to {stop:g} s")

    def to_bag(self, path: str | Path) -> Path:
        """Write `/joint_states` and `/robot_description` as a rosbag2 recording.

        Raises:
            BadInputError: the path exists already or cannot be written.
        """
        own = self.streams
        stamps = np.rint(own.time * 1e9).astype(np.int64) + self.epoch_ns
        states = encode_states(own.names, stamps, own.position, own.effort)
        store = get_typestore(Stores.ROS2_JAZZY)
        types: Any = store.types
        text = bytes(store.serialize_cdr(types[_STRING](data=own.urdf), _STRING))
        tables = [
            (ROBOT_DESCRIPTION, _STRING, stamps[:1], [text]),
            ("/joint_states", JOINT_STATE, stamps, states),
        ]
        return write_tables(tables, Path(path))

    def problem_lines(self) -> list[str]:
        """Return one line per kind of fault by frequency."""
        return ranked_lines(dict(self.problems))
