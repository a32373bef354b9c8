"""Actions: a node's long work as a goal with feedback, cancel and a result.

Their types are in the package tactile_dynamics_msgs. Without it a node offers its services alone.
"""

from __future__ import annotations

import importlib
import json
import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from rclpy.type_support import check_for_type_support
from rosidl_generator_py.import_type_support_impl import UnsupportedTypeSupport

from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.ros.managed import ManagedNode

INTERFACES = "tactile_dynamics_msgs"
"""Package of the actions and typed messages, built by colcon or by `ros.interface_build`."""
CANCELED = "canceled"
"""What a result says whose goal was canceled, whatever had been done until then."""


def interface(kind: str) -> Any:
    """Return a type of tactile_dynamics_msgs, or None where the package is not installed.

    Args:
        kind: as action.Probe or msg.Verdict.
    """
    folder, _, name = kind.partition(".")
    try:
        found = getattr(importlib.import_module(f"{INTERFACES}.{folder}"), name)
        check_for_type_support(found)
    except (ImportError, OSError, UnsupportedTypeSupport):  # not there, or built for other wheels
        return None
    return found


class Action:
    """An action of a node, which works on one goal at a time.

    The node says how its work goes on (`tell`) and how it ended (`end`), whoever asked for it:
    without a goal both do nothing. Its services ask `require_free` before they begin.

    Args:
        node: that offers it.
        kind: type in tactile_dynamics_msgs, such as Probe.
        name: of the action.
        begin: starts the work for a goal; raises TactileDynamicsError to refuse it.
        stop: ends the work at once, and all motion; called when a client cancels.
    """

    def __init__(
        self,
        node: ManagedNode,
        kind: str,
        name: str,
        begin: Callable[[Any], None],
        stop: Callable[[], None],
    ) -> None:
        self._node, self._name, self._begin, self._stop = node, name, begin, stop
        self._taken = False
        self._goal: ServerGoalHandle | None = None
        self._outcome, self._since = Future(), 0.0
        self._kind, self._server = interface(f"action.{kind}"), None
        if self._kind is None:
            node.get_logger().info(f"{name} is offered as a service only: no {INTERFACES} here")
            return
        self._server = ActionServer(
            node,
            self._kind,
            name,
            self._execute,
            callback_group=ReentrantCallbackGroup(),  # a service that is awaited must not block it
            goal_callback=self._take,
            cancel_callback=self._cancel,
        )
        node.actions.append(node.resolve_service_name(name))

    @property
    def busy(self) -> bool:
        """Whether a goal is being worked on."""
        return self._taken

    @property
    def elapsed(self) -> float:
        """Real time since the goal was begun, s."""
        return time.monotonic() - self._since

    def require_free(self) -> None:
        """Check that no goal is being worked on.

        Raises:
            NotIdentifiableError: one is.
        """
        if self._taken:
            raise NotIdentifiableError(f"{self._name}: a goal is being worked on; cancel it first")

    def tell(self, phase: str, share: float, text: str) -> None:
        """Publish feedback.

        Args:
            phase: what is being done.
            share: done, 0 to 1; NaN where nobody knows.
            text: one sentence.
        """
        if self._goal is not None and not self._outcome.done():
            feedback = self._kind.Feedback(phase=phase, share_done=float(share), text=text)
            self._goal.publish_feedback(feedback)

    def end(self, success: bool, message: str, document: object = None, **fields: Any) -> None:
        """End the goal.

        Args:
            success: whether the work was done to its end.
            message: one sentence: the outcome.
            document: what the verb of the command prints with --json; None: nothing.
            fields: the other fields of the result.
        """
        if self._goal is not None and not self._outcome.done():
            text = "" if document is None else json.dumps(document)
            told = {"success": success, "message": message, "json": text}
            self._outcome.set_result(self._kind.Result(**told, **fields))

    def close(self) -> None:
        """Offer the action no longer."""
        if self._server is not None:
            self._server.destroy()
            self._server = None

    def _take(self, _: Any) -> GoalResponse:
        """Accept a goal unless there is one."""
        if self._taken:
            self._node.get_logger().warning(f"{self._name}: works on a goal, rejects another")
            return GoalResponse.REJECT
        self._taken = True
        return GoalResponse.ACCEPT

    def _cancel(self, _: ServerGoalHandle) -> CancelResponse:
        """Stop the work before the client is told."""
        if self._goal is not None and not self._outcome.done():
            self._stop()
            self.end(False, CANCELED)
        return CancelResponse.ACCEPT

    async def _execute(self, goal: ServerGoalHandle) -> Any:
        """Begin, await the end, and return the result; nothing begins that is canceled already."""
        self._goal, self._outcome, self._since = goal, Future(), time.monotonic()
        try:
            if goal.is_cancel_requested:
                self.end(False, CANCELED)
            else:
                self._node.require_active()
                self._begin(goal.request)
        except TactileDynamicsError as error:
            self.end(False, str(error))
        except Exception:
            self._goal, self._taken = None, False
            raise
        result = await self._outcome
        self._goal, self._taken = None, False
        if goal.is_cancel_requested:
            result.success, result.message = False, CANCELED
            goal.canceled()
        elif result.success:
            goal.succeed()
        else:
            goal.abort()
        return result
