"""Waiting for messages and requests without asking each topic over and over."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription

NANOSECONDS = 1_000_000_000


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
        self._size = (0, 0, 0)

    def wait(self, timeout: float) -> bool:
        """Wait for at most `timeout` s; return whether a request or a response has come."""
        subscriptions = self._subscriptions()
        clients, services = list(self._node.clients), list(self._node.services)
        size = (len(subscriptions), len(clients), len(services))
        if size != self._size:
            context = self._node.context.handle
            self._set = rclpy_implementation.WaitSet(size[0], 0, 0, size[1], size[2], 0, context)
            self._size = size
        self._set.clear_entities()
        for subscription in subscriptions:
            self._set.add_subscription(subscription.handle)
        for client in clients:
            self._set.add_client(client.handle)
        for service in services:
            self._set.add_service(service.handle)
        self._set.wait(max(0, int(timeout * NANOSECONDS)))
        ready = self._set.get_ready_entities
        return bool(ready("service") or ready("client"))
