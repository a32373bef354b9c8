"""Topics of pushed objects."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tactile_dynamics_ros.recording import topics

SUPPORT_POSE = "/support/pose"
PUSHER_POSE = "/pusher/pose"
POLYGON_STAMPED = "geometry_msgs/msg/PolygonStamped"
_LINK = re.compile(r"^/object(?:/(?P<link>link_\d+))?/(?P<kind>pose|footprint)$")
_MOST_LINKS = 2


def link_topic(index: int, kind: str) -> str:
    """Return the topic of a link's pose or footprint; link_1 is the object itself."""
    return f"/object/{kind}" if index == 0 else f"/object/link_{index + 1}/{kind}"


def link_frame(index: int) -> str:
    """Return the name of a link's frame."""
    return "object" if index == 0 else f"link_{index + 1}"


def is_needed(topic: str) -> bool:
    """Whether a topic belongs to a recording of a pushed object."""
    contact = topics.CONTACT_TOPIC.match(topic)
    return bool(contact or _LINK.match(topic)) or topic in (SUPPORT_POSE, PUSHER_POSE)


def links_of(names: Iterable[str]) -> int:
    """Return how many links have poses, counted without gaps."""
    known, count = set(names), 0
    while count < _MOST_LINKS and link_topic(count, "pose") in known:
        count += 1
    return count


def marks_a_push(names: Iterable[str]) -> bool:
    """Whether topics are those of an object on a support: footprint, support or pusher."""
    marks = {link_topic(0, "footprint"), SUPPORT_POSE, PUSHER_POSE}
    return not marks.isdisjoint(names)
