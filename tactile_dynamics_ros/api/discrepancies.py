"""Answers of compare, diagnose and explain as people, programs and notebooks take them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.properties import (
    Properties,
    before_and_after,
    properties_of,
    sentence_of,
)
from tactile_dynamics_ros.api.questions import Question
from tactile_dynamics_ros.api.result import ReportedResult, Rows, align_rows
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.verdict.wording import join_names, write_p_value
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.progress import tell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.core.discrepancy.explanation import Explanation as CoreExplanation
    from tactile_dynamics_ros.report.discrepancy_report import DiscrepancyFindings
    from tactile_dynamics_ros.report.page import Section


_SHOWN = 5
"""Candidates in the lines of a diagnosis; the document has all. What ranks lower has never been the
hidden effect of a benchmark."""
_STARRED = "* undetermined by this recording; value and std depend on what was presumed beforehand"
"""What a star in the table of the object means."""


@dataclass(frozen=True, repr=False)
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
        comparison = question.comparison
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
        sizes = [
            f"{error[key]:.3g} {unit}"
            for key, unit in (("force_rms_n", "N"), ("torque_rms_nm", "N m"))
            if error[key] is not None
        ]
        said = "adequate" if self.adequate else "not adequate"
        return [
            f"error: {error['whitened_rms']:.2f} times the stated sensor noise (whitened RMS), "
            + ", ".join(sizes),
            f"the model is {said} ({_why(self.document)})",
            *(
                f"  {place['channel']}: {100.0 * place['share_of_error']:.0f} % of its error "
                f"occurs {place['condition']}"
                for place in self.document["fails_where"]
            ),
            *self._independent_lines(),
        ]

    def _independent_lines(self) -> list[str]:
        """Return a line where the error depends on nothing that was going on."""
        if self.adequate or self.document["fails_where"] or not self.answer.compared:
            return []
        return [f"  the error does not depend on {join_names(self.answer.compared)}"]

    def rows(self) -> Rows:
        """Return the error of every channel in units of the noise."""
        channels = self.document["error"]["channels"].items()
        return [("channel", "error / noise"), *((name, f"{rms:.2f}") for name, rms in channels)]

    def error_over_time(self) -> tuple[Array, Array]:
        """Return times in s and the error of all channels, averaged over half a second."""
        from tactile_dynamics_ros.report.estimates import running_mean

        residuals = self.answer.residuals
        square = np.mean(residuals.white**2, axis=1, keepdims=True)
        return residuals.time, np.sqrt(running_mean(residuals.time, square)[:, 0])

    def regime_spans(self) -> list[tuple[float, float]]:
        """Return starts and ends in s of the regime in which the error is larger; none if empty."""
        from tactile_dynamics_ros.core.discrepancy.regimes.finding import RegimeFinding

        if self.answer.regime is None:
            return []
        gate, conditions = self.answer.regime.gate, self.question.model.conditions()
        condition = next(one for one in conditions if one.symbol == gate.symbol)
        found = RegimeFinding(condition, gate, np.nan, np.nan)
        return found.spans(self.answer.residuals.time)

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

    def learn(self, path: str | Path) -> Diagnosis:
        """Learn the law of what no known effect explains; with it, write a file of effects.

        Args:
            path: of the file, for `effects` of other verbs; written only if a law is learnt.

        Returns:
            The diagnosis with the law in its document (`law`, or `nothing_learnt`, the reason).

        Raises:
            BadInputError: no laws are known of such recordings, or the name is no effect's.
        """
        from tactile_dynamics_ros.core.discrepancy.laws.documents import learn_file

        return replace(self, document=self.document | learn_file(self.answer, Path(path)))

    def lines(self) -> list[str]:
        """Return the finding, the law if one was looked for, and the best candidates."""
        error = self.document["error"]
        lines = [
            self.document["sentence"],
            f"held-out error {error['before']:.3f} -> {error['after']:.3f}, "
            f"noise floor {error['noise_floor']:.3f}",
        ]
        if law := self.document.get("law"):
            lines += [law["sentence"], f"written: {law['file']}"]
        elif "law" in self.document:
            lines += [f"No law is learnt: {self.document['nothing_learnt']}."]
        if self.verdict in ("adequate", "convention"):
            return lines
        return [
            *lines,
            "candidates, best first (error expected before refitting):",
            *(
                f"  {c['name']:<18} {c['predicted_whitened_rms']:.3f}  "
                f"{write_p_value(c['p_value'])}"
                for c in self.document["candidates"][:_SHOWN]
            ),
        ]

    def rows(self) -> Rows:
        """Return the best candidates with the error that is expected with each of them."""
        body = [
            (
                c["name"],
                f"{c['predicted_whitened_rms']:.3f}",
                write_p_value(c["p_value"]).removeprefix("p = "),
            )
            for c in self.document["candidates"][:_SHOWN]
        ]
        return [("candidate", "error / noise", "p"), *body]

    def draw(self) -> Figure:
        """Draw how far each candidate would lower the error; without any, the error over time."""
        from tactile_dynamics_ros.report import discrepancies

        found, error = self.findings, self.document["error"]
        if not self.document["candidates"]:
            white = self.answer.model.residuals().white
            return discrepancies.draw_error_over_time(found.time, white, found.groups)
        named = [self.effect or "", *self.document["group"]]
        return discrepancies.draw_candidates(
            self.document["candidates"], error["before"], error["noise_floor"], named
        )

    def _find(self) -> DiscrepancyFindings:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_diagnosis

        return findings_of_diagnosis(self.question.source, self.document, self.answer)


@dataclass(frozen=True, repr=False)
class Explanation(Discrepancy):
    """Missing effects added one by one, and how the error falls.

    Attributes:
        known: what the object is before and, if effects were added, after; empty where the
            recording cannot be read in one way, or the numbers cannot be estimated.
    """

    known: tuple[Properties, ...] = ()

    @classmethod
    def of(cls, question: Question) -> Explanation:
        """Explain."""
        from tactile_dynamics_ros.core.discrepancy.documents import explanation_document
        from tactile_dynamics_ros.core.discrepancy.explanation import explain

        answer, notes = question.answer(explain)
        known, doubts = _properties(question, answer)
        document = explanation_document(answer) | {
            "estimate": {
                "before": known[0].document if known else None,
                "after": known[1].document if len(known) > 1 else None,
            }
        }
        return cls(question, answer, document, (*notes, *doubts), known)

    def properties(self) -> Rows:
        """Return each number of the object before and after the effects; empty if none is known."""
        if not self.known:
            return []
        return before_and_after(self._alone, self.effects, self.known)

    @cached_property
    def _alone(self) -> str:
        return str(self.question.model.residuals().alone)

    @property
    def verdict(self) -> str:
        """The verdict on the model with all effects that were added."""
        return str(self.document["verdict"])

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that were added."""
        return tuple(self.document["effects"])

    def lines(self) -> list[str]:
        """Return the steps, the noise floor, the finding, and what the object is."""
        floor = self.document["error"]["noise_floor"]
        return [
            *(
                f"  {step['added'] or self._alone:<22} error {step['error']:.3f}"
                for step in self.document["steps"]
            ),
            f"  {'noise floor':<22} error {floor:.3f}",
            self.document["sentence"],
            *self._property_lines(),
        ]

    def _property_lines(self) -> list[str]:
        """Return what the object is, before and after."""
        rows = self.properties()
        if not rows:
            return []
        starred = any(cell.endswith(" *") for row in rows for cell in row)
        return [
            *filter(None, [sentence_of(rows), self.known[-1].remark]),
            *align_rows(rows).splitlines(),
            *[_STARRED] * starred,
        ]

    def rows(self) -> Rows:
        """Return what was added and the error with it."""
        steps = self.document["steps"]
        body = [(step["added"] or self._alone, f"{step['error']:.3f}") for step in steps]
        return [("added", "error / noise"), *body]

    def draw(self) -> Figure:
        """Draw how the error falls, step by step."""
        from tactile_dynamics_ros.report.discrepancies import draw_error_steps

        floor = self.document["error"]["noise_floor"]
        return draw_error_steps(self.document["steps"], floor, self.findings.alone)

    def _find(self) -> DiscrepancyFindings:
        from tactile_dynamics_ros.report.discrepancy_findings import findings_of_explanation

        findings = findings_of_explanation(self.question.source, self.document, self.answer)
        return replace(findings, extra=self._section())

    def _section(self) -> list[Section]:
        """Return what the object is, before and after, for the report."""
        from tactile_dynamics_ros.report.page import Section

        rows = self.properties()
        if not rows:
            return []
        told = f"Values ± one standard deviation, as `estimate` gives them. {_STARRED}."
        sentences = [*filter(None, [sentence_of(rows), self.known[-1].remark]), told]
        return [Section("What the object is", sentences, (), rows[0], rows[1:])]


def _properties(
    question: Question, answer: CoreExplanation
) -> tuple[tuple[Properties, ...], list[str]]:
    """Return what the object is before and after, and a sentence on what cannot be estimated."""
    if answer.in_turn:
        return (), []
    models = [answer.first.model, *([answer.model] if answer.effects else [])]
    groups = {step.name: step.group for step in answer.steps}
    known: list[Properties] = []
    for model in models:
        tell("estimating the object" + " with the effects" * len(known))
        try:
            known.append(properties_of(question, model, answer.conventions, groups))
        except TactileDynamicsError as error:
            return tuple(known), [f"what the object is cannot be estimated: {error}"]
    return tuple(known), []


def _why(document: dict[str, Any]) -> str:
    p_value = write_p_value(document["p_value"])
    if document.get("trace"):
        return f"{p_value}, but what is significant {document['trace']['reason']}"
    if document["adequate"] and not document["white"]:
        return f"{p_value}, but within the uncertainty that the sensors report"
    return p_value
