"""Answers of compare, diagnose and explain as people, programs and notebooks take them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.questions import Question
from tactile_dynamics_ros.api.result import ReportedResult, Rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.report.discrepancy_report import DiscrepancyFindings

_SHOWN = 5
"""Candidates in the lines of a diagnosis; the document has all. What ranks lower has never been the
hidden effect of a benchmark."""


@dataclass(frozen=True)
class Discrepancy(ReportedResult):
    """An answer on how a model and a recording differ.

    Attributes:
        question: what was asked about.
        answer: comparison, diagnosis or explanation of the core.
        document: the same for programs.
        notes: sentences on what was not taken as it is recorded.
    """

    question: Question
    answer: Any
    document: dict[str, Any]
    notes: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the document that the verb prints."""
        return self.document

    def headline(self) -> str:
        """Return the finding in one sentence."""
        return self.findings.verdict

    @cached_property
    def findings(self) -> DiscrepancyFindings:
        """What the report shows."""
        return self._find()

    def _find(self) -> DiscrepancyFindings:
        raise NotImplementedError

    def report(self, folder: Path, command: str = "") -> Path:
        """Write folder/report.html with all figures and return its path."""
        from tactile_dynamics_ros.report.discrepancy_report import write_discrepancy_report

        return write_discrepancy_report(self.findings, Path(folder), command)


class Comparison(Discrepancy):
    """How far the model is from a recording, and where it fails."""

    @classmethod
    def of(cls, question: Question) -> Comparison:
        """Compare."""
        from tactile_dynamics_ros.core.discrepancy.comparison import compare

        comparison = compare(question.model)
        error = question.error() | {"channels": comparison.channel_rms}
        document = {"error": error} | comparison.to_json()
        return cls(question, comparison, document, tuple(question.notes(question.model)))

    @property
    def adequate(self) -> bool:
        """Whether the model explains the recording."""
        return bool(self.document["adequate"])

    def lines(self) -> list[str]:
        """Return error, verdict and where the model fails."""
        error = self.document["error"]
        torque = error["torque_rms_nm"]
        said = "adequate" if self.adequate else "not adequate"
        return [
            f"error: {error['whitened_rms']:.2f} times the stated sensor noise (whitened RMS), "
            f"{error['force_rms_n']:.3g} N" + ("" if torque is None else f", {torque:.3g} N m"),
            f"the model is {said} ({_why(self.document)})",
            *(
                f"  {place['channel']}: {100.0 * place['share_of_error']:.0f} % of its error "
                f"{place['condition']}"
                for place in self.document["fails_where"]
            ),
        ]

    def rows(self) -> Rows:
        """Return the error of every channel in units of the noise."""
        channels = self.document["error"]["channels"].items()
        return [("channel", "error / noise"), *((name, f"{rms:.2f}") for name, rms in channels)]

    def draw(self) -> Figure:
        """Draw when the model is wrong."""
        from tactile_dynamics_ros.report.discrepancies import draw_error_over_time

        found, white = self.findings, self.answer.residuals.white
        return draw_error_over_time(found.time, white, found.groups, found.intervals)

    def _find(self) -> DiscrepancyFindings:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_comparison

        return findings_of_comparison(self.question.source, self.document, self.answer)


class Diagnosis(Discrepancy):
    """Which effect is missing."""

    @classmethod
    def of(cls, question: Question) -> Diagnosis:
        """Diagnose."""
        from tactile_dynamics_ros.core.discrepancy.diagnosis import diagnose
        from tactile_dynamics_ros.core.discrepancy.documents import diagnosis_document

        answer, notes = question.answer(diagnose)
        return cls(question, answer, diagnosis_document(answer), notes)

    @property
    def verdict(self) -> str:
        """`adequate`, `missing_effect`, `ambiguous`, `convention` or `unexplained`."""
        return str(self.document["verdict"])

    @property
    def effect(self) -> str | None:
        """Name of the missing effect, if there is one."""
        name = self.document["effect"]
        return None if name is None else str(name)

    def lines(self) -> list[str]:
        """Return the finding and the best candidates."""
        error = self.document["error"]
        lines = [
            self.document["sentence"],
            f"held-out error {error['before']:.3f} -> {error['after']:.3f}, "
            f"noise floor {error['noise_floor']:.3f}",
        ]
        if self.verdict in ("adequate", "convention"):
            return lines
        return [
            *lines,
            "candidates, best first (error expected before refitting):",
            *(
                f"  {c['name']:<18} {c['predicted_whitened_rms']:.3f}  p = {c['p_value']:.2g}"
                for c in self.document["candidates"][:_SHOWN]
            ),
        ]

    def rows(self) -> Rows:
        """Return the best candidates with the error that is expected with each of them."""
        body = [
            (c["name"], f"{c['predicted_whitened_rms']:.3f}", f"{c['p_value']:.2g}")
            for c in self.document["candidates"][:_SHOWN]
        ]
        return [("candidate", "error / noise", "p"), *body]

    def draw(self) -> Figure:
        """Draw how far each candidate would lower the error; without any, the error over time."""
        from tactile_dynamics_ros.report import discrepancies

        found, error = self.findings, self.document["error"]
        if not self.document["candidates"] or found.white is None:
            return discrepancies.draw_error_over_time(found.time, found.white, found.groups)
        named = [self.effect or "", *self.document["group"]]
        return discrepancies.draw_candidates(
            self.document["candidates"], error["before"], error["noise_floor"], named
        )

    def _find(self) -> DiscrepancyFindings:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_diagnosis

        return findings_of_diagnosis(self.question.source, self.document, self.answer)


class Explanation(Discrepancy):
    """Missing effects added one by one, and how the error falls."""

    @classmethod
    def of(cls, question: Question) -> Explanation:
        """Explain."""
        from tactile_dynamics_ros.core.discrepancy.documents import explanation_document
        from tactile_dynamics_ros.core.discrepancy.explanation import explain

        answer, notes = question.answer(explain)
        return cls(question, answer, explanation_document(answer), notes)

    @property
    def verdict(self) -> str:
        """The verdict on the model with all effects that were added."""
        return str(self.document["verdict"])

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that were added."""
        return tuple(self.document["effects"])

    def lines(self) -> list[str]:
        """Return the steps, the noise floor and the finding."""
        alone = self.question.model.residuals().alone
        floor = self.document["error"]["noise_floor"]
        return [
            *(
                f"  {step['added'] or alone:<22} error {step['error']:.3f}"
                for step in self.document["steps"]
            ),
            f"  {'noise floor':<22} error {floor:.3f}",
            self.document["sentence"],
        ]

    def rows(self) -> Rows:
        """Return what was added and the error with it."""
        steps = self.document["steps"]
        alone = self.question.model.residuals().alone
        body = [(step["added"] or alone, f"{step['error']:.3f}") for step in steps]
        return [("added", "error / noise"), *body]

    def draw(self) -> Figure:
        """Draw how the error falls, step by step."""
        from tactile_dynamics_ros.report.discrepancies import draw_error_steps

        floor = self.document["error"]["noise_floor"]
        return draw_error_steps(self.document["steps"], floor, self.findings.alone)

    def _find(self) -> DiscrepancyFindings:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_explanation

        return findings_of_explanation(self.question.source, self.document, self.answer)


def _why(document: dict[str, Any]) -> str:
    p_value = f"p = {document['p_value']:.2g}"
    if document.get("trace"):
        return f"{p_value}, but it moves no estimate by half its standard deviation"
    if document["adequate"] and not document["white"]:
        return f"{p_value}, but within the uncertainty that the sensors report"
    return p_value
