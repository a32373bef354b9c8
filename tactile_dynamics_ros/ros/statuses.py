"""Statuses of estimates, of held and of pushed objects, for people and programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.live import LiveEstimate
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, Verdict
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.filter.summary import Properties, vague_effects
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
    com_inertia_jacobian,
    inertia_matrix,
)
from tactile_dynamics_ros.ros.diagnostics import (
    OK,
    Statuses,
    effect_status,
    status_message,
    to_number,
)
from tactile_dynamics_ros.ros.object_state import ObjectState

LEVELS = {
    Level.OK: DiagnosticStatus.OK,
    Level.WARN: DiagnosticStatus.WARN,
    Level.ERROR: DiagnosticStatus.ERROR,
}


def status_of(
    estimate: LiveEstimate, effects: Sequence[str], verdict: Verdict, state: ObjectState
) -> Sequence[DiagnosticStatus]:
    """Return the statuses: parameters with standard deviations, directions, solver, effects.

    Where the estimate is withheld, parameters, directions and effects have no values. While nothing
    is held they are of the last grasp, and not OK; nor are they while an input is in trouble.

    Args:
        estimate: the newest.
        effects: names of those in the model.
        verdict: what it is worth.
        state: whether the object is held now.
    """
    level, text = LEVELS[verdict.level], verdict.text
    if state.warning:
        level = max(level, DiagnosticStatus.WARN)
        text = f"{state.warning}; {'' if state.current else 'last grasp: '}{text}"
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
    directions = {} if verdict.withheld else {f"{d.name}_gain": d.gain for d in estimate.directions}
    found = {} if verdict.withheld else estimate.effects
    return [
        status_message("parameters", parameters, level, text),
        status_message("directions", directions, level, text),
        status_message("solver", solver),
        *(effect_status(name, effect.to_json()) for name, effect in found.items()),
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


@dataclass(frozen=True)
class InertiaStatus:
    """What the statuses of inertial_estimator say.

    Attributes:
        text: what the estimate is worth, or why there is none.
        good: whether it is to be believed.
        effects: of the model.
        samples: that were used; 0 before the first fit of a model.
        error: over the noise; NaN where there is no fit.
        value: (10,) in the order of PARAMETER_NAMES; NaN where the estimate is withheld.
        std: (10,) their standard deviations.
    """

    text: str
    good: bool
    effects: tuple[str, ...]
    samples: int
    error: float
    value: Array
    std: Array

    @property
    def known(self) -> bool:
        """Whether there is an estimate from samples: values with standard deviations."""
        told = np.isfinite(self.value).all() and not np.isnan(self.std).any()
        return bool(told and self.samples)


def read_inertia_status(statuses: Sequence[Any]) -> InertiaStatus:
    """Return what the statuses say; entries that are missing make no error.

    Args:
        statuses: of a message of inertial_estimator, live or recorded.
    """
    read = Statuses(statuses)
    samples = read.number("solver", "samples")
    return InertiaStatus(
        text=read.text("parameters"),
        good=read.level("parameters") == OK,
        effects=read.words("solver", "effects"),
        samples=int(samples) if np.isfinite(samples) else 0,
        error=read.number("solver", "whitened_rms"),
        value=read.numbers("parameters", PARAMETER_NAMES),
        std=read.numbers("parameters", [f"{name}_std" for name in PARAMETER_NAMES]),
    )


def body_of_status(statuses: Sequence[Any]) -> tuple[KnownBody | None, str]:
    """Return what inertial_estimator knows of what is carried, and why not to believe it.

    Standard deviations of mass, centre and inertia about it are taken as independent.

    Args:
        statuses: of a message of inertial_estimator.
    """
    said, read = read_inertia_status(statuses), Statuses(statuses)
    if not (np.isfinite(said.value).all() and np.isfinite(said.std).all()):
        return None, said.text or "no estimate of the load yet"
    body = InertialParameters(said.value[0], said.value[1:4], inertia_matrix(said.value[4:]))
    phi = body.dynamic_parameters
    to_phi = np.linalg.inv(com_inertia_jacobian(phi))
    effects = {name: _effect_values(read, name) for name in said.effects}
    covariance = (to_phi * said.std**2) @ to_phi.T
    known = KnownBody(phi, covariance, "inertial_estimator", (), effects)
    return known, "" if said.good else said.text


def _effect_values(read: Statuses, effect: str) -> dict[str, dict[str, float]]:
    """Return value by parameter, as `effect_status` wrote them."""
    found: dict[str, dict[str, float]] = {}
    for key, text in read.values(f"effect {effect}").items():
        name = key.removeprefix(f"{effect}.")
        if not name.endswith(("_std", "_unit")):
            found[name] = {"value": to_number(text)}
    return found


def property_status(
    known: Properties | None, live: LiveProperties, state: ObjectState
) -> Sequence[DiagnosticStatus]:
    """Return the statuses: properties with their std, what predicts poses, how they came about.

    Before the object was seen, properties have no values. While it is not followed they are of
    earlier measurements, and not OK.

    Args:
        known: of link_1; None before the object was seen.
        live: whose counts are reported.
        state: whether the object is followed now.
    """
    solver: dict[str, object] = {
        "model": live.config.model,
        "effects": ",".join(live.effects),
        "source": "nothing" if known is None else known.source,
        "fits": live.fits,
        "refused": live.refused,
    }
    if known is None:
        text = "; ".join([state.text, *state.troubles])
        nothing = status_message("link_1", {}, DiagnosticStatus.WARN, text)
        return [nothing, status_message("solver", solver)]
    level, text = DiagnosticStatus.WARN if known.doubtful else DiagnosticStatus.OK, known.text
    if state.warning:
        before = "" if state.current else "before: "
        level, text = DiagnosticStatus.WARN, f"{state.warning}; {before}{text}"
    link: dict[str, object] = {}
    for name, (value, std) in known.values.items():
        link[name], link[f"{name}_std"] = value, std
    link["undetermined"] = ",".join(known.undetermined)
    if live.fit is not None:
        solver |= {"samples": live.fit.samples, "whitened_rms": live.fit.error}
        if live.fit.error_without is not None:
            solver["without_effects"] = live.fit.error_without
            solver["vague"] = ",".join(vague_effects(live.fit))
    statuses = [status_message("link_1", link, level, text)]
    found = live.fit.effects if live.fit is not None else {}
    statuses += [effect_status(name, parameters) for name, parameters in found.items()]
    if live.tracker is not None and live.tracker.filter is not None:
        solver |= {"steps": live.tracker.steps, "touched": live.tracker.touched}
        solver |= {"latency": live.newest - live.tracker.time, **live.tracker.problems}
        state, covariance = live.tracker.filter.state
        std = np.sqrt(np.diag(covariance))
        motion: dict[str, object] = {}
        for name, value, spread in zip(_MOTION, state, std, strict=False):
            motion[name], motion[f"{name}_std"] = float(value), float(spread)
        statuses.append(status_message("motion", motion))
    statuses += change_status(live)
    if live.durations:
        solver["update_ms_p99"] = 1e3 * float(np.percentile(live.durations, 99.0))
    return [*statuses, status_message("solver", solver)]


def change_status(live: LiveProperties) -> list[DiagnosticStatus]:
    """Whether the object slides unlike what is known of it, with the rate of false alarms."""
    if live.tracker is None:
        return []
    now, changed = live.monitor.change, live.changed
    values: dict[str, object] = {
        "watching": live.monitor.watches,
        "statistic": 0.0 if now is None else now.statistic,
        "threshold": live.monitor.threshold,
        "false_alarms_per_hour": live.monitor.config.false_alarms_per_hour,
        "changes": live.changes,
    }
    if changed is None:
        return [status_message("change", values, DiagnosticStatus.OK, "slides as it is known to")]
    values |= {"since": changed.since, "statistic_then": changed.statistic}
    values |= {"force_x": changed.force[0], "force_y": changed.force[1]}
    values["friction_share"] = changed.friction
    return [status_message("change", values, DiagnosticStatus.WARN, changed.text)]


_MOTION = ("x", "y", "yaw", "v_x", "v_y", "yaw_rate")
