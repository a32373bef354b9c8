"""An estimate of an arm by its joint torques as people, programs and notebooks take it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.questions import Question, question_joints
from tactile_dynamics_ros.api.result import ReportedResult, Rows, align_rows
from tactile_dynamics_ros.core.errors import NotIdentifiableError, refuse_existing
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.joints.conventions import in_common_units
from tactile_dynamics_ros.core.joints.estimate import NAMES, JointsEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
from tactile_dynamics_ros.recording.yaml_files import write_body
from tactile_dynamics_ros.report.numbers import UPPER, with_uncertainty

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.figure import Figure

    from tactile_dynamics_ros.recording.joints import JointRecording

_FACTORS = (1.0, *[1e3] * 3, *[1e6] * 6)
"""From SI to the units of tables, in the order of `NAMES`."""
_FAR_BESIDE = 2.5
"""Error over the noise from which a payload beside the empty arm is no answer either. Public
recordings of a real arm have 1.7 to 1.9 and masses within their intervals; of simulated pairs with
one hidden effect all up to 2.9 had, while a cable at 3.2 left a mass 2.3 std off, at 10 4.1 std."""
_UNITS = ("kg", *["mm"] * 3, *["kg mm²"] * 6)
"""These units."""


@dataclass(frozen=True, repr=False)
class EstimateOfJoints(ReportedResult):
    """Payload, friction of each joint, and effects, of an arm.

    Attributes:
        recording: what was measured.
        found: values with their uncertainty.
    """

    recording: JointRecording
    found: JointsEstimate

    @classmethod
    def of(
        cls,
        recording: JointRecording,
        effects: Sequence[str] = (),
        without: JointRecording | str | Path | None = None,
        known_load: float | None = None,
    ) -> EstimateOfJoints:
        """Estimate.

        Args:
            recording: with the payload, if any.
            effects: names, with readings.
            without: the same arm without the payload, or the path of that recording.
            known_load: mass of the payload, kg, if it was weighed.

        Raises:
            BadInputError: an effect is unknown, a path cannot be read, or the URDF is of another
                arm.
            NotIdentifiableError: a recording is too short.
        """
        from tactile_dynamics_ros.recording.joints import JointRecording

        empty = None
        if isinstance(without, JointRecording):
            empty = without
        elif without is not None:
            empty = JointRecording.read(without, known=recording.streams.urdf)
        if empty is not None:
            loaded, bare = in_common_units(recording.streams, empty.streams)
            recording, empty = replace(recording, streams=loaded), replace(empty, streams=bare)
        question = question_joints(recording, effects, empty, known_load)
        found = JointsEstimate(question.model, recording.streams, empty is not None)
        return cls(recording, found)

    @cached_property
    def question(self) -> Question:
        """The model held against the recording, as `compare` and `diagnose` do it."""
        error = {"whitened_rms": self.found.error}
        return Question(
            self.found.model, self.recording.source, lambda: error, recording=self.recording
        )

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What stood beside the recording, and what the URDF's bodies are worth."""
        share = f"{100.0 * self.found.model.basis.share:.0f} %"
        if self.found.compared:
            return ("the recording without the payload stands beside it",)
        return (
            f"links may be off the URDF by {share}; `--without EMPTY`, the same motion without the "
            "payload, tells it far better",
        )

    @property
    def undetermined(self) -> tuple[str, ...]:
        """What this recording does not tell."""
        return self.found.undetermined

    def to_json(self) -> dict[str, Any]:
        """Return the document of `estimate`."""
        return self.found.to_document()

    def lines(self) -> list[str]:
        """Return the estimate for people."""
        table = align_rows(
            [("", "value", "± std", "unit"), *self.body_rows(), *self._effect_rows()]
        )
        starred = ["* undetermined by this recording"] if self.undetermined else []
        fits = f"error {self.found.error:.2f} times the noise that the torques show"
        frame = f"payload in the frame of {self.found.payload.flange}"
        return [*table.splitlines(), *starred, frame, fits, *filter(None, [self.question.misfit])]

    def headline(self) -> str:
        """Return how well the model fits, and whether the numbers are an answer."""
        try:
            self.require_answer()
        except NotIdentifiableError as reason:
            return f"{self.recording.source}: {reason}"
        return f"{self.recording.source}: error {self.found.error:.2f} times the noise"

    def rows(self) -> Rows:
        """Return name, value, standard deviation and unit of every number."""
        return [("", "value", "± std", "unit"), *self.body_rows(), *self._effect_rows()]

    def body_rows(self) -> Rows:
        """Return the rows of payload and joints, without a head and without effects."""
        payload = self.found.payload
        body, std = payload.body, payload.std
        values = [body.mass, *body.com, *(body.inertia_com[i, j] for i, j in UPPER)]
        rows: Rows = []
        for name, value, one, factor, unit in zip(
            NAMES, values, std, _FACTORS, _UNITS, strict=True
        ):
            star = " *" if name in payload.undetermined else ""
            rows.append(
                (f"payload {name}{star}", *with_uncertainty(factor * value, factor * one), unit)
            )
        for joint in self.found.model.joints:
            star = " *" if joint in self.found.still else ""
            for kind, entry in self.found.table[joint].items():
                numbers = with_uncertainty(entry["value"], entry["std"])
                rows.append((f"{joint} {kind}{star}", *numbers, entry["unit"]))
        for joint, gain in self.found.gains.items():
            numbers = with_uncertainty(gain["value"], gain["std"])
            rows.append((f"{joint} gain", *numbers, gain["unit"]))
        return rows

    def _effect_rows(self) -> Rows:
        return [
            (f"{effect.name} {name}", *with_uncertainty(one["value"], one["std"]), one["unit"])
            for effect in self.found.model.effects
            if not (self.found.gains and effect.name == "torque_gain")
            for name, one in self.found.table[effect.name].items()
        ]

    def draw(self) -> Figure:
        """Draw measured torques and those of the model, joint by joint."""
        from tactile_dynamics_ros.report.joints import draw_torques

        return draw_torques(self.found.model.residuals(), self.found.model.samples.effort)

    def report(self, folder: Path, command: str = "") -> Path:
        """Write folder/report.html with all figures and return its path."""
        from tactile_dynamics_ros.report.joints import write_joints

        source = self.recording.source
        try:
            self.require_answer()
            good = not self.undetermined
        except NotIdentifiableError:
            good = False
        command = command or f"tactile-dynamics estimate {source} --out {folder}"
        page = self.headline(), good, source, command
        return write_joints(self.draw(), page, self.notes, self.rows(), Path(folder))

    def require_answer(self) -> None:
        """Check that the numbers are an answer.

        What a model misses in two recordings cancels or is in the payload's interval, up to a size.

        Raises:
            NotIdentifiableError: the error is far above the noise.
        """
        limit = _FAR_BESIDE if self.found.compared else 0.0
        if self.question.is_far and self.found.error > limit:
            raise NotIdentifiableError(self.question.misfit)

    def save(self, path: str | Path) -> Path:
        """Write the arm's model for `joint_monitor`: bodies, payload, friction, effects.

        A file that ends in .yaml gets the payload alone, as a body in the flange's frame.

        Raises:
            BadInputError: another file is there.
        """
        file = Path(path)
        if file.suffix == ".yaml":
            found = self.found.payload
            self.require_answer()
            return write_body(KnownBody(found.phi, found.covariance, "payload"), file)
        refuse_existing(file)
        with written_whole(file) as part:
            part.write_text(json.dumps(self.found.model.known.to_document(), indent=1))
        return file
