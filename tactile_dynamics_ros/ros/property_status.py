"""What is known of a pushed object as statuses for people and programs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.filter.summary import Properties, vague_effects
from tactile_dynamics_ros.ros.diagnostics import status_message


def property_status(known: Properties, live: LiveProperties) -> Sequence[DiagnosticStatus]:
    """Return the statuses: properties with their std, what predicts poses, how they came about.

    Args:
        known: of link_1.
        live: whose counts are told.
    """
    level = DiagnosticStatus.WARN if known.doubtful else DiagnosticStatus.OK
    link: dict[str, object] = {}
    for name, (value, std) in known.values.items():
        link[name], link[f"{name}_std"] = value, std
    link["undetermined"] = ",".join(known.undetermined)
    solver: dict[str, object] = {
        "model": live.config.model,
        "effects": ",".join(live.effects),
        "source": known.source,
        "fits": live.fits,
        "refused": live.refused,
    }
    if live.fit is not None:
        solver |= {"samples": live.fit.samples, "whitened_rms": live.fit.error}
        if live.fit.error_without is not None:
            solver["without_effects"] = live.fit.error_without
            solver["vague"] = ",".join(vague_effects(live.fit))
    statuses = [status_message("link_1", link, level, known.text)]
    for name, found in (live.fit.effects if live.fit is not None else {}).items():
        entries = {
            key if kind == "value" else f"{key}_{kind}": told
            for key, entry in found.items()
            for kind, told in entry.items()
        }
        statuses.append(status_message(f"effect {name}", entries))
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
