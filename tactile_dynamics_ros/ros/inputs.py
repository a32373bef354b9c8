"""What comes on the topics of a node, and why nothing does.

One mechanism for all nodes: a topic that was never heard, that somebody publishes with another
type, on which two publish at once, or whose messages are all refused is a trouble with a name.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription

from tactile_dynamics_ros.ros.object_state import SILENT

RIVAL_STEPS, RIVAL_SPAN = 2, 1.0
"""How often in how long (s) the numbers that a publisher gives its messages must go back until two
publish at once: those of two mix with every message, those of a restarted one go back once."""


ASKED = 1.0
"""Real time between questions to the middleware who publishes a silent topic, s: a question takes a
tenth of a millisecond, and a publisher that appears is named a second later at most."""
PATIENCE = 5.0
"""Silence of a topic that somebody publishes and the node needs, s, after which it is subscribed to
anew (`second_participant`); each time it did not help twice as long. Shorter subscribes anew while
a publisher is only about to begin, longer leaves a node deaf for longer."""


class Source(NamedTuple):
    """A publisher.

    Attributes:
        name: of the node, with its namespace. kind: type of the messages.
        misfit: why its quality of service does not do; empty if it does.
    """

    name: str
    kind: str
    misfit: str


class Need(Enum):
    """When the silence of a topic is a trouble."""

    OPTIONAL = "never"
    ONCE = "before the first message: later silence means that there is nothing to tell"
    ALWAYS = "always"


class Numbers:
    """Numbers that publishers give their messages on one topic."""

    def __init__(self) -> None:
        self._last = 0
        self._back: deque[float] = deque(maxlen=RIVAL_STEPS)

    def mix(self, numbers: Sequence[int | None], now: float) -> bool:
        """Whether these numbers are of two publishers; never where the middleware gives none.

        Args:
            numbers: in the order of the messages.
            now: monotonic, s.
        """
        for number in numbers:
            if number is None:
                return False
            if number <= self._last:
                self._back.append(now)
            self._last = number
        return len(self._back) == RIVAL_STEPS and now - self._back[0] < RIVAL_SPAN


@dataclass
class Input:
    """One topic that a node listens to. All times are monotonic, s.

    Attributes:
        topic: as it was given to `Shell.listen`. kind: name of its type.
        need: when its silence is a trouble.
        heard: when a message was last used; the beginning before the first.
        ever: whether one was used.
        refused: when a message was last refused. reason: why.
        rivals: until when it is said that two publish at once.
        asked: when it was last asked who publishes.
        publishers: who publishes it, as of then.
        renewed: when it was last subscribed to anew. patience: s until it is again.
    """

    topic: str
    full: str
    kind: str
    need: Need
    profile: QoSProfile
    heard: float
    ever: bool = False
    refused: float = -math.inf
    reason: str = ""
    rivals: float = -math.inf
    asked: float = -math.inf
    publishers: Sequence[Source] = ()
    renewed: float = -math.inf
    patience: float = PATIENCE

    def take(self, now: float) -> None:
        """Note that a message was used."""
        self.heard, self.ever, self.patience = now, True, PATIENCE

    def refuse(self, reason: str, now: float) -> None:
        """Note that a message was refused."""
        self.refused, self.reason = now, reason

    def is_deaf(self, now: float) -> bool:
        """Whether nothing comes, not even to be refused, though somebody publishes it."""
        awaited = self.need is Need.ALWAYS or (self.need is Need.ONCE and not self.ever)
        return (
            awaited
            and any(one.kind == self.kind and not one.misfit for one in self.publishers)
            and now - max(self.heard, self.refused, self.renewed) > self.patience
        )

    def renew(self, now: float) -> None:
        """Note that it is subscribed to anew."""
        self.renewed, self.patience = now, 2.0 * self.patience

    def suspicious(self, now: float) -> bool:
        """Whether it is worth asking who publishes."""
        return now < self.rivals or now - self.heard > SILENT

    def trouble(self, now: float) -> str:
        """Return what is wrong with the topic, "" if nothing is."""
        names = " and ".join(one.name for one in self.publishers) or "nobody"
        if now < self.rivals:
            return (
                f"{self.topic}: two publishers at once ({names}), nobody can know which is right: "
                "stop one of them"
            )
        if now - self.heard <= SILENT:
            return ""
        if now - self.refused <= SILENT:
            return f"{self.topic}: all that comes is refused: {self.reason}"
        others = [f"{s.kind} from {s.name}" for s in self.publishers if s.kind != self.kind]
        if others and len(others) == len(self.publishers):
            return f"{self.topic}: expected {self.kind}, found {', '.join(others)}"
        misfits = [one.misfit for one in self.publishers if one.misfit]
        if misfits and len(misfits) == len(self.publishers):
            return (
                f"{self.topic}: {names} offers less than is asked for ({misfits[0]}); ask for less "
                f"with the parameters qos_overrides.{self.full}.subscription.*"
            )
        if self.need is not Need.OPTIONAL and not self.ever:
            return f"{self.topic}: never heard, published by {names}"
        if self.need is Need.ALWAYS:
            return f"{self.topic}: silent since {now - self.heard:.0f} s, published by {names}"
        return ""


class Inputs:
    """The topics of a node.

    Args:
        node: that listens.

    Attributes:
        troubles: what is wrong with them, as of the last look.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._found: dict[str, Input] = {}
        self.troubles: tuple[str, ...] = ()

    def add(self, subscription: Subscription, topic: str, need: Need) -> Input:
        """Follow a topic that a subscription hears; silent from now on.

        Args:
            subscription: of its whole name.
            topic: as it was given.
            need: when its silence is a trouble.
        """
        kind, full = subscription.msg_type, subscription.topic_name
        package, name = kind.__module__.split(".")[0], kind.__name__
        profile, now = subscription.qos_profile, time.monotonic()
        found = Input(topic, full, f"{package}/msg/{name}", need, profile, now)
        self._found[full] = found
        return found

    def wait_anew(self) -> None:
        """Count silence from now on: the node begins to work."""
        self.troubles = ()
        for found in self._found.values():
            found.heard = time.monotonic()

    def has_rivals(self, topic: str) -> bool:
        """Whether two publish on a topic (as it was given to `Shell.listen`) at once."""
        now = time.monotonic()
        return any(now < found.rivals for found in self._found.values() if found.topic == topic)

    def look(self) -> bool:
        """Look for troubles; return whether they are of other topics than at the last look."""
        now, before = time.monotonic(), self.troubles
        suspicious = {full: one for full, one in self._found.items() if one.suspicious(now)}
        for one in suspicious.values():
            if now - one.asked >= ASKED:
                one.asked, one.publishers = now, self._publishers(one)
        self.troubles = tuple(filter(None, (one.trouble(now) for one in suspicious.values())))
        return [_topic(text) for text in before] != [_topic(text) for text in self.troubles]

    def _publishers(self, heard: Input) -> list[Source]:
        found = []
        for info in self._node.get_publishers_info_by_topic(heard.full):
            fits, reason = qos_check_compatible(info.qos_profile, heard.profile)
            name = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            misfit = reason.strip() if fits == QoSCompatibility.ERROR else ""
            found.append(Source(name, info.topic_type, misfit))
        return sorted(found)


def _topic(trouble: str) -> str:
    return trouble.partition(":")[0]
