"""An estimate of a pushed object as people, programs and notebooks take it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.questions import Question, question_pushed
from tactile_dynamics_ros.api.result import ReportedResult, Rows
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)
from tactile_dynamics_ros.core.planar.properties.estimate import NO_FORCE, PushedEstimate
from tactile_dynamics_ros.report.numbers import with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from tactile_dynamics_ros.core.planar.known import KnownPushed
    from tactile_dynamics_ros.core.planar.linked.description import LinkedEstimate, PlacedJoint
    from tactile_dynamics_ros.core.planar.properties.linked_fit import PairFit
    from tactile_dynamics_ros.core.planar.properties.push_model import PushFit
    from tactile_dynamics_ros.recording.pushed import PushedRecording

_SHOWN = {
    "friction_force_n": ("friction force", 1.0, "N"),
    "mass": ("mass", 1.0, "kg"),
    "friction": ("friction", 1.0, ""),
    "com_x": ("com_x", 1e3, "mm"),
    "com_y": ("com_y", 1e3, "mm"),
    "friction_radius_m": ("friction radius", 1e3, "mm"),
    "inertia_zz": ("inertia_zz", 1e6, "kg mm²"),
}
"""Words, factor and unit of each number of a part in tables; fixed by what an estimate has."""


@dataclass(frozen=True, repr=False)
class EstimateOfPushes(ReportedResult):
    """Friction, mass and centre of mass of a pushed object of one or two parts.

    Attributes:
        recording: what was measured.
        found: values with their uncertainty, together with what was known; the error is that of
            `question`.
        question: the model held against the recording, as `compare` and `diagnose` do it; None
            where there is no model to hold against it, as with sparse poses.
        prior: the same object, from earlier recordings.
        changed: what differs from those beyond chance: the object or the table is another one.
    """

    recording: PushedRecording
    found: PushedEstimate | LinkedEstimate
    question: Question | None = None
    prior: KnownPushed | None = None
    changed: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        recording: PushedRecording,
        effects: Sequence[str] = (),
        prior: KnownPushed | None = None,
    ) -> EstimateOfPushes:
        """Estimate.

        Raises:
            BadInputError: an effect is unknown, or nothing is touched while poses are known.
            NotIdentifiableError: the object slides too little, the fit does not come to an end, or
                there is a prior of an object of two parts.
        """
        from tactile_dynamics_ros.core.planar.memory.combination import with_memory
        from tactile_dynamics_ros.core.planar.properties import estimate as properties

        found, fit = properties.estimate_with_fit(recording, effects)
        question = None if fit is None else _question(recording, effects, fit)
        if question is not None:
            found = replace(found, error=question.whitened_rms)
        if prior is None:
            return cls(recording, found, question)
        combined, changed = with_memory(_of_one_part(found), prior)
        return cls(recording, combined, question, prior, tuple(changed))

    @property
    def fits(self) -> bool:
        """Whether nothing is found against the model, as `compare` judges it."""
        return self.question is None or self.question.fits

    @property
    def misfit(self) -> str:
        """What to do about a model that is not clearly adequate, in a sentence; else empty."""
        return "" if self.question is None else self.question.misfit

    @property
    def is_far(self) -> bool:
        """Whether the model fits so badly that its numbers are no answer."""
        return self.question is not None and self.question.is_far

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """A sentence on what was known before."""
        if self.prior is None:
            return ()
        if not self.changed:
            return (f"together with {self.prior.recordings} recordings of {self.prior.name}",)
        return (
            f"{' and '.join(self.changed)} differ from {self.prior.name} beyond chance: object or "
            "table are others, or the frame lies otherwise; this recording alone counts",
        )

    @property
    def undetermined(self) -> tuple[str, ...]:
        """What this recording does not determine; value and std of it are those of the prior."""
        return self.found.undetermined

    def to_json(self) -> dict[str, Any]:
        """Return the document of `estimate`."""
        document = self.found.to_document()
        if self.prior is None:
            return document
        known = {"name": self.prior.name, "recordings": self.prior.recordings}
        return {**document, "prior": {**known, "changed": list(self.changed)}}

    def lines(self) -> list[str]:
        """Return the estimate for people."""
        return [*self.found.lines(self.fits), *filter(None, [self.misfit])]

    def headline(self) -> str:
        """Return how well the model fits, and whether the numbers are an answer."""
        try:
            self.require_answer()
        except NotIdentifiableError as reason:
            return f"{self.recording.source}: {reason}"
        error = self.found.error
        fits = "" if error is None else f": error {error:.2f} times the stated sensor noise"
        return f"{self.recording.source}{fits}"

    def rows(self) -> Rows:
        """Return name, value, standard deviation and unit of every number of each part."""
        return [("", "value", "± std", "unit"), *self.body_rows(), *self._effect_rows()]

    def body_rows(self) -> Rows:
        """Return the rows of each part and of a joint, without a head and without effects."""
        if isinstance(self.found, PushedEstimate):
            return self._part_rows(self.found.values, "")
        parts = [
            self._part_rows(link, f"link_{k}.") for k, link in enumerate(self.found.links, start=1)
        ]
        return [row for part in parts for row in part] + _joint_rows(self.found.joint)

    def _part_rows(self, values: Mapping[str, tuple[float, float]], of: str) -> Rows:
        rows: Rows = []
        for name, (words, factor, unit) in _SHOWN.items():
            if name not in values:  # no force was measured
                continue
            told = of + ("com" if name.startswith("com_") else name)
            star = " *" if told in self.undetermined else ""
            numbers = with_uncertainty(*(factor * number for number in values[name]))
            rows.append((f"{of}{words}{star}", *numbers, unit))
        return rows

    def _effect_rows(self) -> Rows:
        return [
            (f"{effect} {name}", *with_uncertainty(entry["value"], entry["std"]), entry["unit"])
            for effect, parameters in self.found.effects.items()
            for name, entry in parameters.items()
        ]

    def draw(self) -> Figure:
        """Draw the pushes from above, with the centre of mass where there is one part."""
        from tactile_dynamics_ros.report.pushes import draw_pushes

        return draw_pushes(self.recording.streams, self._centre())

    def _centre(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        if not isinstance(self.found, PushedEstimate):
            return None
        return self.found.values["com_x"], self.found.values["com_y"]

    def report(self, folder: Path, command: str = "") -> Path:
        """Write folder/report.html with all figures and return its path."""
        from tactile_dynamics_ros.report.pushes import write_pushes

        try:
            self.require_answer()
            good = not self.undetermined
        except NotIdentifiableError:
            good = False
        source, streams = self.recording.source, self.recording.streams
        command = command or f"tactile-dynamics estimate {source} --out {folder}"
        page = self.headline(), good, source, command
        return write_pushes(streams, self._centre(), page, self.lines(), self.rows(), Path(folder))

    def require_answer(self) -> None:
        """Check that the numbers are an answer.

        Raises:
            NotIdentifiableError: the error is far above the noise, or not even the friction force
                is known.
        """
        unknown = not self.found.is_answer
        if not self.recording.streams.feels:
            raise NotIdentifiableError(NO_FORCE)
        if self.is_far or (unknown and not self.fits):
            raise NotIdentifiableError(self.misfit)
        if unknown:
            raise NotIdentifiableError(
                "the friction force is undetermined; `tactile-dynamics check` says which pushes "
                "would determine it"
            )

    def save(self, path: str | Path) -> Path:
        """Write what is known of the object, for `prior` of later estimates.

        Raises:
            BadInputError: another file is there, or the file of another object.
            NotIdentifiableError: the numbers are no answer, or those of two parts.
        """
        from tactile_dynamics_ros.core.planar.memory.combination import known_of
        from tactile_dynamics_ros.recording.pushed.known_files import write_known

        self.require_answer()
        if self.changed and self.prior and Path(self.prior.name) == Path(path):
            raise BadInputError(
                f"{path} is the file of another object or table: {' and '.join(self.changed)} "
                "differ; choose another path"
            )
        alone = self.prior is None or self.changed
        count = 1 if alone or self.prior is None else self.prior.recordings + 1
        return write_known(known_of(_of_one_part(self.found), self.recording.source, count), path)


def _joint_rows(joint: PlacedJoint | None) -> Rows:
    """Return the rows of a joint: where it lies in the first part's frame, and its friction."""
    if joint is None:
        return []
    rows: Rows = [
        (f"joint {axis}", *with_uncertainty(1e3 * float(value), 1e3 * float(std)), "mm")
        for axis, value, std in zip("xy", joint.position, joint.std, strict=True)
    ]
    if joint.friction_torque is not None:
        rows.append(("joint friction", *with_uncertainty(*joint.friction_torque), "N m"))
    return rows


def _question(
    recording: PushedRecording, effects: Sequence[str], fit: PushFit | PairFit
) -> Question | None:
    """Return the model of a fit as a question; None where the recording cannot judge a model."""
    try:
        return question_pushed(recording, effects, fit)
    except TactileDynamicsError:
        return None


def _of_one_part(found: PushedEstimate | LinkedEstimate) -> PushedEstimate:
    """Return an estimate of one part.

    Raises:
        NotIdentifiableError: it is one of two.
    """
    if not isinstance(found, PushedEstimate):
        raise NotIdentifiableError("prior, save: for objects of one part")
    return found
