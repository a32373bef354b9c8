"""The report of a comparison, a diagnosis or an explanation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.documents import group_clause
from tactile_dynamics_ros.core.discrepancy.verdict.wording import (
    capitalise,
    write_fall,
    write_p_value,
)
from tactile_dynamics_ros.report.discrepancies import (
    Channels,
    draw_before_after,
    draw_candidates,
    draw_channels,
    draw_error_by_condition,
    draw_error_over_time,
    draw_error_steps,
    draw_fails_where,
    draw_spectrum,
    group_channels,
)
from tactile_dynamics_ros.report.page import Page, Picture, Section, write_page
from tactile_dynamics_ros.report.style import house_style

_MOST_ROWS = 10
"""Rows of the table of candidates: as many as the figure beside it shows."""
_DENSE = 0.1
"""Time between samples, s, below which means over half a second are worth a sentence: they then
hold five samples or more. Slips of a probe are seconds apart."""
_PROPERTIES = {
    "channels": "the error is in",
    "frequency_hz": "oscillates at, Hz",
    "correlates_with": "correlates with",
    "formula": "looks like",
    "frame": "simplest in the frame of",
    "share_of_excess": "share of the excess error that this explains",
    "intervals": "bursts, s",
    "change": "begins or ends",
}
"""Properties of a signature in words."""


@dataclass(frozen=True)
class DiscrepancyFindings:
    """What a report can show; everything but source, verdict and residual may be absent.

    Attributes:
        source: the recording.
        verdict: the finding in one plain sentence.
        good: whether the model explains the recording in the end.
        time: (N,) s.
        before: (N, D) measured minus predicted without the added effects.
        channels: D names.
        units: D units.
        frame: name of the frame that the channels are in; empty for none.
        alone: what the model without effects is called.
        about: what the model predicts from what, in a sentence.
        after: the same with the added effects.
        added: names of the added effects.
        comparison: the document of `compare`; `channels` may map channel names to whitened RMS.
        diagnosis: the document of `diagnose`.
        explanation: the document of `explain`.
        white: (N, D) whitened residual of the compared model.
        conditions: (N,) what was going on, by label such as "speed in m/s".
        intervals: starts and ends in s of spans in which the model fails.
        regimes: starts and ends in s of spans in which an added effect acts that does not always.
        frequency: (K,) Hz of `power`.
        power: (K,) spectral density of the unexplained part by channel.
        extra: further sections, after how the error falls.
    """

    source: str
    verdict: str
    good: bool
    time: Array
    before: Array
    channels: Sequence[str]
    units: Sequence[str]
    frame: str = ""
    alone: str = "the model alone"
    about: str = ""
    after: Array | None = None
    added: Sequence[str] = ()
    comparison: Mapping[str, Any] = field(default_factory=dict)
    diagnosis: Mapping[str, Any] = field(default_factory=dict)
    explanation: Mapping[str, Any] = field(default_factory=dict)
    white: Array | None = None
    conditions: Mapping[str, Array] = field(default_factory=dict)
    intervals: Sequence[tuple[float, float]] = ()
    regimes: Sequence[tuple[float, float]] = ()
    frequency: Array | None = None
    power: Mapping[str, Array] = field(default_factory=dict)
    extra: Sequence[Section] = ()

    @property
    def groups(self) -> list[Channels]:
        """Channels that are drawn together."""
        return group_channels(self.channels, self.units)


def write_discrepancy_report(
    findings: DiscrepancyFindings, folder: Path, command: str = ""
) -> Path:
    """Write the report of a comparison, a diagnosis or an explanation.

    Args:
        findings: what to show.
        folder: where report.html and the figures go.
        command: how to make the page again.

    Returns:
        The path of report.html.
    """
    with house_style():
        sections = [
            *_steps(findings),
            *findings.extra,
            _residual(findings),
            *_candidates(findings),
            *_places(findings),
            *_unexplained(findings),
            *_effects(findings),
        ]
        page = Page(
            title="Where the model fails, and what is missing",
            verdict=findings.verdict,
            good=findings.good,
            source=findings.source,
            command=command or f"tactile-dynamics explain {findings.source} --out {folder}",
            sentences=[
                f"{findings.about} Below, its error is measured in units of the noise that the "
                "sensors state: at 1 nothing but that noise is left; above 1 something acts that "
                "the model misses.".strip()
            ],
            sections=sections,
        )
        return write_page(page, folder)


def _steps(findings: DiscrepancyFindings) -> list[Section]:
    """Return how the error changes, step by step."""
    steps = list(findings.explanation.get("steps", ()))
    if not steps:
        return []
    error = dict(findings.explanation.get("error", {}))
    before, after = steps[0]["error"], steps[-1]["error"]
    floor = float(error.get("noise_floor", 1.0))
    picture = Picture(
        "steps",
        draw_error_steps(steps, floor, findings.alone),
        f"error that {write_fall(before, after)} in {len(steps) - 1} steps",
        "Each bar adds one effect to the model and fits everything anew. Errors are on parts of "
        "the recording that were not used for fitting.",
    )
    error_does = write_fall(before, after) if len(steps) > 1 else f"is {before:.2f}"
    sentence = f"The error {error_does}; noise alone leaves {floor:.2f}."
    return [Section("The error, step by step", [sentence], [picture])]


def _residual(findings: DiscrepancyFindings) -> Section:
    """Return the residual before and after."""
    axes = f", in the {findings.frame} frame" if findings.frame else ""
    means = (
        "Strong lines are means over half a second: where they leave zero, the model is wrong "
        "systematically."
        if np.median(np.diff(findings.time)) < _DENSE
        else ""
    )
    shaded = " Shaded where the regime of the added effect holds." if findings.regimes else ""
    pictures = [
        Picture(
            "residuals",
            draw_before_after(
                findings.time,
                findings.before,
                findings.after,
                findings.groups,
                (findings.alone, f"with {', '.join(findings.added)}"),
                findings.regimes,
            ),
            f"unexplained {' and '.join(g.name for g in findings.groups)} over time, "
            "before and after",
            f"Measured minus predicted{axes}. {means}{shaded}",
        )
    ]
    channels = findings.comparison.get("channels") or {}
    if channels:
        pictures.append(
            Picture(
                "channels",
                draw_channels(channels),
                "error of each channel in units of the noise",
                "Error of the model that was compared, by channel.",
            )
        )
    return Section("What is left over", (), pictures)


def _candidates(findings: DiscrepancyFindings) -> list[Section]:
    """Return the ranking of candidates."""
    candidates = list(findings.diagnosis.get("candidates", ()))
    if not candidates:
        return []
    error = dict(findings.diagnosis.get("error", {}))
    named = findings.diagnosis.get("effect")
    group = list(findings.diagnosis.get("group") or ())
    chosen = [named, *group] if named else group
    picture = Picture(
        "candidates",
        draw_candidates(
            candidates,
            float(error.get("before", candidates[-1]["predicted_whitened_rms"])),
            float(error.get("noise_floor", 1.0)),
            chosen,
        ),
        f"expected error with each candidate; best: {candidates[0]['name']}",
        "How far each effect is expected to lower the error, tested before any refitting. "
        "Orange: what the verdict names.",
    )
    rows = [_candidate_row(c) for c in candidates[:_MOST_ROWS]]
    header = ["effect", "expected error", "p", "expected parameters"]
    sentences = _group_sentence(findings.diagnosis)
    return [Section("Which effect would explain it", sentences, [picture], header, rows)]


def _candidate_row(candidate: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of one candidate."""
    parameters = dict(candidate.get("parameters") or {})
    texts = [f"{name} = {_value_text(value)}" for name, value in parameters.items()]
    return (
        str(candidate["name"]),
        f"{float(candidate['predicted_whitened_rms']):.3f}",
        write_p_value(float(candidate["p_value"])).removeprefix("p = "),
        candidate.get("remark") or ", ".join(texts[:4]) + (", ..." if len(texts) > 4 else ""),
    )


