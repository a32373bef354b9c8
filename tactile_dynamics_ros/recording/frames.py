"""Frames of poses and forces: the world, the base of a robot, the axes of a sensor."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import topics
from tactile_dynamics_ros.recording.bag_files import BagTables
from tactile_dynamics_ros.recording.cdr import MessageTable
from tactile_dynamics_ros.recording.cleaning import ProblemLog

BASES = re.compile(r"(\w*[_/])?(world|map|odom|ground|base|base_link|base_footprint|\w*link_?0)")
"""Names of frames that stand upright: the world, or the base of an arm on a table. That of an arm
on the wall does not; `diagnose` finds that as the convention `gravity_direction`."""


@dataclass(frozen=True)
class Frames:
    """What the frames of a recording's topics are.

    Attributes:
        world: frame that the poses are in.
        sensors: topics of forces in a sensor's own axes, and the names of these.
        source: of the recording, for messages to the user.
        notes: lines for the user.
    """

    world: str
    sensors: dict[str, str]
    source: str
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, bag: BagTables, world_frame: str | None, source: str) -> Frames:
        """Find the world and the sensors of a recording.

        A wrench with a torque is a sensor's own; a force without belongs to a fingertip, whose
        contact frame is another one than its sensor's, and has to be in the world.

        Args:
            bag: topics under the names that they stand for.
            world_frame: what the user says.
            source: of the recording.
        """
        motion = bag.tables.get(topics.OBJECT_POSE)
        frame = "" if motion is None else usual_frame(motion)
        upright = world_frame is not None or bool(BASES.fullmatch(frame.lstrip("/")))
        world = world_frame or (frame.lstrip("/") if upright and frame else topics.WORLD)
        notes = []
        if world != topics.WORLD and world_frame is None:
            notes.append(f"frame '{world}' taken as the world, z up")
        sensors = {}
        for topic, table in bag.tables.items():
            if topics.topic_kind(topic) == "force" and np.any(table.values[:, 3:]):
                own = usual_frame(table).lstrip("/")
                if bag.types[topic] in (topics.WRENCH, topics.TWIST):
                    sensors[topic] = "sensor"
                    notes.append(f"{topic} states no frame: taken in axes of the contact's pose")
                elif own not in ("", topics.WORLD, world) and not BASES.fullmatch(own):
                    sensors[topic] = own
                    notes.append(f"{topic} is in axes of '{own}': turned by the contact's pose")
        return cls(world, sensors, source, tuple(notes))

    def sensor_of(self, topic: str) -> str | None:
        """Return the frame of a force in a sensor's own axes, or None."""
        return self.sensors.get(topic)

    def place_contacts(self, bag: BagTables) -> None:
        """Put sensors whose pose was not recorded where the object's frame is: one and the same."""
        for topic in self.sensors:
            match = topics.CONTACT_TOPIC.match(topic)
            pose = topics.contact_topic(match["name"], "pose") if match else ""
            if pose and pose not in bag.types and topics.OBJECT_POSE in bag.tables:
                bag.types[pose] = bag.types[topics.OBJECT_POSE]
                bag.tables[pose] = bag.tables[topics.OBJECT_POSE]
                bag.problems[f"{pose} not recorded: taken as that of {topics.OBJECT_POSE}"] += 1

    def in_world(self, topic: str, table: MessageTable, log: ProblemLog) -> MessageTable:
        """Return the messages in the world frame; some in another frame are dropped and counted.

        Raises:
            BadInputError: most messages are in another frame.
        """
        stated = table.frame_id != b""
        names = [name.encode() for name in (self.world, f"/{self.world}")]
        foreign = stated & ~np.isin(table.frame_id, names)
        log.note(topic, "frame_id empty (taken as world)", int(np.count_nonzero(~stated)))
        if 2 * np.count_nonzero(foreign) > len(table):
            frame = table.frame_id[foreign][0].decode("utf-8", "replace")
            raise BadInputError(
                f"{topic} in {self.source}: frame_id '{frame}' in {np.count_nonzero(foreign)} of "
                f"{len(table)} messages; expected '{self.world}' (z up): transform before "
                f"recording, or say --world-frame {frame} if its z points up"
            )
        return topics.rows_of(table, log.drop(topic, "frame_id is not world", foreign))


def usual_frame(table: MessageTable) -> str:
    """Return the frame of most messages of a topic."""
    if not len(table):
        return ""
    names, counts = np.unique(table.frame_id, return_counts=True)
    return bytes(names[np.argmax(counts)]).decode("utf-8", "replace")
