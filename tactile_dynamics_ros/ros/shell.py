"""What all nodes share: refusing bad messages, publishing profiles, starting and stopping."""

from __future__ import annotations

import math
import struct
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.ros.background import abandon_all
from tactile_dynamics_ros.ros.diagnostics import Faults
from tactile_dynamics_ros.ros.inputs import RIVAL_SPAN, Inputs, Need, Numbers
from tactile_dynamics_ros.ros.listening import (
    REQUESTS,
    Listening,
    Polled,
    SecondParticipant,
    Served,
    Taken,
    Waiter,
    overrides_of,
    take_messages,
)
from tactile_dynamics_ros.ros.managed import ManagedNode
from tactile_dynamics_ros.ros.parameters import refuse_unknown
from tactile_dynamics_ros.ros.startup import finish_bursts, introduce, start_ros
from tactile_dynamics_ros.ros.wire import decoder_of
from tactile_dynamics_ros.stopping import TIME_TO_END, Stopped, StopRequest

STREAM = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Sensor data: best effort, five seconds deep at 100 Hz, since links deliver in batches too."""

SERVICE_PERIOD = 0.3
"""Real time after which the executor is asked even if no request has come, s."""
LONGEST_CALLBACK = 1.0
"""Real time from a request to stop until a callback that still runs is left, s: callbacks take
milliseconds, a plan of pushes more; 1.5 s remain to write files and to end."""
CALLBACKS = 5
"""Callbacks of the executor served in a row before streams are looked at again: parameters, timers,
answers whose work was done in the background."""
LOOK = 0.25
"""Real time between looks at what the inputs lack, s: silence is said within two seconds, 1.3 of
which make it silence. More often costs questions to the middleware, more seldom is later."""

LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""Estimates: reliable, and the last one is kept for those who come later."""


@dataclass
class _Periodic:
    """A callback that is due every `period` seconds of wall time, `always` if inactive too."""

    period: float
    callback: Callable[[], None]
    due: float
    always: bool


