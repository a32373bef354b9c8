"""Estimates of inertia and of effects as statuses for people and programs."""

from __future__ import annotations

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    EffectEstimate,
)
from tactile_dynamics_ros.core.inertia.live import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, Verdict
from tactile_dynamics_ros.ros.diagnostics import status_message

LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
}


def status_of(
    estimate: LiveEstimate, effects: Sequence[str], verdict: Verdict
) -> Sequence[DiagnosticStatus]:
    """Return the statuses: parameters with standard deviations, directions, solver, effects.

    Where the estimate is withheld, parameters, directions and effects have no values.

    Args:
        estimate: the newest.
        effects: names of those in the model.
        verdict: what it is worth.
    """
    level = LEVELS[verdict.level]
    solver: dict[str, object] = {
        "effects": ",".join(effects),
        "samples": estimate.samples,
        "duration": estimate.duration,
        "latency": estimate.latency,
        "rejected": estimate.rejected,
        "recent_rms": estimate.recent.rms,
        "recent_explained": estimate.recent.explained,
        **estimate.error.to_json(),
    }
    parameters = {} if verdict.withheld else _parameters(estimate)
    directions = {} if verdict.withheld else {d.name: d.gain for d in estimate.directions}
    found = {} if verdict.withheld else estimate.effects
    return [
        status_message("parameters", parameters, level, verdict.text),
        status_message("directions", directions, level, verdict.text),
        status_message("solver", solver),
        *(status_message(f"effect {name}", _numbers(effect)) for name, effect in found.items()),
    ]


def _parameters(estimate: LiveEstimate) -> dict[str, object]:
    """Return value and standard deviation of mass, centre of mass and inertia about it."""
    body = estimate.inertia
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    values = [body.mass, *body.com, *body.inertia_com[rows, columns]]
    parameters: dict[str, object] = {}
    for name, value, std in zip(PARAMETER_NAMES, values, estimate.parameter_std, strict=True):
        parameters[name], parameters[f"{name}_std"] = float(value), float(std)
    return parameters


def _numbers(effect: EffectEstimate) -> dict[str, object]:
    """Return value, standard deviation and unit of each parameter of an effect."""
    entries: dict[str, object] = {}
    for key, entry in effect.to_json().items():
        entries[key], entries[f"{key}_std"] = entry["value"], entry["std"]
        entries[f"{key}_unit"] = entry["unit"]
    return entries


def waiting_status(effects: Sequence[str], text: str) -> Sequence[DiagnosticStatus]:
    """Return the statuses while there is no estimate of a model yet.

    Args:
        effects: names of those in the model.
        text: what is being done.
    """
    solver: dict[str, object] = {"effects": ",".join(effects), "samples": 0}
    return [
        status_message("parameters", {}, DiagnosticStatus.WARN, text),
        status_message("solver", solver),
    ]
