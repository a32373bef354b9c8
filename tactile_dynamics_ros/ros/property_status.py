"""What is known of a pushed object as statuses for people and programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.filter.summary import Properties, vague_effects
from tactile_dynamics_ros.ros.diagnostics import effect_status, status_message
from tactile_dynamics_ros.ros.object_state import ObjectState


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
