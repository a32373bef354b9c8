"""Listening once more through another DDS participant, where the first one is not heard of.

Now and then Fast DDS does not tell a publisher that runs of the readers of a node that was killed
and started again; the reader lists the publisher, and never hears it, however often it subscribes
anew. Another participant of the same process does.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription


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
