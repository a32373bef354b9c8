"""The last act of the demo of a table: something changes, and the nodes say what."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.ros.diagnostics import Statuses

if TYPE_CHECKING:
    from rclpy.node import Node

GOALS = ((0.42, -0.05, 0.0), (0.55, 0.08, 0.0))
"""m, m, deg: where the object is pushed until somebody notices the change; two ways to be."""
NOTICED = 3.0
"""Real seconds that the estimator may be behind the last push."""
REFITTED = 240.0
"""Real seconds for the fit with the effect that was added: 3 to 47 of a core, which others use."""

Call = Callable[[str], tuple[bool, str]]
Ask = Callable[[tuple[float, float, float]], dict[str, Any]]


class Act:
    """Lets the hidden effect begin, and asks those who should notice.

    Args:
        node: to talk with.
        call: calls a service by its name.
        push: pushes the object to a goal.
        say: prints a line for people.
    """

    def __init__(self, node: Node, call: Call, push: Ask, say: Callable[[str], None]) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        from tactile_dynamics_ros.ros.names import PROPERTY_STATUS
        from tactile_dynamics_ros.ros.shell import LATCHED

        self._node, self._call, self._push, self._say = node, call, push, say
        self._told = Statuses()
        self._text, self._before = "", 0
        node.create_subscription(DiagnosticArray, PROPERTY_STATUS, self._on_status, LATCHED)

    def play(self) -> dict[str, Any]:
        """Play it; return what was said."""
        from tactile_dynamics_ros.ros.names import BEGIN, DIAGNOSE

        self._spin(lambda: "solver" in self._told, NOTICED)
        self._before = self._count
        if self._before:
            self._say(
                f"property_estimator reported {self._before} changes though nothing had changed"
            )
        done, message = self._call(BEGIN)
        if not done:
            raise TactileDynamicsError(message)
        self._say("now something about table or object changes; who notices? pushing on ...")
        outcome: dict[str, Any] = {"noticed": self._notice(), "text": self._text, "diagnosis": None}
        outcome["alarms_before"] = self._before
        if not outcome["noticed"]:
            self._say("nobody noticed a change: the pushes are what chance makes of a clean table")
            return outcome
        outcome["status"] = self._told.values("change")
        self._say(f"property_estimator: {self._text}")
        outcome["actions"] = self._push_straight()
        self._say(f"explorer: {len(outcome['actions'])} pushes in different directions")
        self._say("asking /model_check/diagnose what is different ...")
        began = time.monotonic()
        done, message = self._call(DIAGNOSE)
        if not done:
            self._say(f"no diagnosis: {message}")
            return outcome | {"refused": message}
        outcome["diagnosis"] = found = json.loads(message)
        outcome["sentence"] = sentence(found)
        self._say(f"after {time.monotonic() - began:.0f} s: {outcome['sentence']}")
        return outcome | self._take_over(found)

    def _notice(self) -> bool:
        """Push about until the change is noticed; return whether it is.

        Pushes to a goal are many short ones, of which little may count; what they do not show,
        straight ones in different directions do.
        """
        for goal in GOALS:
            if self._changed:
                return True
            self._push(goal)
            self._spin(lambda: self._changed, NOTICED)
        if not self._changed:
            self._say(
                "explorer: straight pushes in different directions, since short ones say little"
            )
            self._push_straight()
            self._spin(lambda: self._changed, NOTICED)
        return self._changed

    def _push_straight(self) -> list[Any]:
        """Let the explorer push in different directions; return what it did."""
        from tactile_dynamics_ros.ros.names import EXPLORE_CHANGE

        _, message = self._call(EXPLORE_CHANGE)
        try:
            return list(json.loads(message)["actions"])  # those before a stop count too
        except ValueError:
            self._say(f"explorer: no straight pushes: {message}")
            return []

    def _take_over(self, found: dict[str, Any]) -> dict[str, Any]:
        """Add a named effect to the model of the estimator, and wait for the error with it."""
        effect, errors = found["effect"], found["error"]
        outcome = {"before": errors["before"], "after": errors["after"], "added": None}
        self._say(
            f"held-out error {errors['before']:.2f} before, {errors['after']:.2f} with what is "
            f"named; {errors['noise_floor']:.2f} is the noise"
        )
        if not effect or found["verdict"] not in ("missing_effect", "ambiguous"):
            self._say(
                "what is known of the object was opened: call /property_estimator/reset and "
                "/explorer/explore to find it anew"
            )
            return outcome
        from rclpy.parameter import Parameter
        from rclpy.parameter_client import AsyncParameterClient

        client = AsyncParameterClient(self._node, "property_estimator")
        client.set_parameters([Parameter("effects", value=[effect])])
        self._say(f"adding {effect} to the live model")
        shown = f"effect {effect}"
        self._spin(lambda: shown in self._told or self._refuses(effect), REFITTED)
        errors = self._told.values("solver") if shown in self._told else {}
        before, after = (_number(errors.get(key)) for key in ("without_effects", "whitened_rms"))
        outcome |= {"added": effect, "live_before": before, "live_after": after}
        outcome["fall"] = fall(before, after, self._refuses(effect))
        if effect in errors.get("vague", "").split(","):
            outcome["fall"] += (
                f"; how large {effect} is, the pushes do not determine: it may be another"
            )
        self._say(outcome["fall"])
        return outcome

    @property
    def _count(self) -> int:
        return int(self._told.values("change").get("changes", 0))

    @property
    def _changed(self) -> bool:
        return self._count > self._before

    def _refuses(self, effect: str) -> bool:
        """Whether the last fit was with the effect and came to no end."""
        return self._refused and effect in self._told.words("solver", "effects")

    @property
    def _refused(self) -> bool:
        return bool(self._told.values("solver").get("refused"))

    def _spin(self, condition: Callable[[], bool], seconds: float) -> None:
        from tactile_dynamics_ros.cli.topics import spin_until

        spin_until(self._node, condition, seconds)

    def _on_status(self, message: Any) -> None:
        self._told = Statuses(message.status)
        if "since" in self._told.values("change"):
            self._text = self._told.text("change")


def _number(text: str | None) -> float | None:
    return None if text is None else float(text)


def fall(before: float | None, after: float | None, ended: bool = False) -> str:
    """What adding an effect does to the error of the live model.

    Args:
        before: error of the pushes since the change without the effect, over the noise.
        after: with it; None where there is no fit.
        ended: whether the fit with the effect came to no end.
    """
    if after is None and ended:
        return "the fit of the live model with it came to no end: what was known before counts"
    if after is None:
        return f"the live model has no fit with it after {REFITTED:.0f} s"
    without = "" if before is None else f"{before:.2f} times the noise without it, "
    return f"error of the live model: {without}{after:.2f} with it"


def sentence(found: dict[str, Any]) -> str:
    """What the diagnosis says, with the angle where a table leans.

    Args:
        found: document of the diagnosis.
    """
    said = str(found.get("sentence") or found["verdict"])
    tilt = leaning(found)
    if tilt is None:
        return said
    alone = found["effect"] == "support_tilt" and found["verdict"] == "missing_effect"
    sure = "the table leans" if alone else "as if the table leant"
    return f"{sure} by {tilt[0]:.1f} ± {tilt[1]:.1f} deg. {said}"


def leaning(found: dict[str, Any]) -> tuple[float, float] | None:
    """Angle of a lean and its standard deviation, deg, where one is named, alone or among others.

    Args:
        found: document of the diagnosis.
    """
    named = [c["parameters"] for c in found["candidates"] if c["name"] == "support_tilt"]
    if "support_tilt" not in (found["effect"], *found["group"]) or not (named and named[0]):
        return None
    values = np.array(
        [[named[0][axis][key] for axis in ("t_x", "t_y")] for key in ("value", "std")]
    )
    angle = float(np.linalg.norm(values[0]))
    spread = float(np.linalg.norm(values[0] * values[1])) / max(angle, 1e-6)
    return float(np.rad2deg(angle)), float(np.rad2deg(spread))
