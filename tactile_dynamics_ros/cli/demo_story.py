"""The demo with a hidden effect: ask what is missing, add it, watch the error fall."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.ros.names import DIAGNOSE, MODEL_ERROR
from tactile_dynamics_ros.ros.shell import LATCHED

ENOUGH_DATA = 25.0
PATIENCE = 120.0
PROMISING = 0.6
"""Share of the error that a candidate must be expected to leave, at most, to be tried."""


class Story:
    """Asks model_check once enough has been seen, and adds what it names to the live model.

    Call `advance` often; nothing here blocks.

    Args:
        node: to talk with.
        say: prints a line for people.
    """

    def __init__(self, node: Node, say: Callable[[str], None]) -> None:
        self.diagnosis: dict[str, Any] | None = None
        self.errors: list[tuple[bool, float]] = []
        self._say = say
        self._check = node.create_client(Trigger, DIAGNOSE)
        self._estimator = AsyncParameterClient(node, "inertial_estimator")
        self._question: Any = None
        self._change: Any = None
        node.create_subscription(Float64, MODEL_ERROR, self._on_error, LATCHED)

    @property
    def waiting(self) -> bool:
        """Whether an answer is still to come, within the patience of a spectator."""
        if self._question is None or self.diagnosis is not None:
            return False
        return time.monotonic() - self._asked < PATIENCE

    def advance(self, seconds_of_data: float) -> None:
        """Take the next step if it is time."""
        if self._question is None:
            if seconds_of_data > ENOUGH_DATA and self._check.service_is_ready():
                self._say("asking /model_check/diagnose what the model lacks ...")
                self._asked = time.monotonic()
                self._question = self._check.call_async(Trigger.Request())
        elif self.diagnosis is None and self._question.done():
            self._hear(self._question.result())

    def _hear(self, answer: Trigger.Response) -> None:
        took = time.monotonic() - self._asked
        if not answer.success:
            self.diagnosis = {"verdict": "none", "sentence": answer.message, "effect": None}
        else:
            self.diagnosis = json.loads(answer.message)
        found = self.diagnosis
        self._say(f"diagnosis after {took:.0f} s: {found['verdict']}: {found['sentence']}")
        for candidate in found.get("candidates", [])[:3]:
            expected = candidate["predicted_whitened_rms"]
            self._say(f"  candidate {candidate['name']}: error expected with it {expected:.2f}")
        effect = found["effect"] or _worth_trying(found)
        if effect:
            self._say(f"adding {effect} to the live model")
            value = Parameter("effects", value=[effect])
            self._change = self._estimator.set_parameters([value])

    def _on_error(self, message: Float64) -> None:
        self.errors.append((self._change is not None, message.data))
        self._say(f"error of the live model: {message.data:.2f} times the sensor noise")

    def document(self) -> dict[str, Any]:
        """Return what was found, for --json."""
        before = [error for added, error in self.errors if not added]
        after = [error for added, error in self.errors if added]
        return {
            "diagnosis": self.diagnosis,
            "live_error_before": before[-1] if before else None,
            "live_error_after": after[-1] if after else None,
        }


def _worth_trying(document: dict[str, Any]) -> str | None:
    """Return the best candidate if it promises much, though it does not explain everything."""
    candidates = document.get("candidates", [])
    if document["verdict"] != "unexplained" or not candidates:
        return None
    best = candidates[0]
    promising = best["predicted_whitened_rms"] < PROMISING * document["error"]["before"]
    return str(best["name"]) if promising else None