class Shell(ManagedNode):
    """A node that counts bad messages instead of failing on them.

    Messages are taken several at a time: at 1000 small messages per second an executor would spend
    most of the node's time on building wait sets.

    Args:
        name: name of the node.

    Attributes:
        faults: counts that appear on /diagnostics.
        gather: pause after a first message, s; those that follow meanwhile are taken together.
        skimming: whether only the newest matters of the streams that may be skimmed.
        by_arrival: whether messages are handed over in the order in which they came, not topic
            by topic: streams of one clock would seem to jump where a node was held up.
        listening: the topics whose messages the node takes itself.
        inputs: what comes on the topics, and why nothing does; that appears on /diagnostics.
        work_done: called when the node has ended its own work and is about to leave DDS.
    """

    gather = 0.005
    skimming = False
    by_arrival = False

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.work_done: Callable[[], None] = lambda: None
        self.listening: list[Listening] = []
        self.inputs = Inputs(self)
        self._participants: list[SecondParticipant] = []
        self._polled_group = Polled()
        self._served: list[Served] = []
        self._periodic: list[_Periodic] = []
        self.faults = Faults(self)
        self.every(1.0, self.faults.publish, always=True)
        self.every(LOOK, self._look, always=True)
        self.begin()

    def destroy_node(self) -> None:
        """Leave DDS; a node that has more to end does so before."""
        self.work_done()
        for leaving in [other.close() for other in self._participants]:
            leaving.join(LONGEST_CALLBACK)
        super().destroy_node()

    def work(self) -> None:
        """Take all waiting messages, answer requests and do what is due."""
        arrived: list[tuple[int, Subscription, Any]] = []
        for one in self.taken_topics():
            taken = self._take(one)
            if not (self.active or one.always):
                continue
            if self.skimming:
                taken = taken[-one.skim :]
            arrived += [(found.received, one.subscription, found.message) for found in taken]
        if self.by_arrival:
            arrived.sort(key=itemgetter(0))
        for _, subscription, message in arrived:
            subscription.callback(message)
        if self.active:
            self.process()
        now = time.monotonic()
        for served in self._served:
            served.answer(now)
        for entry in self._periodic:
            if now >= entry.due:
                late = now - entry.due > entry.period
                entry.due = now + entry.period if late else entry.due + entry.period
                if self.active or entry.always:
                    entry.callback()

    def taken_topics(self) -> list[Listening]:
        """Return the topics whose messages are taken: latched ones wait for an active node."""
        return [one for one in self.listening if self.active or one.always or not one.waits]

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work; what was silent meanwhile is given time anew."""
        self.inputs.wait_anew()
        return super().on_activate(state)

    def _look(self) -> None:
        """Say at once what has begun or ceased to be wrong with the inputs."""
        before, self.faults.idle = self.faults.idle, "" if self.active else self.lifecycle_state
        changed = (self.active and self.inputs.look()) or self.faults.idle != before
        now = time.monotonic()
        deaf = [one for one in self.taken_topics() if self.active and one.source.is_deaf(now)]
        if deaf:
            self._subscribe_anew(deaf, now)
        self.faults.troubles = self.inputs.troubles if self.active else ()
        if changed:
            self.faults.publish()

    def _subscribe_anew(self, deaf: Sequence[Listening], now: float) -> None:
        """Listen through another participant to what others publish and nobody brings."""
        for one in deaf:
            one.source.renew(now)
            self.faults.add("subscribed_anew", f"{one.source.topic}: published and not heard")
        with suppress(RuntimeError):  # of rclpy, such as security that asks for an enclave
            other = SecondParticipant(self)
            self._participants.append(other)
            for one in deaf:
                self._drop(one.spare[0] if one.spare else None)
                one.spare = one.subscribe(other), other
        self._close_participants()

    def _drop(self, subscription: Subscription | None) -> None:
        if subscription is not None and not self.destroy_subscription(subscription):
            subscription.destroy()

    def _close_participants(self) -> None:
        """Leave DDS with those through which nothing is listened to."""
        used = [one.through for one in self.listening]
        used += [one.spare[1] for one in self.listening if one.spare]
        for other in [other for other in self._participants if other not in used]:
            self._participants.remove(other)
            other.close()

    def _take(self, one: Listening) -> list[Taken]:
        """Return the messages that wait; none of a topic on which two publish at once."""
        taken, source = take_messages(one.subscription, self._undecodable), one.source
        if one.spare:
            taken = self._take_spare(one, taken)
        if one.numbers is None or not taken:
            return taken
        now = time.monotonic()
        if one.numbers.mix([found.number for found in taken], now):
            source.rivals = now + RIVAL_SPAN
        if now >= source.rivals:
            return taken
        self.faults.add(
            "two_publishers",
            f"{source.topic}: two publishers at once, nobody can know which is right; "
            f"{len(taken)} messages left out, stop one of them",
        )
        return []

    def _take_spare(self, one: Listening, taken: list[Taken]) -> list[Taken]:
        """Keep the subscription that hears something, and drop the other."""
        assert one.spare
        spare, other = one.spare
        found = taken or take_messages(spare, self._undecodable)
        if found:
            if not taken:
                spare, one.subscription, one.through = one.subscription, spare, other
            one.spare = None
            self._drop(spare)
            self._close_participants()
        return found

    def _undecodable(self, topic: str, error: Exception) -> None:
        self.faults.add("undecodable", f"{topic}: message cannot be read: {error}")

    def process(self) -> None:
        """Work on what was taken together; nodes that gain by it override this."""

    def idle_time(self) -> float:
        """Return the time until something is due, s."""
        return min(entry.due for entry in self._periodic) - time.monotonic()

    def listen(
        self,
        kind: type[Any],
        topic: str,
        callback: Callable[[Any], None],
        profile: QoSProfile = STREAM,
        raw: bool = False,
        skim: int = 0,
        sole: bool = False,
        need: Need = Need.OPTIONAL,
        always: bool = False,
    ) -> None:
        """Subscribe; a message that is refused or cannot be used yet is counted and dropped.

        Args:
            kind: type of the messages.
            topic: to subscribe to.
            callback: gets the message, as `wire` reads it where it knows the type.
            profile: quality of service.
            raw: hand over the bytes of the message instead.
            skim: while `skimming`, hand over only so many of those taken together; 0: all.
            sole: leave out what comes while two publish on the topic at once.
            need: when its silence is a trouble.
            always: hand over its messages while the node is not active, too.
        """
        decode = None if raw else decoder_of(kind)

        def guarded(message: Any) -> None:
            try:
                read = message if decode is None else decode(message)
            except (ValueError, struct.error, IndexError) as error:
                source.refuse(f"message cannot be read: {error}", time.monotonic())
                self._undecodable(full, error)
                return
            try:
                callback(read)
            except TactileDynamicsError as error:
                kind_of = "bad_input" if isinstance(error, BadInputError) else "not_ready"
                self.faults.add(getattr(error, "kind", kind_of), str(error))
                source.refuse(str(error), time.monotonic())
            else:
                source.take(time.monotonic())

        as_bytes = raw or decode is not None
        group, profile = self._polled_group, copy(profile)  # rclpy writes overrides into it
        subscription = self.create_subscription(
            kind,
            topic,
            guarded,
            profile,
            callback_group=group,
            raw=as_bytes,
            qos_overriding_options=overrides_of(topic, self.listening),
        )
        full = subscription.topic_name

        def subscribe(other: SecondParticipant) -> Subscription:
            return other.subscribe(kind, full, guarded, profile, as_bytes)

        source = self.inputs.add(subscription, topic, need)
        numbers = Numbers() if sole else None
        waits = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        one = Listening(subscribe, subscription, source, skim, numbers, always, waits)
        self.listening.append(one)

    def stream(self, kind: type[Any], topic: str) -> Publisher:
        """Return a publisher of sensor data."""
        return self.create_publisher(kind, topic, STREAM)

    def latched(self, kind: type[Any], topic: str) -> Publisher:
        """Return a publisher whose last message is kept for late subscribers."""
        return self.create_publisher(kind, topic, LATCHED)

    def every(self, period: float, callback: Callable[[], None], always: bool = False) -> None:
        """Call back each `period` seconds of wall time while the node is active, or `always`."""
        self._periodic.append(_Periodic(period, callback, time.monotonic() + period, always))

    def serve(self, name: str, action: Callable[[], str]) -> None:
        """Offer a std_srvs/Trigger whose answer is the text that `action` returns."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = action(), True
            except TactileDynamicsError as error:
                response.message, response.success = str(error), False
            return response

        service = self.create_service(
            Trigger, name, answer, qos_profile=REQUESTS, callback_group=self._polled_group
        )
        self._served.append(Served(service))


