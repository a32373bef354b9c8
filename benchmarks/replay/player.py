"""Plays a recording onto topics, for nodes that run as processes, and hears what they say."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from benchmarks.replay.observations import Observations, read_reports, read_status
from benchmarks.replay.tape import KINDS, NANOSECONDS, OBJECT_POSE, Message, message_kind
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

NODES = ("inertial_estimator", "model_check")
STATUS, RESET = "/inertial_estimator/status", "/inertial_estimator/reset"
DIAGNOSE, MODEL_ERROR = "/model_check/diagnose", "/model_check/error"
DISCOVERY = 30.0
"""Longest wait for nodes to come up and listen, s."""
IN_FLIGHT = 0.8 * STREAM.depth / 100.0
"""Recorded time that may be under way to the nodes, s: four fifths of their queues at 100 Hz."""
FAR = 60.0
"""Stamps further apart are of different clocks, s."""
PATIENCE = 5.0
"""Longest wait for the estimator's next word, s: after a fault it may have none."""
BUNCH = 0.01
"""What is due within this wall time is sent together, s: one sample at 100 Hz in real time."""
FASTEST = 10.0
"""Bunches are of no more than this times 10 ms, however fast the replay is."""
SERVICES = QoSProfile(depth=1000)
"""Deep enough that this side loses no call and no answer of the pipelined ones."""


@dataclass(frozen=True)
class Answer:
    """What a service answered, or why there is no answer."""

    success: bool
    message: str


def executable(node: str, parameters: Mapping[str, object] | None = None) -> list[str]:
    """Return the command of an installed node, as `ros2 run` would start it."""
    arguments = node_command(node, None, parameters)
    installed = Path(sys.executable).with_name(node)
    if not installed.exists():
        return arguments
    return [str(installed), *arguments[arguments.index("--ros-args") :]]


