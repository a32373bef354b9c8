"""Topics that a node listens to: messages that wait, services, a second participant.

Now and then Fast DDS does not tell a publisher that runs of the readers of a node that was killed
and started again; the reader lists the publisher, and never hears it, however often it subscribes
anew. Another participant of the same process does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Thread
from typing import Any, NamedTuple

import rclpy
from rclpy.action import ActionServer
from rclpy.callback_groups import CallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from tactile_dynamics_ros.recording.cdr import NANOSECONDS
from tactile_dynamics_ros.ros.inputs import Input, Numbers


class Waiter:
    """Sleeps until a node has something to do.

    The wait set is kept between waits, since building one is what makes an executor expensive
    where hundreds of small messages come per second.

    Args:
        node: whose services and clients are waited for.
        subscriptions: returns those that are waited for now.
    """

    def __init__(self, node: Node, subscriptions: Callable[[], list[Subscription]]) -> None:
        self._node, self._subscriptions = node, subscriptions
        self._size = (0, 0, 0, 0)

    def wait(self, timeout: float) -> bool:
        """Wait for at most `timeout` s; return whether a request or a response has come."""
        subscriptions = self._subscriptions()
        clients, services = list(self._node.clients), list(self._node.services)
        actions = [one for one in self._node.waitables if isinstance(one, ActionServer)]
        size = (len(subscriptions), len(clients), len(services), len(actions))
        if size != self._size:
            self._set = self._wait_set(size)
            self._size = size
        self._set.clear_entities()
        for action in actions:  # first: the executor reads their places in its own, larger set
            action.add_to_wait_set(self._set)
        for subscription in subscriptions:
            self._set.add_subscription(subscription.handle)
        for client in clients:
            self._set.add_client(client.handle)
        for service in services:
            self._set.add_service(service.handle)
        self._set.wait(max(0, int(timeout * NANOSECONDS)))
        ready = self._set.get_ready_entities
        return bool(ready("service") or ready("client"))

    def _wait_set(self, size: tuple[int, int, int, int]) -> Any:
        """Return a wait set for so many subscriptions, clients, services and actions.

        An action has three services (goal, cancel, result) and a timer that forgets old results.
        """
        subscriptions, clients, services, actions = size
        return rclpy_implementation.WaitSet(
            subscriptions,
            0,
            actions,
            clients,
            services + 3 * actions,
            0,
            self._node.context.handle,
        )


class SecondParticipant:
    """A hidden node with a context, and so a participant, of its own.

    Raises:
        RuntimeError: the middleware refuses it, such as one that asks for an enclave.
    """

    def __init__(self, node: Node) -> None:
        """Begin beside `node`."""
        self._context = rclpy.Context()
        handlers = SignalHandlerOptions.NO
        rclpy.init(args=[], context=self._context, signal_handler_options=handlers)
        self._node = rclpy.create_node(
            f"_{node.get_name()}_again",
            context=self._context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )

    def subscribe(
        self,
        kind: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        profile: QoSProfile,
        raw: bool,
    ) -> Subscription:
        """Subscribe to a topic by its whole name."""
        return self._node.create_subscription(kind, topic, callback, profile, raw=raw)

    def close(self) -> Thread:
        """Leave DDS, in the background: it may take long, and now and then does not end."""
        leaving = Thread(target=self._leave, daemon=True)
        leaving.start()
        return leaving

    def _leave(self) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()


class Polled(CallbackGroup):
    """Callback group that no executor serves, because the node takes both itself."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


REQUESTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Services: requests that may wait; a script sends hundreds at once, of which `ANSWER_BURST` are
answered every `ANSWER_SPAN`."""

ANSWER_BURST, ANSWER_SPAN = 8, 0.05
"""Answers of one service within so many seconds: a client of rclpy keeps ten that it has not read,
and loses older ones without a word. 160 answers/s, and it may be held up for 50 ms."""


@dataclass
class Served:
    """A service whose requests the node takes itself, and when it gave its last answers, s."""

    service: Service
    given: deque[float] = field(default_factory=lambda: deque(maxlen=ANSWER_BURST))

    def answer(self, now: float) -> None:
        """Answer requests that wait, at most `ANSWER_BURST` within `ANSWER_SPAN`.

        Args:
            now: monotonic, s.
        """
        kind, handle = self.service.srv_type, self.service.handle
        while len(self.given) < ANSWER_BURST or now - self.given[0] > ANSWER_SPAN:
            with handle:
                request, header = handle.service_take_request(kind.Request)
            if header is None:
                return
            self.service.send_response(self.service.callback(request, kind.Response()), header)
            self.given.append(now)


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
        always: whether messages are handed over while the node is not active, too.
        waits: whether they wait for an active node, as what a latched topic says is said once.
        through: the participant of the subscription, where it is not that of the node.
        spare: one through yet another participant, until either hears something.
    """

    subscribe: Callable[[SecondParticipant], Subscription]
    subscription: Subscription
    source: Input
    skim: int
    numbers: Numbers | None
    always: bool = False
    waits: bool = False
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


def overrides_of(topic: str, listening: Sequence[Listening]) -> QoSOverridingOptions:
    """Return the parameters of a subscription's quality of service.

    A topic may be heard twice, such as a stop that is published latched or not: each has its own.

    Args:
        topic: as it is given to `Shell.listen`.
        listening: what is listened to already.
    """
    heard = sum(one.source.topic == topic for one in listening)
    return QoSOverridingOptions.with_default_policies(entity_id=str(heard + 1) if heard else None)