def spin(node: Shell, stop: Callable[[], bool]) -> None:
    """Let a node work until `stop` says so.

    Args:
        node: to be served; its services and parameters by an executor.
        stop: asked several times a second.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    waiter = Waiter(
        node, lambda: [each for one in node.taken_topics() for each in one.subscriptions]
    )
    service = time.monotonic()
    while not stop():
        requested = waiter.wait(min(node.idle_time(), service - time.monotonic()))
        time.sleep(node.gather)
        node.work()
        if requested or time.monotonic() >= service:
            for _ in range(CALLBACKS):
                executor.spin_once(timeout_sec=0.0)
            service = time.monotonic() + SERVICE_PERIOD
    executor.remove_node(node)


def run_node(
    factory: Callable[[], Shell], arguments: list[str] | None = None, prompt: bool = False
) -> int:
    """Run one node until Ctrl-C or SIGTERM; return the exit code.

    While it starts, it is left at once; later the callback that runs is finished, unless that takes
    long. Then the node writes its files and ends its background work.

    Args:
        factory: makes the node.
        arguments: command line without the program, that of this process if None.
        prompt: answer each message at once, at the price of processor time; else finish bursts.
    """
    if not prompt:
        finish_bursts()
    node: Shell | None = None
    with StopRequest(patience=0.0, limit=TIME_TO_END, at_once=abandon_all) as stop:
        try:
            start_ros(arguments)
            node = factory()
            refuse_unknown(node)
            node.get_logger().info(introduce(node))
            stop.patience = LONGEST_CALLBACK
            spin(node, lambda: stop.requested)
        except (ExternalShutdownException, Stopped):
            pass
        except TactileDynamicsError as error:
            print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
            return error.exit_code
        finally:
            stop.patience = math.inf
            if node is not None:
                node.work_done = stop.work_done
                node.destroy_node()
            rclpy.try_shutdown()
    return 0
