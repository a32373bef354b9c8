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

from tactile_dynamics_ros.core.discrepancy.verdict.wording import join_names
from tactile_dynamics_ros.ros.names import LEARN, MODEL_ERROR
from tactile_dynamics_ros.ros.shell import LATCHED

ENOUGH_DATA = 25.0
"""Span of measurements that is asked about, s: long enough to tell most effects apart, and more
than half of the motion is left in which the error falls."""
CARRIED, ENOUGH_SHARE = 8.0, 0.5
"""Span of measurements before the motion begins, s (lifting and carrying, in which nothing turns),
and share of a short motion after which it is asked; later leaves no motion for the new model."""
PATIENCE = 600.0
"""Time for an answer, real s: a diagnosis takes 10 on an idle core, 80 beside four other programs.
Less ends the story without a diagnosis on a busy machine."""
PROMISING = 0.6
"""Share of the error that a candidate must be expected to leave, at most, to be tried."""
_SHOWN = 3
"""Candidates that are listed: the best, and what competes with it."""


class Story:
    """Asks model_check once enough has been seen, and adds what it names to the live model.

    Where no known effect explains the measurements, that is the law which model_check learns.

    Call `advance` often; nothing here blocks.

    Args:
        node: to talk with.
        say: prints a line for people.
        motion: duration of the motion, s.

    Attributes:
        diagnosis: what was answered; None before.
        seconds: span of the measurements that were asked about, s.
        added: effect, or file of a law after the effects beside it, that was added to the live
            model, separated by commas; None if none was.
    """

    def __init__(self, node: Node, say: Callable[[str], None], motion: float) -> None:
        self.diagnosis: dict[str, Any] | None = None
        self.seconds = 0.0
        self.added: str | None = None
        self.errors: list[tuple[bool, float]] = []
        self._say, self._enough = say, min(ENOUGH_DATA, CARRIED + ENOUGH_SHARE * motion)
        self._check = node.create_client(Trigger, LEARN)
        self._estimator = AsyncParameterClient(node, "inertial_estimator")
        self._question: Any = None
        self._change: Any = None
        self._changed = False
        node.create_subscription(Float64, MODEL_ERROR, self._on_error, LATCHED)

    @property
    def waiting(self) -> bool:
        """Whether an answer is still to come, within the patience of a spectator."""
        if self._question is None or self.diagnosis is not None:
            return False
        return time.monotonic() - self._asked < PATIENCE

    def advance(self, seconds_of_data: float, held: bool = True) -> None:
        """Take the next step if it is time.

        Args:
            seconds_of_data: span of the measurements so far, s.
            held: whether the hand still has the object.
        """
        if self._question is None:
            if seconds_of_data > self._enough and self._check.service_is_ready():
                self._say("asking /model_check/learn what the model misses ...")
                self._asked, self.seconds = time.monotonic(), seconds_of_data
                self._question = self._check.call_async(Trigger.Request())
        elif self.diagnosis is None and self._question.done():
            self._hear(self._question.result())
            if held:
                self._add()
            elif proposal(self.diagnosis or {}):
                self._say("the hand has put the object down meanwhile: nothing is added live")
        elif self._change is not None and self._change.done() and not self._changed:
            self._changed = True
            for result in self._change.result().results:
                if not result.successful:
                    self._say(f"inertial_estimator refuses: {result.reason}")

    def _hear(self, answer: Trigger.Response) -> None:
        took = time.monotonic() - self._asked
        if not answer.success:
            self.diagnosis = {"verdict": "none", "sentence": answer.message, "effect": None}
        else:
            self.diagnosis = json.loads(answer.message)
        found = self.diagnosis
        self._say(
            f"diagnosis of the first {self.seconds:.0f} s, after {took:.0f} s: "
            f"{found['verdict']}: {found['sentence']}"
        )
        shown = found["candidates"][:_SHOWN] if proposal(found) else []
        for candidate in shown:
            expected = candidate["predicted_whitened_rms"]
            self._say(f"  candidate {candidate['name']}: error expected with it {expected:.2f}")

    def _add(self) -> None:
        """Add what the diagnosis proposes to the live model."""
        proposed = proposal(self.diagnosis or {})
        if proposed is None:
            return
        self.added, meaning = proposed
        self._say(f"adding {self.added} to the live model{meaning}")
        names = self.added.split(",")
        self._change = self._estimator.set_parameters([Parameter("effects", value=names)])

    def _on_error(self, message: Float64) -> None:
        self.errors.append((self._change is not None, message.data))
        self._say(f"error of the live model: {message.data:.2f} times the sensor noise")

    def close(self) -> None:
        """Say what adding an effect did to the error of the live model."""
        if self.added is None:
            return
        found = self.document()
        before, after = found["live_error_before"], found["live_error_after"]
        if before is None or after is None:
            self._say(f"the motion ended before the live model had an error with {self.added}")
        else:
            self._say(
                f"error of the live model in its last seconds: {before:.2f} times the sensor "
                f"noise without {self.added}, {after:.2f} with it"
            )

    def document(self) -> dict[str, Any]:
        """Return what was found, for --json."""
        before = [error for added, error in self.errors if not added]
        after = [error for added, error in self.errors if added]
        return {
            "diagnosis": self.diagnosis,
            "diagnosed_s": self.seconds,
            "added": self.added,
            "live_error_before": before[-1] if before else None,
            "live_error_after": after[-1] if after else None,
        }


def proposal(document: dict[str, Any]) -> tuple[str, str] | None:
    """Return the effect that the live model gets, and what adding it means; None for no effect.

    Args:
        document: of a diagnosis, with the law that was learnt, if one was.
    """
    if law := document.get("law"):
        return ",".join([*law["beside"], law["file"]]), ", the law that was learnt"
    effect, others = document.get("effect"), [*document.get("group", ())][1:]
    if effect and document["verdict"] == "ambiguous":
        return effect, (
            f", the first of {join_names([effect, *others], 'and')}: the error falls with any of "
            "them, but which one it is cannot be determined from these measurements, and mass, "
            "centre of mass and inertia hold only if it is this one"
        )
    if effect:
        return effect, ""
    tried = _worth_trying(document)
    return tried and (
        tried,
        ": it is not the whole cause, but explains most of the error; it may stand for something "
        "that is not in the catalogue, and the estimates with it are not to be trusted",
    )


def _worth_trying(document: dict[str, Any]) -> str | None:
    """Return the best candidate if it promises much, though it does not explain everything."""
    candidates = document.get("candidates", [])
    if document.get("verdict") != "unexplained" or not candidates:
        return None
    best = candidates[0]
    promising = best["predicted_whitened_rms"] < PROMISING * document["error"]["before"]
    return str(best["name"]) if promising else None
