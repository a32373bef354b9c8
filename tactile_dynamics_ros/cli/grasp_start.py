"""Lets the hand of the demo move, once everybody who should see it is there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_dynamics_ros.ros.names import GRASP_START

ASK_EVERY = 0.5
"""Pause between two questions, s of real time: half a second is nothing beside a grasp of ten."""
PATIENCE = 5.0
"""Time for an answer, s of real time: the node answers at once, so that one which is still out by
then was asked of a node that has died meanwhile."""


class GraspStart:
    """Calls grasp_controller/start when all nodes are there, and again until that is accepted.

    Call `advance` often; nothing here blocks.

    Args:
        node: to talk with.
        awaited: names of the nodes that must be there.
        say: prints a line for people.

    Attributes:
        accepted: whether the motion was started.
        reason: why it was not, so far.
    """

    def __init__(self, node: Node, awaited: Sequence[str], say: Callable[[str], None]) -> None:
        self.accepted, self.reason = False, ""
        self._node, self._awaited, self._say = node, set(awaited), say
        self._client = node.create_client(Trigger, GRASP_START)
        self._question: Any = None
        self._asked = 0.0

    def advance(self) -> None:
        """Ask if it is time, and hear the answer."""
        if self.accepted:
            return
        if self._question is not None and self._question.done():
            answer, self._question = self._question.result(), None
            self.accepted, self.reason = answer.success, answer.message
            if self.accepted:
                self._say(f"{GRASP_START}: {answer.message}")
        elif time.monotonic() - self._asked > (ASK_EVERY if self._question is None else PATIENCE):
            self._asked = time.monotonic()
            self._ask()

    def _ask(self) -> None:
        if self._question is not None:
            self._client.remove_pending_request(self._question)
            self._question, self.reason = None, f"no answer of {GRASP_START}"
        missing = self._awaited - set(self._node.get_node_names())
        if missing:
            self.reason = f"no node {min(missing)} yet"
        elif self._client.service_is_ready():
            self._question = self._client.call_async(Trigger.Request())
