"""A recording of one held object: from a rosbag2, from arrays, and back to a rosbag2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.streams.joining import cut_streams, join_streams
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.core.tracking.hand_error import carry_contacts
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.arrays import start_at_zero, streams_from_arrays
from tactile_dynamics_ros.recording.assembly import assemble_contact, assemble_imu, assemble_pose
from tactile_dynamics_ros.recording.bag_files import BagTables, read_tables
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.recording.cdr import empty_table
from tactile_dynamics_ros.recording.cleaning import ProblemLog, doubtful_conventions, ranked_lines
from tactile_dynamics_ros.recording.frames import Frames
from tactile_dynamics_ros.recording.namespaces import RecordedNames
from tactile_dynamics_ros.recording.static_poses import held_poses


@dataclass(frozen=True, repr=False)
class Recording:
    """Measurements of one held object, cleaned, with what had to be cleaned.

    Attributes:
        streams: poses, contacts and IMU; time zero is the first pose (or IMU sample).
        source: where the recording comes from, for messages to the user.
        problems: one line of text per kind of fault met, and how often it was met.
        epoch_ns: stamp of time zero in nanoseconds.
    """

    streams: Streams
    source: str
    problems: dict[str, int] = field(default_factory=dict)
    epoch_ns: int = 0

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
        contacts_required: bool = True,
        any_unit: bool = False,
        stamps: str = "header",
    ) -> Recording:
        """Read a rosbag2 recording; contacts are discovered from its topics.

        Args:
            path: the recording's directory, or an .mcap, .db3 or ROS 1 .bag file.
            remap: recorded topic names and the name, or names, that they stand for.
            namespace: namespace of the hand whose topics are read; root if None, or, where nothing
                was recorded at root, the only one there is.
            world_frame: frame of the poses, z up, if it is not `world` or a robot's base.
            contacts_required: whether a recording without any contact is refused.
            any_unit: whether accelerations that look like units of g are taken as they are.
            stamps: "header", or "receive" for the times at which messages were received.

        Raises:
            BadInputError: the files cannot be read, a topic is missing or of another type or
                frame, several namespaces could be meant, or nothing usable remains of a topic; the
                message says what to do.
        """
        names, source = RecordedNames(dict(remap or {}), namespace), str(path)
        bag = read_tables(Path(path), names.may_be_needed)
        if stamps == topics.RECEIVE:
            bag.tables = {topic: table.as_received() for topic, table in bag.tables.items()}
        chosen = names.apply(bag, source)
        if chosen:
            source += f" (namespace {chosen})"
        topics.check_types(bag.types, source)
        frames = Frames.of(bag, world_frame, source)
        frames.place_contacts(bag)
        topics.require_topics(bag.types, source, contacts_required)
        return _BagAssembly(bag, Path(path), source, frames, any_unit).recording()

    @classmethod
    def from_arrays(
        cls,
        contacts: Mapping[str, Mapping[str, Any]],
        pose: Mapping[str, Any] | None = None,
        imu: Mapping[str, Any] | None = None,
        *,
        contact_frame: str = "world",
        source: str = "arrays",
    ) -> Recording:
        """Take measurements that are already in memory; their first motion becomes time zero.

        Args:
            contacts: per contact ``time`` (N,) s, ``force`` (N, 3) N on the object, ``position``
                (3,) or (M, 3) m, and optionally ``torque`` (N, 3) N m about the contact point,
                ``force_std`` N, ``pose_time`` (M,), and the contact frame as ``normal`` (into the
                object), ``quaternion`` xyzw or ``rotation``.
            pose: ``time`` (N,) s, ``position`` (N, 3) m, ``quaternion`` (N, 4) xyzw or
                ``rotation`` (N, 3, 3), and optionally ``position_std`` m, ``rotation_std`` rad or
                ``covariance`` (N, 6, 6) [rotation, position].
            imu: ``time`` (N,) s, ``specific_force`` (N, 3) m/s^2, and optionally
                ``quaternion`` or ``rotation``, ``angular_velocity`` rad/s and
                ``specific_force_std`` m/s^2; body axes.
            contact_frame: "world" or "object": the axes of forces, torques and contact poses.
            source: name for messages to the user.

        Raises:
            BadInputError: an array is missing, unknown, of the wrong shape or without usable rows.
        """
        streams, log = streams_from_arrays(contacts, pose, imu, contact_frame, source)
        _require_overlap(streams, source)
        streams, start = start_at_zero(streams)
        return cls(streams, source, dict(log), round(start * 1e9))

    @classmethod
    def from_static_poses(
        cls,
        force: Any,
        torque: Any = None,
        *,
        rotation: Any = None,
        quaternion: Any = None,
        force_std: float | None = None,
        torque_std: float | None = None,
        contact: str = "wrist",
        contact_frame: str = "object",
        source: str = "static poses",
    ) -> Recording:
        """Take wrenches of a load at rest, one row per orientation; there is no time in them.

        F = -m g_S + b_F, T = c x (-m g_S) + b_T with gravity g_S in sensor axes: mass and centre of
        mass show, and with the effect `force_bias` the bias; the inertia does not.

        Args:
            force: (N, 3) N that the sensor applies **on the load**, N >= 3.
            torque: (N, 3) N m likewise, about the sensor's origin.
            rotation: (N, 3, 3) sensor to world, z up.
            quaternion: (N, 4) xyzw of any length, instead of rotation.
            force_std: N of one reading; read from how well the rows agree if None, up to what
                sensors have.
            torque_std: N m likewise.
            contact: name of the sensor.
            contact_frame: "object" or "world": the axes of forces and torques.
            source: name for messages to the user.

        Raises:
            BadInputError: a shape is wrong, or fewer than three usable rows. Rows that are not
                finite, have no rotation or contradict the others are left out, with a line.
        """
        held, pose, lost = held_poses(
            force,
            torque,
            rotation=rotation,
            quaternion=quaternion,
            force_std=force_std,
            torque_std=torque_std,
            contact_frame=contact_frame,
        )
        recording = cls.from_arrays({contact: held}, pose, contact_frame="object", source=source)
        problems = {text: n for text, n in recording.problems.items() if "gap in" not in text}
        return replace(recording, problems=problems | lost)

    @classmethod
    def join(cls, recordings: Sequence[Recording]) -> Recording:
        """Several recordings of one object as one: body and effects are shared, biases are not.

        Args:
            recordings: in the same body and world frames; the first one's clock counts.

        Raises:
            BadInputError: none is given, or they were not recorded alike.
        """
        if len(recordings) == 1:
            return recordings[0]
        streams = join_streams([recording.streams for recording in recordings])
        problems: dict[str, int] = {}
        for text, count in (item for r in recordings for item in r.problems.items()):
            problems[text] = problems.get(text, 0) + count
        source = " + ".join(recording.source for recording in recordings)
        return cls(streams, source, problems, recordings[0].epoch_ns)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last motion sample."""
        motion = self.streams.pose or self.streams.imu
        return float(motion.time[-1] - motion.time[0]) if motion else 0.0

    def between(self, start: float, stop: float) -> Recording:
        """Return the part of the recording with start <= time < stop, in seconds."""
        streams = cut_streams(self.streams, start, stop)
        source = f"{self.source} from {start:g} to {stop:g} s"
        return Recording(streams, source, self.problems, self.epoch_ns)

    def to_bag(self, path: str | Path) -> Path:
        """Write a rosbag2 recording to the contract that `from_bag` reads.

        Args:
            path: a new directory, or a new file that ends in .mcap.

        Returns:
            The path written.

        Raises:
            BadInputError: the path exists already or cannot be written.
        """
        return write_bag(self.streams, Path(path), self.epoch_ns)

    def problem_lines(self) -> list[str]:
        """Return one line per doubt about conventions, then per kind of fault by frequency."""
        return doubtful_conventions(self.streams) + ranked_lines(self.problems)