def _value_text(value: Any) -> str:
    """Return a parameter that is a number or has value, std and unit."""
    if isinstance(value, Mapping):
        std = f" ± {float(value['std']):.2g}" if value.get("std") is not None else ""
        return f"{float(value['value']):.3g}{std} {value.get('unit', '')}".strip()
    return f"{float(value):.3g}"


def _group_sentence(diagnosis: Mapping[str, Any]) -> list[str]:
    """Return what a group of effects that may be the cause means."""
    clause = group_clause(
        str(diagnosis.get("verdict")),
        list(diagnosis.get("group") or ()),
        diagnosis.get("separating_motion"),
    )
    return [f"{capitalise(clause)}."] if clause else []


def _places(findings: DiscrepancyFindings) -> list[Section]:
    """Return where the model fails."""
    places = list(findings.comparison.get("fails_where", ()))
    sentences, pictures = [], []
    if places:
        worst = places[0]
        sentences.append(
            f"{100 * float(worst['share_of_error']):.0f} % of the error of {worst['channel']} "
            f"occurs {worst['condition']}."
        )
        pictures.append(
            Picture(
                "fails_where",
                draw_fails_where(places),
                "conditions with the largest share of the error",
                "Share of a channel's error that occurs then.",
            )
        )
    if findings.white is not None:
        pictures.append(
            Picture(
                "over_time",
                draw_error_over_time(
                    findings.time,
                    findings.white,
                    findings.groups,
                    findings.regimes or findings.intervals,
                ),
                "error over time in units of the noise",
                _over_time(findings),
            )
        )
        if findings.conditions:
            pictures.append(
                Picture(
                    "by_condition",
                    draw_error_by_condition(findings.white, findings.groups, findings.conditions),
                    "error by condition in units of the noise",
                    "Error against what was going on; a slope points at the cause. Each point "
                    "holds a tenth of the recording.",
                )
            )
    return [Section("Where it fails", sentences, pictures)] if pictures else []


