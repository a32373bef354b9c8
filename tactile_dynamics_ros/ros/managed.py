"""Managed nodes: `ros2 lifecycle` and launch files configure, activate and deactivate them.

Constructing a node is what configures it: parameters are read and topics subscribed to then. The
states say whether it may act. https://design.ros2.org/articles/node_lifecycle.html
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.service import Service
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)
from tactile_dynamics_ros.ros.names import DIAGNOSTICS
from tactile_dynamics_ros.ros.parameters import AnsweringNode, declare_config

SPOKEN_ALWAYS = (DIAGNOSTICS, "/parameter_events")
"""Topics on which an inactive node publishes too."""
NEXT_STEPS = {"unconfigured": ("configure", "activate"), "inactive": ("activate",)}
"""Transitions that lead to the active state, by the state in which a node is."""


@dataclass(frozen=True)
class LifecycleConfig:
    """How a managed node begins."""

    autostart: bool = parameter(
        True, "begin active; else stay unconfigured until asked, as by `ros2 lifecycle set`"
    )


class ManagedPublisher(Publisher):
    """A publisher that is silent while its node is not active.

    Attributes:
        node: that publishes; None publishes always.
        kept: the newest message of a latched topic that was held back.
    """

    node: ManagedNode | None = None
    kept: Any = None

    def publish(self, msg: Any) -> None:
        """Publish if the node is active; a latched topic says it when the node becomes active."""
        if self.node is None or self.node.active:
            super().publish(msg)
        elif self.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self.kept = msg

    def release(self) -> None:
        """Publish what was held back."""
        if self.kept is not None:
            kept, self.kept = self.kept, None
            super().publish(kept)


class ManagedNode(LifecycleNodeMixin, AnsweringNode):
    """A node with the states of ROS 2 that publishes and answers only while it is active.

    Args:
        name: name of the node.

    Attributes:
        active: whether the node works.
        stops: called with the reason when the node ceases to be active; must end all motion, and
            take back what a latched topic says and nobody watches any longer.
        actions: whole names of the actions that the node offers.
    """

    active = False

    def __init__(self, name: str) -> None:
        self.stops: list[Callable[[str], None]] = []
        self.actions: list[str] = []
        try:
            Node.__init__(self, name, automatically_declare_parameters_from_overrides=True)
        except ValueError as error:  # of rclpy, which does not name the parameter
            raise BadInputError(
                f"node {name}: an empty list was given, of which ROS does not know the type at the "
                "start; leave the parameter out, or write ['']"
            ) from error
        except RuntimeError as error:  # of rclpy, such as security that this ROS cannot enforce
            raise TactileDynamicsError(f"node {name}: ROS refuses it: {error}") from error
        # In a group of its own: served while an exploration that was called still runs.
        LifecycleNodeMixin.__init__(self, callback_group=MutuallyExclusiveCallbackGroup())

    def begin(self) -> None:
        """Become active unless the parameter autostart is false."""
        if declare_config(self, LifecycleConfig).autostart:
            self.trigger_configure()
            self.trigger_activate()

    @property
    def lifecycle_state(self) -> str:
        """Name of the state: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def require_active(self) -> None:
        """Check that the node may act.

        Raises:
            NotIdentifiableError: it is not active; says how it becomes so.
        """
        if self.active:
            return
        name, state = self.get_fully_qualified_name(), self.lifecycle_state
        steps = [f"ros2 lifecycle set {name} {step}" for step in NEXT_STEPS.get(state, ())]
        ways = "; ".join(steps) or "start it again"
        raise NotIdentifiableError(f"{self.get_name()} is {state}: {ways}")

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Work from now on, and say what latched topics have to say."""
        self.active = True
        for publisher in self.publishers:
            if isinstance(publisher, ManagedPublisher):
                publisher.release()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End all motion, then say and do nothing."""
        return self._end_motion("the node was deactivated")

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End all motion, then say and do nothing; the process ends by Ctrl-C as always."""
        return self._end_motion("the node was shut down")

    def _end_motion(self, why: str) -> TransitionCallbackReturn:
        try:
            for stop in self.stops:
                stop(why)
        finally:
            self.active = False
        return TransitionCallbackReturn.SUCCESS

    def create_publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Return a publisher that is silent while the node is not active."""
        publisher = super().create_publisher(*args, **kwargs, publisher_class=ManagedPublisher)
        if publisher.topic_name not in SPOKEN_ALWAYS:
            publisher.node = self
        return publisher

    def create_service(
        self, srv_type: type[Any], srv_name: str, callback: Callable[..., Any], **options: Any
    ) -> Service:
        """Return a service; a std_srvs/Trigger is refused while the node is not active."""
        if srv_type is Trigger:
            callback = self._refusing(callback)
        return super().create_service(srv_type, srv_name, callback, **options)

    def _refusing(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that answers as `callback`, or why it does not."""

        def refused(response: Trigger.Response) -> bool:
            try:
                self.require_active()
            except NotIdentifiableError as error:
                response.success, response.message = False, str(error)
            return not self.active

        def at_once(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            return response if refused(response) else callback(request, response)

        async def later(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            return response if refused(response) else await callback(request, response)

        return later if inspect.iscoroutinefunction(callback) else at_once
