"""What the demo leaves: the offline estimate beside the live one and the truth, and the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.cli.demo_monitor import NAMES
from tactile_dynamics_ros.cli.text_table import align_rows
from tactile_dynamics_ros.core.inertia.batch import fit_recording
from tactile_dynamics_ros.core.inertia.estimate import InertialEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.estimate_report import write_estimate_report
from tactile_dynamics_ros.report.history import EstimateHistory

Array = NDArray[np.float64]


def summarise_demo(
    out: Path,
    history: EstimateHistory,
    truth: dict[str, Any],
    hidden: str,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Estimate from the recording, print live, offline and truth, write the report.

    Args:
        out: directory with `recording`.
        history: live estimates.
        truth: what /robot_sim/reveal said.
        hidden: the hidden effect that was asked for, or "none".
        say: prints a line for people.

    Returns:
        A document for --json.
    """
    recording = Recording.from_bag(out / "recording")
    model = fit_recording(recording.streams)
    offline = model.to_estimate()
    body = InertialParameters(truth["mass"], np.array(truth["com"]), np.array(truth["inertia_com"]))
    say(_comparison(history, offline, body))
    effect = truth["hidden_effect"]
    if hidden != "none":
        say(f"hidden effect: {effect['name']}, {effect['parameters']}")
    report = write_estimate_report(recording, model, out, history, body)
    live = history.value[-1].tolist() if len(history.time) else None
    return {
        "recording": str(out / "recording"),
        "report": str(report),
        "live": {"value": live, "std": history.std[-1].tolist() if live else None},
        "offline": offline.to_json(),
        "truth": truth,
        "error": _errors(offline, body),
    }


def _values(body: InertialParameters) -> Array:
    """Mass, centre of mass and inertia about it, (10,) in the order of NAMES."""
    tensor = body.inertia_com
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    return np.array([body.mass, *body.com, *tensor[rows, columns]])


def _errors(estimate: InertialEstimate, truth: InertialParameters) -> dict[str, float]:
    mass = abs(estimate.inertia.mass - truth.mass) / truth.mass
    return {
        "mass_percent": 100.0 * float(mass),
        "com_mm": 1e3 * float(np.linalg.norm(estimate.inertia.com - truth.com)),
    }


def _comparison(
    history: EstimateHistory, offline: InertialEstimate, truth: InertialParameters
) -> str:
    """Return a table of live estimate, offline estimate and truth."""
    rows = [("", "live", "std", "offline", "std", "truth", "unit")]
    missing = np.full(len(NAMES), np.nan)
    live, live_std = (
        (history.value[-1], history.std[-1]) if len(history.time) else (missing, missing)
    )
    columns = (live, live_std, _values(offline.inertia), offline.parameter_std, _values(truth))
    for k, (_, label, scale, unit) in enumerate(NAMES):
        rows.append((label, *(f"{scale * column[k]:.2f}" for column in columns), unit))
    return align_rows(rows)
