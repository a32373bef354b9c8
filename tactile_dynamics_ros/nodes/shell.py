"""What all nodes share: refusing bad messages, publishing profiles, starting and stopping."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.nodes.conversions import MessageError
from tactile_dynamics_ros.nodes.diagnostics import STEADY_CLOCK, Faults
from tactile_dynamics_ros.nodes.parameters import refuse_unknown

STREAM = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Sensor data: best effort, half a second deep at 100 Hz."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Estimates: reliable, and the last one is kept for those who come later."""


class Shell(Node):
    """A node that counts bad messages instead of failing on them.

    Args:
        name: of the node.

    Attributes:
        faults: counts that appear on /diagnostics.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.faults = Faults(self)

    def listen(
        self,
        kind: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        profile: QoSProfile = STREAM,
    ) -> None:
        """Subscribe; a message that is refused or cannot be used yet is counted and dropped."""

        def guarded(message: Any) -> None:
            try:
                callback(message)
            except MessageError as error:
                self.faults.add(error.kind, str(error))
            except TactileDynamicsError as error:
                kind_of = "bad_input" if isinstance(error, BadInputError) else "not_ready"
                self.faults.add(kind_of, str(error))

        self.create_subscription(kind, topic, guarded, profile)

    def stream(self, kind: type[Any], topic: str) -> Publisher:
        """Return a publisher of sensor data."""
        return self.create_publisher(kind, topic, STREAM)

    def latched(self, kind: type[Any], topic: str) -> Publisher:
        """Return a publisher whose last message is kept for late subscribers."""
        return self.create_publisher(kind, topic, LATCHED)

    def every(self, period: float, callback: Callable[[], None]) -> None:
        """Call back each `period` seconds of wall time."""
        self.create_timer(period, callback, clock=STEADY_CLOCK)

    def serve(self, name: str, action: Callable[[], str]) -> None:
        """Offer a std_srvs/Trigger whose answer is the text that `action` returns."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = action(), True
            except TactileDynamicsError as error:
                response.message, response.success = str(error), False
            return response

        self.create_service(Trigger, name, answer)


def run_node(factory: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """Run one node until Ctrl-C or SIGTERM; return the exit code.

    Args:
        factory: makes the node.
        arguments: command line with ROS arguments, `sys.argv` if None.
    """
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    stop = _StopRequest()
    node: Node | None = None
    try:
        node = factory()
        refuse_unknown(node)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop.requested:
            executor.spin_once(timeout_sec=0.2)
    except ExternalShutdownException:
        pass
    except TactileDynamicsError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return error.exit_code
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


class _StopRequest:
    """Remembers SIGINT and SIGTERM, so that no callback is cut short."""

    def __init__(self) -> None:
        self.requested = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._remember)

    def _remember(self, _: int, __: FrameType | None) -> None:
        self.requested = True