class Player:
    """Processes of nodes in a ROS domain of their own, publishers to them, and their words.

    Use it as a context; leaving it, also by Ctrl-C, stops all processes.

    Args:
        nodes: executables to start.
        parameters: of the nodes, by executable.
        logs: folder for one log per process; their words go to standard error if None.

    Attributes:
        heard: all that the nodes published.
        epoch_ns: added to the stamps of the messages.
        patience: longest wait for the estimator's next word, s.
    """

    def __init__(
        self,
        nodes: Sequence[str] = NODES,
        parameters: Mapping[str, Mapping[str, object]] | None = None,
        logs: Path | None = None,
    ) -> None:
        self.names, self.parameters = tuple(nodes), dict(parameters or {})
        self.heard, self._sent_due, self._next_due, self._speed = Observations(), 0.0, 0.0, 1.0
        self.epoch_ns = time.time_ns() // NANOSECONDS * NANOSECONDS
        self.supervisor = Supervisor(logs, respawn=False)
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._senders: dict[str, Node] = {}
        self._clients: dict[str, Any] = {}
        self.patience = PATIENCE
        self._sent = self._first = self._sent_at = 0.0
        self._last_word = self._last_status = 0.0

    def __enter__(self) -> Player:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("player", enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._senders[""] = self.node
        self._listen(DiagnosticArray, STATUS, self._on_status, LATCHED)
        self._listen(Float64, MODEL_ERROR, self._on_error, LATCHED)
        self._listen(DiagnosticArray, "/diagnostics", self._on_report, QoSProfile(depth=100))
        try:
            self.start(self.names)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.supervisor.stop()
        self._executor.shutdown()
        for node in self._senders.values():
            with suppress(Exception):  # the context may be down already
                node.destroy_node()
        rclpy.try_shutdown()

    def start(self, names: Iterable[str]) -> None:
        """Start nodes and wait until they listen.

        Raises:
            TactileDynamicsError: one ended, or does not listen in time.
        """
        for name in names:
            self.supervisor.start(name, executable(name, self.parameters.get(name)))
        topics = [OBJECT_POSE, *(f"/contact/thumb/{stream}" for stream in KINDS)]
        for topic in topics:
            publisher = self._publisher("", topic)
            self.wait(
                lambda p=publisher: p.get_subscription_count() >= len(self.supervisor.members),
                DISCOVERY,
                f"nodes that listen to {topic}",
            )

    def restart(self, name: str) -> None:
        """Stop a node and start it again."""
        self.supervisor.stop([name])
        self.start([name])

    def restart_dead(self) -> list[str]:
        """Start again the nodes that have ended; return their names."""
        dead = self.dead()
        for name in dead:
            self.supervisor.members.pop(name)
        if dead:
            self.start(dead)
        return dead

    def dead(self) -> list[str]:
        """Return the nodes that have ended."""
        return [name for name, member in self.supervisor.members.items() if not member.running]

    def memory(self) -> dict[str, float]:
        """Return the resident memory of each process and its children, MB."""
        found = {}
        for name, member in self.supervisor.members.items():
            with suppress(psutil.NoSuchProcess):
                process = psutil.Process(member.process.pid)
                family = [process, *process.children(recursive=True)]
                found[name] = sum(p.memory_info().rss for p in family) / 2**20
        return found

    @property
    def position(self) -> float:
        """Time of the replay, s: between those at which the last and the next message are due."""
        passed = self._speed * (time.monotonic() - self._sent_at)
        return max(self._sent_due, min(self._sent_due + passed, self._next_due))

    def play(
        self,
        messages: Iterable[Message],
        speed: float = 1.0,
        tick: Callable[[], None] | None = None,
        begin: float | None = None,
    ) -> None:
        """Send messages when they are due, and hear what comes meanwhile.

        Where the nodes do not keep up, because they or the machine are busy, the replay waits.

        Args:
            messages: in the order in which they are due.
            speed: 1 is real time, 2 twice as fast; infinity as fast as the nodes take it.
            tick: called after each bunch, some ten milliseconds apart; the replay waits for it.
            begin: s, time of the replay that it is now; that of the first message by default.
        """
        behind = None if begin is None else time.monotonic() - begin / speed
        self._last_word = time.monotonic()
        for bunch in _bunches(messages, BUNCH * min(speed, FASTEST)):
            start = bunch[0].due / speed
            behind = time.monotonic() - start if behind is None else behind
            self._next_due, self._speed = bunch[0].due, speed
            self.listen_until(behind + start)
            behind += self._let_catch_up()
            for message in bunch:
                publisher = self._publisher(message.sender, message.topic)
                publisher.publish(message.encoded(self.epoch_ns))
            self._note_sent(bunch)
            if tick is not None:
                began = time.monotonic()
                tick()
                behind += time.monotonic() - began

    def _note_sent(self, bunch: Sequence[Message]) -> None:
        self._sent_due, self._sent_at = bunch[-1].due, time.monotonic()
        poses = [m for m in bunch if m.topic == OBJECT_POSE and not m.absolute and not m.sender]
        if poses:
            self._sent = 1e-9 * (poses[-1].stamp_ns + self.epoch_ns)
            self._first = self._first or self._sent

    def _let_catch_up(self) -> float:
        """Listen until the nodes have taken most of what was sent; return how long it took, s."""
        began = time.monotonic()
        while IN_FLIGHT < self.lag < FAR and time.monotonic() - self._last_word < self.patience:
            self._executor.spin_once(timeout_sec=0.02)
        return time.monotonic() - began

    @property
    def quiet_since(self) -> float:
        """Return how long after the last message was sent the last new word came, s."""
        return max(self._last_status - self._sent_at, 0.0)

    @property
    def lag(self) -> float:
        """How far the newest estimate is behind what was sent, s; none was made at stamp 0."""
        statuses = self.heard.statuses
        newest = statuses[-1].stamp if statuses else 0.0
        return self._sent - (newest or self._first)

    def listen_until(self, moment: float) -> None:
        """Hear what comes until a moment of the monotonic clock; once at least."""
        while True:
            left = moment - time.monotonic()
            self._executor.spin_once(timeout_sec=max(left, 0.0))
            if left <= 0.0:
                return

    def listen_while(self, condition: Callable[[], bool], timeout: float) -> None:
        """Hear what comes as long as a condition holds, for some seconds at most."""
        deadline = time.monotonic() + timeout
        while condition() and time.monotonic() < deadline:
            self._executor.spin_once(timeout_sec=0.02)

    def wait(self, condition: Callable[[], bool], timeout: float, what: str) -> None:
        """Listen until a condition holds.

        Raises:
            TactileDynamicsError: it does not in time, or a process ended meanwhile.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            if self.dead():
                member = self.supervisor.members[self.dead()[0]]
                raise TactileDynamicsError(f"{member.name} ended: {member.last_words()}")
            if time.monotonic() > deadline:
                raise TactileDynamicsError(f"{what}: not within {timeout:.0f} s")
            self._executor.spin_once(timeout_sec=0.02)

    def dismiss(self, sender: str) -> None:
        """Take the publishers of a second sender away."""
        for key in [key for key in self._publishers if key[0] == sender]:
            del self._publishers[key]
        node = self._senders.pop(sender, None)
        if node is not None:
            node.destroy_node()

    def call(self, service: str, count: int = 1, timeout: float = 60.0) -> list[Answer | None]:
        """Call a std_srvs/Trigger that many times without waiting; None for those not answered."""
        futures = [self.request(service) for _ in range(count)]
        self.settle(futures, timeout)
        return [_answer(f.result()) if f.done() else None for f in futures]

    def request(self, service: str) -> Future:
        """Call a std_srvs/Trigger and return the answer to come; for use while playing."""
        if service not in self._clients:
            client = self.node.create_client(Trigger, service, qos_profile=SERVICES)
            self._clients[service] = client
            self.wait(client.service_is_ready, DISCOVERY, f"service {service}")
        return self._clients[service].call_async(Trigger.Request())

    def set_parameter(self, node: str, name: str, value: object) -> Future:
        """Ask a node for another value of a parameter; the answer comes while playing."""
        if node not in self._clients:
            client = AsyncParameterClient(self.node, node, qos_profile=SERVICES)
            self._clients[node] = client
            self.wait(client.services_are_ready, DISCOVERY, f"parameters of {node}")
        return self._clients[node].set_parameters([Parameter(name, value=value)])

    def answer_of(self, future: Future, timeout: float = 20.0) -> SetParametersResult | None:
        """Wait for the answer to `set_parameter`; None if there is none in time."""
        self.settle([future], timeout)
        return future.result().results[0] if future.done() else None

    def settle(self, futures: Sequence[Future], timeout: float) -> None:
        """Listen until all answers are there, time is over or a process ends."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline and not all(f.done() for f in futures):
            if self.dead():
                return
            self._executor.spin_once(timeout_sec=0.02)

    def _publisher(self, sender: str, topic: str) -> Publisher:
        """Return a sender's publisher of a topic, made when it is first asked for."""
        key = sender, topic
        if key not in self._publishers:
            if sender not in self._senders:
                self._senders[sender] = Node(
                    sender, enable_rosout=False, start_parameter_services=False
                )
            node = self._senders[sender]
            self._publishers[key] = node.create_publisher(message_kind(topic), topic, STREAM)
        return self._publishers[key]

    def _listen(
        self, kind: type[Any], topic: str, callback: Callable[[Any], None], profile: QoSProfile
    ) -> None:
        self.node.create_subscription(kind, topic, callback, profile)

    def _on_status(self, message: DiagnosticArray) -> None:
        status = read_status(message, self.position)
        if status.renewed:
            self._last_status = time.monotonic()
        if not self.heard.statuses or status.stamp != self.heard.statuses[-1].stamp:
            self._last_word = time.monotonic()
        self.heard.statuses.append(status)

    def _on_report(self, message: DiagnosticArray) -> None:
        self.heard.reports += read_reports(message, self.position)

    def _on_error(self, message: Float64) -> None:
        self.heard.errors.append((self.position, message.data))


@contextmanager
def replay(
    nodes: Sequence[str] = NODES,
    parameters: Mapping[str, Mapping[str, object]] | None = None,
    logs: Path | None = None,
) -> Iterator[Player]:
    """A player in a ROS domain that no other run on this host uses."""
    with private_domain(), Player(nodes, parameters, logs) as player:
        yield player


def _bunches(messages: Iterable[Message], span: float) -> Iterator[list[Message]]:
    """Yield messages that are due within the same span of the replay, s."""
    bunch: list[Message] = []
    for message in messages:
        if bunch and message.due - bunch[0].due >= span - 1e-9:
            yield bunch
            bunch = []
        bunch.append(message)
    if bunch:
        yield bunch


def _answer(response: Trigger.Response) -> Answer:
    return Answer(bool(response.success), str(response.message))
