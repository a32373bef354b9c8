"""A diagnosis as typed messages."""

from __future__ import annotations

import math
from typing import Any

from std_msgs.msg import Header

from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.effects.registry import HELD
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.ros.actions import interface

REGISTRIES = {"held": HELD, "pushed": PUSHED}
"""Effects by the model whose error they explain."""


def verdict_message(document: Document, model: str, header: Header) -> Any:
    """Return the tactile_dynamics_msgs/Verdict of a diagnosis.

    Args:
        document: of the diagnosis.
        model: held or pushed.
        header: time of the last measurement, and the frame of the model.
    """
    error, verdict = document["error"], document["verdict"] or ""
    return interface("msg.Verdict")(
        header=header,
        verdict=verdict,
        adequate=verdict == "adequate",
        error=float(error["before"]),
        floor=float(error["noise_floor"]),
        effect=document["effect"] or "",
        group=list(document["group"]),
        remedy=_remedy(document, model),
    )


def _remedy(document: Document, model: str) -> str:
    """Return what to do about an effect or a convention; empty where nothing is known."""
    if document["effect"] is not None:
        return str(REGISTRIES[model].create(document["effect"]).remedy)
    return str((document.get("convention") or {}).get("change", ""))


def effect_messages(document: Document) -> list[Any]:
    """Return the tactile_dynamics_msgs/Effect of each candidate of a diagnosis, best first."""
    return [_effect(candidate) for candidate in document["candidates"]]


def _effect(candidate: Document) -> Any:
    parameters = candidate["parameters"]
    stds = [parameter["std"] for parameter in parameters.values()]
    return interface("msg.Effect")(
        name=candidate["name"],
        parameters=list(parameters),
        values=[float(parameter["value"]) for parameter in parameters.values()],
        stds=[math.nan if std is None else float(std) for std in stds],
        units=[parameter["unit"] for parameter in parameters.values()],
        p_value=float(candidate["p_value"]),
    )