def _over_time(findings: DiscrepancyFindings) -> str:
    """Return what the shading of the error over time means."""
    if findings.regimes:
        return "Error over time; shaded where the regime of the added effect holds."
    if findings.intervals:
        return "Error over time; shaded where the model fails most."
    return "Error over time."


def _unexplained(findings: DiscrepancyFindings) -> list[Section]:
    """Return the signature of what no effect of the catalogue explains."""
    signature = findings.diagnosis.get("unexplained")
    if not signature:
        return []
    rows = [
        (_PROPERTIES.get(key, key), _signature_text(value))
        for key, value in signature.items()
        if value
    ]
    pictures = []
    if findings.frequency is not None and findings.power:
        frequency_hz = signature.get("frequency_hz")
        peak = frequency_hz if isinstance(frequency_hz, int | float) else None
        pictures.append(
            Picture(
                "spectrum",
                draw_spectrum(findings.frequency, findings.power, peak),
                "spectrum of what is left over",
                "Power of the residual by frequency; noise alone is flat.",
            )
        )
    sentence = "No effect of the catalogue explains what is left. This is what it looks like:"
    return [Section("Not in the catalogue", [sentence], pictures, ["", ""], rows)]


def _signature_text(value: Any) -> str:
    """Return one property of a signature."""
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return ", ".join(f"{k}: {_signature_text(v)}" for k, v in value.items())
    if isinstance(value, Sequence):
        return ", ".join(_signature_text(v) for v in value)
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _effects(findings: DiscrepancyFindings) -> list[Section]:
    """Return the parameters of the effects that were added."""
    effects = findings.explanation.get("parameters") or findings.comparison.get("effects") or {}
    rows = [
        (f"{name} {parameter}", _value_text(value))
        for name, parameters in dict(effects).items()
        for parameter, value in dict(parameters).items()
    ]
    return [Section("Effects in the model", (), (), ["parameter", "value"], rows)] if rows else []
