"""Estimates and verdicts as messages of tactile_dynamics_msgs."""

from __future__ import annotations

import math
from typing import Any

from rclpy.publisher import Publisher
from std_msgs.msg import Header

from tactile_dynamics_ros.core.discrepancy.documents import Document
from tactile_dynamics_ros.core.effects.registry import HELD
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody
from tactile_dynamics_ros.ros.actions import interface
from tactile_dynamics_ros.ros.conversions import inertia_to_message
from tactile_dynamics_ros.ros.shell import Shell

REGISTRIES = {"held": HELD, "pushed": PUSHED}
"""Effects by the model whose error they explain."""


def typed_publisher(node: Shell, kind: str, topic: str) -> Publisher | None:
    """Return a publisher whose last message is kept, or None without tactile_dynamics_msgs.

    Args:
        node: that publishes.
        kind: of the messages, such as Estimate.
        topic: its name.
    """
    found = interface(f"msg.{kind}")
    return None if found is None else node.latched(found, topic)


def estimate_message(estimate: InertialEstimate, adequate: bool, header: Header) -> Any:
    """Return the tactile_dynamics_msgs/Estimate of a rigid body.

    Args:
        estimate: its inertial parameters.
        adequate: whether the model explains the measurements.
        header: time of the last measurement, and the frame of the estimate.
    """
    effects = estimate.effects.items()
    return interface("msg.Estimate")(
        header=header,
        inertia=inertia_to_message(estimate.inertia, 0.0, header.frame_id).inertia,
        covariance=estimate.covariance.ravel(),
        undetermined=list(estimate.not_excited),
        error=float(estimate.error.whitened_rms),
        adequate=bool(adequate),
        effects=[_effect(name, effect.to_json(), math.nan) for name, effect in effects],
    )


def body_message(known: KnownBody, error: float, adequate: bool, header: Header) -> Any:
    """Return the tactile_dynamics_msgs/Estimate of a body that is kept in a file.

    Args:
        known: the body.
        error: whitened RMS of the residual with it.
        adequate: whether the model explains the measurements.
        header: time of the last measurement, and the frame of the body.
    """
    body = InertialParameters.from_dynamic_parameters(known.phi)
    return interface("msg.Estimate")(
        header=header,
        inertia=inertia_to_message(body, 0.0, header.frame_id).inertia,
        covariance=known.covariance.ravel(),
        undetermined=list(known.undetermined),
        error=float(error),
        adequate=bool(adequate),
    )


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
    return [_effect(c["name"], c["parameters"], c["p_value"]) for c in document["candidates"]]


def _effect(name: str, parameters: dict[str, dict[str, Any]], p_value: float) -> Any:
    """Return a message of {parameter: {"value", "std", "unit"}}."""
    stds = [parameter["std"] for parameter in parameters.values()]
    return interface("msg.Effect")(
        name=name,
        parameters=list(parameters),
        values=[float(parameter["value"]) for parameter in parameters.values()],
        stds=[math.nan if std is None else float(std) for std in stds],
        units=[parameter["unit"] for parameter in parameters.values()],
        p_value=float(p_value),
    )