class _BagAssembly:
    """Builds the streams of one recording from its decoded topics."""

    def __init__(
        self, bag: BagTables, path: Path, source: str, frames: Frames, any_unit: bool = False
    ) -> None:
        self._bag, self._path, self._any_unit = bag, path, any_unit
        self._frames = frames
        self._source = source
        self._log = ProblemLog(bag.problems)
        motion = topics.OBJECT_POSE if topics.OBJECT_POSE in bag.tables else topics.OBJECT_IMU
        self._clock = topics.Clock.starting_at(bag.tables.get(motion, empty_table(7)))

    def recording(self) -> Recording:
        """Return the recording with all streams that are in the bag."""
        for topic, table in self._bag.tables.items():
            topics.check_messages(topic, table, self._log)
        for line in self._frames.notes:
            self._log[line] += 1
        self._note_poses_without_forces()
        streams = Streams(self._pose(), self._contacts(), self._imu())
        hand = self._hand_pose()
        if hand is not None:
            streams = carry_contacts(streams, hand)
        if streams.pose is None and streams.imu is None:
            raise BadInputError(
                f"{self._source}: neither {topics.OBJECT_POSE} nor {topics.OBJECT_IMU} holds a "
                "usable sample; record the object's motion"
            )
        _require_overlap(streams, self._source, self._receive_advice())
        return Recording(streams, self._source, dict(self._log), self._clock.epoch_ns)

    def _receive_advice(self) -> str:
        """Return what to do if stamps are of several clocks: receive times, if they overlap."""
        received = [t.receive_ns for t in self._bag.tables.values() if len(t)]
        overlap = max(r.min() for r in received) < min(r.max() for r in received)
        return " or say --stamps receive, for those times overlap" if overlap else ""

    def _pose(self) -> PoseStream | None:
        """Return the object's poses, or None if only an IMU was recorded."""
        known = topics.OBJECT_POSE in self._bag.tables
        return self._pose_of(topics.OBJECT_POSE) if known else None

    def _hand_pose(self) -> PoseStream | None:
        """Return the poses by the hand alone, or None if there are none that can be used."""
        accepted = topics.EXPECTED_TYPES["object_pose"]
        known = topics.HAND_POSE in self._bag.tables
        if not known or self._bag.types[topics.HAND_POSE] not in accepted:
            return None
        try:
            return self._pose_of(topics.HAND_POSE)
        except BadInputError:
            self._log.note(topics.HAND_POSE, "no usable poses (contacts left as they are)", 1)
            return None

    def _pose_of(self, topic: str) -> PoseStream:
        table = self._frames.in_world(topic, self._bag.tables[topic], self._log)
        return assemble_pose(topics.pose_columns(topic, table, self._clock), self._log)

    def _contacts(self) -> dict[str, ContactStream]:
        """Return the contacts that ever touch."""
        found = {n: self._contact(n) for n in topics.discover_contacts(self._bag.types)}
        return {name: stream for name, stream in found.items() if stream is not None}

    def _contact(self, name: str) -> ContactStream | None:
        """Return one contact, or None if it never touches."""
        force, pose, std = (topics.contact_topic(name, k) for k in ("force", "pose", "force_std"))
        std_table = self._bag.tables.get(std)
        where = topics.pose_columns(pose, self._world_table(pose, 7), self._clock)
        own = self._frames.sensor_of(force)
        read = self._bag.tables.get(force, empty_table(6)) if own else self._world_table(force, 6)
        wrench = topics.wrench_columns(force, read, self._clock)
        if own:
            from tactile_dynamics_ros.recording.mounting import pose_of_sensor

            where = pose_of_sensor(self._path, own, where, wrench, self._log)
        return assemble_contact(
            name,
            wrench,
            where,
            None if std_table is None else topics.std_columns(std, std_table, self._clock),
            self._log,
            sensor_axes=own is not None,
        )

    def _world_table(self, topic: str, doubles: int) -> Any:
        """Return a topic's messages in the world frame; none if it is empty."""
        table = self._bag.tables.get(topic, empty_table(doubles))
        return self._frames.in_world(topic, table, self._log) if len(table) else table

    def _imu(self) -> Any:
        """Return the IMU, or None if there is none."""
        table = self._bag.tables.get(topics.OBJECT_IMU)
        columns = topics.imu_columns(topics.OBJECT_IMU, table, self._clock) if table else None
        return None if columns is None else assemble_imu(columns, self._log, self._any_unit)

    def _note_poses_without_forces(self) -> None:
        """Count contact poses that have no force beside them."""
        names = topics.discover_contacts(self._bag.types)
        for topic in self._bag.types:
            match = topics.CONTACT_TOPIC.match(topic)
            if match and match["name"] not in names:
                self._log.note(topic, "no force topic beside it (left out)", 1)


def _require_overlap(streams: Streams, source: str, advice: str = "") -> None:
    """Check that every contact was recorded while the motion was.

    Args:
        streams: measurements.
        source: of them, for messages to the user.
        advice: what else can be done.

    Raises:
        BadInputError: the stamps lie apart, as from clocks that were never synchronised.
    """
    motion = streams.pose or streams.imu
    if motion is None:
        return
    for name, contact in streams.contacts.items():
        if contact.time[-1] < motion.time[0] or contact.time[0] > motion.time[-1]:
            apart = float(
                np.max([motion.time[0] - contact.time[-1], contact.time[0] - motion.time[-1]])
            )
            raise BadInputError(
                f"{source}: the stamps of contact {name} and of the object's motion lie "
                f"{apart:.1f} s apart and never overlap; stamp both with the same clock{advice}"
            )
