"""Topics that a node listens to, and the messages that wait on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from rclpy.subscription import Subscription

from tactile_dynamics_ros.ros.inputs import Input, Numbers
from tactile_dynamics_ros.ros.second_participant import SecondParticipant

BURST = 1000
"""Messages of one subscription taken at a time: more than may wait, so that none is left over."""


@dataclass
class Listening:
    """One topic that a node listens to.

    Attributes:
        subscribe: makes a subscription through another participant.
        subscription: that counts now.
        source: what comes on it.
        skim: while the node skims, only so many of those taken together are handed over; 0: all.
        numbers: of the messages, where two publishers at once are left out.
        through: the participant of the subscription, where it is not that of the node.
        spare: one through yet another participant, until either hears something.
    """

    subscribe: Callable[[SecondParticipant], Subscription]
    subscription: Subscription
    source: Input
    skim: int
    numbers: Numbers | None
    through: SecondParticipant | None = None
    spare: tuple[Subscription, SecondParticipant] | None = None

    @property
    def subscriptions(self) -> list[Subscription]:
        """Those that may bring messages."""
        return [self.subscription, *([self.spare[0]] if self.spare else [])]


class Taken(NamedTuple):
    """A message and what the middleware tells of it.

    Attributes:
        message: or its bytes.
        number: that its publisher gave it; None if the middleware does not tell.
        received: when it came, ns.
    """

    message: Any
    number: int | None
    received: int


def take_messages(
    subscription: Subscription,
    refuse: Callable[[str, Exception], None] = lambda *_: None,
) -> list[Taken]:
    """Return the messages that wait, the oldest first.

    Args:
        subscription: to take from.
        refuse: called with the topic of each message that the middleware cannot read.
    """
    taken: list[Taken] = []
    handle = subscription.handle
    with handle:
        for _ in range(BURST):
            try:
                found = handle.take_message(subscription.msg_type, subscription.raw)
            except (RuntimeError, ValueError) as error:
                refuse(subscription.topic_name, error)
                continue
            if found is None:
                break
            message, told = found
            number, received = told["publication_sequence_number"], told["received_timestamp"]
            taken.append(Taken(message, number, received))
    return taken
