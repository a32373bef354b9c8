"""Topics of pushed objects."""

from __future__ import annotations

import re
from collections.abc import Iterable

from tactile_dynamics_ros.recording import topics

SUPPORT_POSE = "/support/pose"
PUSHER_POSE = "/pusher/pose"
POLYGON_STAMPED = "geometry_msgs/msg/PolygonStamped"
NEEDED = re.compile(
    rf"/object(/link_\d+)?/(pose|footprint)|{SUPPORT_POSE}|{PUSHER_POSE}"
    r"|/contact/[^/]+/(force|force_std|pose)"
)
"""Topics that a recording of a pushed object is made of."""
_MOST_LINKS = 2


def link_topic(index: int, kind: str) -> str:
    """Return the topic of a link's pose or footprint; link_1 is the object itself."""
    return f"/object/{kind}" if index == 0 else f"/object/link_{index + 1}/{kind}"


def link_frame(index: int) -> str:
    """Return the name of a link's frame."""
    return "object" if index == 0 else f"link_{index + 1}"


def links_of(names: Iterable[str]) -> int:
    """Return how many links have poses, counted without gaps."""
    known, count = set(names), 0
    while count < _MOST_LINKS and link_topic(count, "pose") in known:
        count += 1
    return count


def suffice(names: Iterable[str]) -> bool:
    """Whether topics hold the motion of an object, its outline and a contact."""
    known = set(names)
    contact = any(topics.CONTACT_TOPIC.match(name) for name in known)
    return contact and {link_topic(0, "pose"), link_topic(0, "footprint")} <= known


def marks_a_push(names: Iterable[str]) -> bool:
    """Whether topics, in any namespace, are a footprint, a support or a pusher."""
    marks = (link_topic(0, "footprint"), SUPPORT_POSE, PUSHER_POSE)
    return any(name.endswith(marks) for name in names)
