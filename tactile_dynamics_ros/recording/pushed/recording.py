"""A recording of one pushed object: from a rosbag2 and back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.joining import join_pushes
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.planar.tip import Stiffness, contact_of_tip, force_by_stiffness
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.core.streams.streams import PoseStream
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.assembly import assemble_contact, assemble_pose
from tactile_dynamics_ros.recording.bag_files import (
    BagTables,
    read_messages,
    read_tables,
    recorded_types,
)
from tactile_dynamics_ros.recording.cdr import MessageTable
from tactile_dynamics_ros.recording.cleaning import ProblemLog, ranked_lines
from tactile_dynamics_ros.recording.frames import Frames
from tactile_dynamics_ros.recording.namespaces import RecordedNames
from tactile_dynamics_ros.recording.pushed import writer as names
from tactile_dynamics_ros.recording.pushed.arrays import Support, anticlockwise, pushes_from_arrays
from tactile_dynamics_ros.recording.pushed.writer import write_pushed
from tactile_dynamics_ros.recording.topics import PoseColumns, WrenchColumns


@dataclass(frozen=True, repr=False)
class PushedRecording:
    """Measurements of one object on a support, cleaned, with what had to be cleaned.

    Attributes:
        streams: poses and footprints of links, contacts; time zero is the object's first pose.
        source: where the recording comes from, for messages to the user.
        problems: one line of text per kind of fault met, and how often it was met.
        epoch_ns: stamp of time zero in nanoseconds.
        file: that it was read from; None if it was made or joined.
        namespace: of its topics there.
    """

    streams: PushedStreams
    source: str
    problems: dict[str, int] = field(default_factory=dict)
    epoch_ns: int = 0
    file: Path | None = None
    namespace: str = ""

    def __repr__(self) -> str:
        """Return source, length and contacts in one line; the arrays are in `streams`."""
        names = ", ".join(self.streams.contacts)
        return f"{type(self).__name__}({self.source}: {self.duration:.1f} s, contacts {names})"

    @classmethod
    def from_bag(
        cls,
        path: str | Path,
        *,
        remap: Mapping[str, str | Sequence[str]] | None = None,
        namespace: str | None = None,
        world_frame: str | None = None,
        stiffness: Stiffness | None = None,
    ) -> PushedRecording:
        """Read a rosbag2 recording; links and contacts are discovered from its topics.

        Args:
            path: the recording's directory, or an .mcap, .db3 or ROS 1 .bag file.
            remap: recorded topic names and the name, or names, that they stand for.
            namespace: of the topics that are read; root if None, or the only one there is.
            world_frame: frame of the poses, z up, if it is not `world` or a robot's base.
            stiffness: of a robot without force sensor, whose `/pusher/target` was recorded too.

        Raises:
            BadInputError: the files cannot be read, pose or footprint of a link is missing, a topic
                is in another frame, several namespaces could be meant, or a stiffness is given
                beside forces, without commands, or for two parts.
            NotIdentifiableError: a stiffness is given, and the tip hardly moves freely.
        """
        recorded = RecordedNames(dict(remap or {}), namespace, names.NEEDED, names.suffice)
        bag, source = read_tables(Path(path), recorded.may_be_needed), str(path)
        chosen = recorded.apply(bag, source)
        if chosen:
            source += f" (namespace {chosen})"
        topics.check_types(bag.types, source)
        frames = Frames.of(bag, world_frame, source)
        outlines = {}
        for k in range(names.links_of(bag.tables)):
            topic = names.link_topic(k, "footprint")
            if bag.types.get(topic) == names.POLYGON_STAMPED:
                corners = _outlines(Path(path), recorded.recorded(topic, chosen))
                outlines |= {k: corners[-1]} if corners else {}
        found = _Assembly(bag, source, frames, outlines, stiffness).recording()
        return replace(found, file=Path(path), namespace=chosen)

    @classmethod
    def from_arrays(
        cls,
        contacts: Mapping[str, Mapping[str, Any]],
        links: Sequence[Mapping[str, Any]],
        *,
        contact_frame: str = "world",
        support: Support | None = None,
        source: str = "arrays",
    ) -> PushedRecording:
        """Take measurements that are already in memory; the first pose becomes time zero.

        Args:
            contacts: per contact as `Recording.from_arrays`, and optionally ``point_std`` m; the
                height of ``position`` above the support is that of the push.
            links: per part ``footprint`` (V, 2) m in its frame, ``time`` (N,) s, ``position``
                (N, 2) or (N, 3) m, ``yaw`` (N,) rad or ``quaternion`` (N, 4) xyzw or ``rotation``
                (N, 3, 3), and optionally ``position_std`` m and ``rotation_std`` rad.
            contact_frame: "world" or "object", of the first part.
            support: its axes; those of the world if None.
            source: name for messages to the user.

        Raises:
            BadInputError: an array is missing, unknown, of the wrong shape or without usable rows.
        """
        place = Support() if support is None else support
        streams, log, start = pushes_from_arrays(contacts, links, contact_frame, place, source)
        return cls(streams, source, dict(log), round(start * 1e9))

    @classmethod
    def join(cls, recordings: Sequence[PushedRecording]) -> PushedRecording:
        """Several recordings of one object on one support as one.

        Raises:
            BadInputError: none is given, or they are not of one object.
        """
        if len(recordings) == 1:
            return recordings[0]
        streams = join_pushes([recording.streams for recording in recordings])
        problems: Counter[str] = Counter()
        for recording in recordings:
            problems.update(recording.problems)
        source = " + ".join(recording.source for recording in recordings)
        return cls(streams, source, dict(problems), recordings[0].epoch_ns)

    def between(self, start: float, stop: float) -> PushedRecording:
        """What was measured from start to stop, in seconds from the first pose.

        Raises:
            BadInputError: nothing was recorded then.
        """
        first = float(self.streams.links[0].time[0])
        streams = self.streams.between(first + start, first + stop)
        if not all(len(link.time) for link in streams.links):
            raise BadInputError(
                f"from {start:g} to {stop:g} s: nothing was recorded then; {self.source} lasts "
                f"from 0 to {self.duration:.1f} s"
            )
        return replace(self, streams=streams, source=f"{self.source} from {start:g} to {stop:g} s")

    @property
    def duration(self) -> float:
        """Seconds from the first to the last pose of the object."""
        time = self.streams.links[0].time
        return float(time[-1] - time[0])

    def to_bag(self, path: str | Path) -> Path:
        """Write a rosbag2 recording that `from_bag` reads.

        Raises:
            BadInputError: the path exists already or cannot be written.
        """
        return write_pushed(self.streams, Path(path), self.epoch_ns)

    def problem_lines(self) -> list[str]:
        """Return one line per kind of fault by frequency."""
        return ranked_lines(self.problems)


def recorded_model(path: str | Path, remap: Mapping[str, str | Sequence[str]] | None = None) -> str:
    """Return "pushed" for a recording with footprint, support or pusher, else "held".

    Args:
        path: of the recording.
        remap: recorded topic names and the name, or names, that they stand for.

    Raises:
        BadInputError: there is no recording at the path.
    """
    found = list(recorded_types(Path(path)))
    for meant in (remap or {}).values():
        found += [meant] if isinstance(meant, str) else meant
    return "pushed" if names.marks_a_push(found) else "held"


def _outlines(path: Path, topic: str) -> list[Array]:
    """Return the corners (V, 2) of each polygon of a topic, m."""
    store = get_typestore(Stores.ROS2_JAZZY)
    found = []
    for _, kind, _, raw in read_messages(path, topic):
        message: Any = store.deserialize_cdr(raw, kind)
        found.append(np.array([[p.x, p.y] for p in message.polygon.points], dtype=np.float64))
    return found


class _Assembly:
    """Builds the streams of one recording from its decoded topics."""

    def __init__(
        self,
        bag: BagTables,
        source: str,
        frames: Frames,
        outlines: Mapping[int, Array],
        stiffness: Stiffness | None = None,
    ) -> None:
        self._stiffness = stiffness
        self._bag, self._source, self._log = bag, source, ProblemLog(bag.problems)
        self._frames, self._outlines = frames, outlines
        self._links = names.links_of(bag.tables)
        if not self._links:
            raise BadInputError(
                f"{source}: {topics.OBJECT_POSE} is missing; record the object's pose"
            )
        for line in frames.notes:
            self._log[line] += 1
        self._clock = topics.Clock.starting_at(bag.tables[topics.OBJECT_POSE])
        self._support = Support()
        table = self._world(names.SUPPORT_POSE)
        if table is not None:
            turn = quaternion_to_matrix(table.values[-1:, 3:7])[0]
            self._support = Support(table.values[-1, :3], turn)

    def _world(self, topic: str) -> MessageTable | None:
        """Return a topic's messages in the world frame, or None if there are none."""
        table = self._bag.tables.get(topic)
        if table is None or not len(table):
            return None
        return self._frames.in_world(topic, table, self._log)

    def recording(self) -> PushedRecording:
        """Return the recording with everything on the support."""
        links = tuple(self._link(k) for k in range(self._links))
        contacts, pusher = self._contacts(), self._followed(names.PUSHER_POSE)
        time, yaw, doubts = None, None, (0.0, 0.0)
        if pusher is not None:
            time, turn = pusher.time, self._support.R_WS.T @ pusher.rotation
            yaw = np.arctan2(turn[:, 1, 0], turn[:, 0, 0])
            if not contacts:
                place = (pusher.position - self._support.place) @ self._support.R_WS
                contacts = {"pusher": contact_of_tip(links[0], time, place)}
                if self._stiffness is not None and len(links) == 1:
                    target = self._target(time)
                    pushed, *doubts = force_by_stiffness(
                        links[0], contacts["pusher"], place, target, self._stiffness
                    )
                    contacts = {"pusher": pushed}
        if self._stiffness is not None and not doubts[0]:
            raise BadInputError(
                f"{self._source}: a stiffness is for one part, {names.PUSHER_POSE} without contacts"
            )
        streams = PushedStreams(
            links,
            contacts,
            self._support.gravity,
            pusher_time=time,
            pusher_yaw=yaw,
            force_doubt=doubts[0],
            mass_doubt=doubts[1],
        )
        return PushedRecording(streams, self._source, dict(self._log), self._clock.epoch_ns)

    def _followed(self, topic: str) -> PoseStream | None:
        """Return the poses of the pusher or of its commands, or nothing."""
        table = self._world(topic)
        if table is None:
            return None
        columns = topics.pose_columns(topic, table, self._clock)
        return assemble_pose(columns, self._log, planar=True)

    def _target(self, time: Array) -> Array:
        """Return the commanded places (K, 3) of the pusher at times, m, on the support."""
        commanded = self._followed(names.PUSHER_TARGET)
        if commanded is None:
            raise BadInputError(
                f"{self._source}: {names.PUSHER_TARGET} is missing; a stiffness needs the "
                "commanded pose of the tip"
            )
        place = (commanded.position - self._support.place) @ self._support.R_WS
        return np.stack([np.interp(time, commanded.time, part) for part in place.T], axis=1)

    def _link(self, k: int) -> LinkStream:
        topic = names.link_topic(k, "pose")
        table = self._frames.in_world(topic, self._bag.tables[topic], self._log)
        pose = assemble_pose(topics.pose_columns(topic, table, self._clock), self._log, planar=True)
        return self._support.link(pose, self._footprint(k))

    def _footprint(self, k: int) -> Array:
        """Return the corners of the last footprint, anticlockwise."""
        topic = names.link_topic(k, "footprint")
        if k not in self._outlines:
            raise BadInputError(
                f"{self._source}: {topic} is missing; expected a {names.POLYGON_STAMPED} with the "
                "outline on the support (`tactile-dynamics shape` finds it from point clouds)"
            )
        return anticlockwise(self._outlines[k], f"{self._source}: {topic}")

    def _contacts(self) -> dict[str, PushContact]:
        found = {}
        for topic in self._bag.tables:
            match = topics.CONTACT_TOPIC.match(topic)
            where = self._world(topic) if match and match["kind"] == "pose" else None
            if match and where is not None:
                contact = self._contact(match["name"], where)
                if contact is not None:
                    found[match["name"]] = contact
        return dict(sorted(found.items()))

    def _contact(self, name: str, where: MessageTable) -> PushContact | None:
        force, pose, std = (topics.contact_topic(name, k) for k in ("force", "pose", "force_std"))
        placed = topics.pose_columns(pose, where, self._clock)
        variance = where.values[:, 7:].reshape(len(where), -1)[:, :1]
        point_std = float(np.sqrt(np.median(variance))) if variance.any() else None
        measured = self._wrench(force, placed)
        if measured is None:
            return self._support.path(
                name, assemble_pose(placed, self._log, planar=True), point_std
            )
        stated = self._bag.tables.get(std)
        stream = assemble_contact(
            name,
            measured,
            placed,
            None if stated is None else topics.std_columns(std, stated, self._clock),
            self._log,
        )
        return None if stream is None else self._support.contact(stream, point_std)

    def _wrench(self, topic: str, placed: PoseColumns) -> WrenchColumns | None:
        """Return forces in axes of the world, or None if there are none."""
        if self._frames.sensor_of(topic):
            wrench = topics.wrench_columns(topic, self._bag.tables[topic], self._clock)
            return wrench.in_world_axes(placed)
        table = self._world(topic)
        return None if table is None else topics.wrench_columns(topic, table, self._clock)
