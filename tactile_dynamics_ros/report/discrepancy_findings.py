"""Outcomes of comparison, diagnosis and explanation as what the report shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.discrepancy.comparison import Comparison, compare
from tactile_dynamics_ros.core.discrepancy.diagnosis import Diagnosis
from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document
from tactile_dynamics_ros.core.discrepancy.explanation import Explanation
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Convention, ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding
from tactile_dynamics_ros.core.discrepancy.structure import periodogram
from tactile_dynamics_ros.report.discrepancy_report import DiscrepancyFindings

_MOST_CONDITIONS = 6
"""Conditions against which the error is drawn, two rows of three."""


def findings_of_comparison(
    source: str, document: Mapping[str, Any], comparison: Comparison
) -> DiscrepancyFindings:
    """What the report of `compare` shows."""
    good = bool(document["adequate"])
    if document["white"]:
        verdict = "The model explains this recording down to the sensor noise."
    elif document.get("trace"):
        verdict = "What the model leaves beside sensor noise moves no estimate that matters."
    elif good:
        verdict = (
            "The model explains this recording to within the uncertainty that the sensors report."
        )
    else:
        verdict = "The model leaves more than sensor noise: see where it fails."
    residuals = comparison.residuals
    return DiscrepancyFindings(
        source=source,
        verdict=verdict,
        good=good,
        time=residuals.time,
        before=residuals.physical,
        comparison=document,
        **_circumstances(comparison),
    )


def findings_of_diagnosis(
    source: str, document: Mapping[str, Any], diagnosis: Diagnosis
) -> DiscrepancyFindings:
    """What the report of `diagnose` shows."""
    if diagnosis.convention is not None:
        return _findings_of_convention(source, document, diagnosis, diagnosis.convention)
    after = diagnosis.explained_model if diagnosis.effect else None
    added = [diagnosis.effect] if diagnosis.effect else []
    return _findings(
        source, diagnosis, after, added, document["sentence"], document, {},
        regimes=[diagnosis.regime] if diagnosis.regime else [],
    )  # fmt: skip


def _findings_of_convention(
    source: str, document: Mapping[str, Any], diagnosis: Diagnosis, convention: Convention
) -> DiscrepancyFindings:
    """A recording as it was read and as it is read right, where their instants are the same."""
    alike = len(convention.model.residual) == len(diagnosis.model.residual)
    after, added = (convention.model, [f"read as {convention.name}"]) if alike else (None, [])
    return _findings(source, diagnosis, after, added, document["sentence"], document, {})


def findings_of_explanation(
    source: str, document: Mapping[str, Any], explanation: Explanation
) -> DiscrepancyFindings:
    """What the report of `explain` shows."""
    first = diagnosis_document(explanation.first)
    return _findings(
        source,
        explanation.first,
        explanation.model if explanation.effects else None,
        list(explanation.effects),
        document["sentence"],
        first | {"unexplained": document["unexplained"]},
        document,
        good=explanation.verdict == "adequate",
        regimes=list(explanation.regimes.values()),
    )


def _findings(
    source: str,
    found: Diagnosis,
    after: ResidualModel | None,
    added: list[str],
    verdict: str,
    diagnosis: Mapping[str, Any],
    explanation: Mapping[str, Any],
    good: bool | None = None,
    regimes: Sequence[RegimeFinding] = (),
) -> DiscrepancyFindings:
    comparison = compare(found.model, diagnosis=found)
    residuals = comparison.residuals
    spectrum = periodogram(residuals.time, residuals.white)
    return DiscrepancyFindings(
        source=source,
        verdict=verdict,
        good=diagnosis["verdict"] == "adequate" if good is None else good,
        time=residuals.time,
        before=residuals.physical,
        after=None if after is None else after.residuals().physical,
        added=added,
        comparison=comparison.to_json(),
        diagnosis=diagnosis,
        explanation=explanation,
        frequency=spectrum.hz,
        regimes=[span for regime in regimes for span in regime.spans(residuals.time)],
        power=dict(zip(residuals.channels, spectrum.power.T, strict=True)),
        **_circumstances(comparison),
    )


def _circumstances(comparison: Comparison) -> dict[str, Any]:
    """What the channels are, white residual, what was going on, and when the model fails."""
    residuals = comparison.residuals
    conditions = {
        f"{condition.name} in {condition.unit}" if condition.unit else condition.name: (
            condition.values
        )
        for condition in residuals.conditions
        if np.ptp(condition.values) > 0
    }
    return {
        "channels": residuals.channels,
        "units": residuals.units,
        "frame": residuals.frame,
        "alone": residuals.alone,
        "about": residuals.about,
        "white": residuals.white,
        "conditions": dict(list(conditions.items())[:_MOST_CONDITIONS]),
        "intervals": comparison.intervals,
    }
