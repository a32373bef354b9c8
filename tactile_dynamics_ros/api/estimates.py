"""An estimate as people, programs and notebooks take it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.questions import Question, question_held
from tactile_dynamics_ros.api.result import ReportedResult, Rows, align_rows
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import ModelError
from tactile_dynamics_ros.report.numbers import parameter_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.api.wrist import WristShare
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
    from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
    from tactile_dynamics_ros.core.inertia.batch.knowledge import Comparison as MemoryComparison
    from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
    from tactile_dynamics_ros.core.inertia.shape_weighing import Weighed
    from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
    from tactile_dynamics_ros.export import Export
    from tactile_dynamics_ros.recording import Recording

GROSS_MISFIT = 10.0
"""Error over the noise from which nothing is exported, and `check` diagnoses by itself: other
units, signs or axes raise it to 15 and more, effects of the catalogue to 10 at most."""


@dataclass(frozen=True, repr=False)
class Estimate(ReportedResult):
    """Mass, centre of mass and inertia of a held object, and the parameters of effects.

    Attributes:
        recording: what was measured.
        model: fitted to it.
        tool: what was carried as well and is not meant, such as a gripper.
        prior: the same object, from earlier recordings.
        wrist: what a wrist sensor measures of it beside the fingertips.
        uncorrected: `fit_with_readings` of a body alone, if there is one already.
        rivals: with effects that the recording cannot distinguish from those of the model.
        shape: what the object fills; the model is then fitted from it.
    """

    recording: Recording
    model: FittedModel
    tool: KnownBody | None = None
    prior: KnownBody | None = None
    wrist: WristShare | None = None
    uncorrected: FittedModel | None = None
    rivals: tuple[InertialEstimate, ...] = ()
    shape: ShapePrior | None = None

    @cached_property
    def question(self) -> Question:
        """The model held against the recording as it is, as `compare` and `diagnose` do it."""
        effects = self.model.effects
        fitted = replace(self.model, noise_bias=None) if effects else self.uncorrected
        return question_held(self.recording, effects, fitted)

    @property
    def fits(self) -> bool:
        """Whether nothing is found against the model, as `compare` judges it."""
        return self.question.fits

    @cached_property
    def found(self) -> InertialEstimate:
        """Values with their covariance: without the tool, together with what was known."""
        return self._combined[0]

    @cached_property
    def alone(self) -> InertialEstimate:
        """Values from this recording alone, without the tool, together with the wrist."""
        return self._with_wrist[0]

    @cached_property
    def _with_wrist(self) -> tuple[InertialEstimate, MemoryComparison | None]:
        from tactile_dynamics_ros.core.inertia.batch.knowledge import (
            beside_rivals,
            with_memory,
            without_tool,
        )

        fitted = self.model.to_estimate() if self._shaped is None else self._shaped[0]
        chosen = replace(fitted, error=ModelError(**self.question.error()))
        both = beside_rivals(chosen, self.rivals)
        own = both if self.tool is None else without_tool(both, self.tool)
        return (own, None) if self.wrist is None else with_memory(own, self.wrist.known)

    @cached_property
    def _shaped(self) -> tuple[InertialEstimate, Weighed] | None:
        from tactile_dynamics_ros.core.inertia.shape_weighing import with_shape

        return None if self.shape is None else with_shape(self.model, self.shape)

    @cached_property
    def _combined(self) -> tuple[InertialEstimate, MemoryComparison | None]:
        from tactile_dynamics_ros.core.inertia.batch.knowledge import with_memory

        return (self.alone, None) if self.prior is None else with_memory(self.alone, self.prior)

    @property
    def changed(self) -> list[str]:
        """What differs from the earlier recordings beyond chance: the object is another one."""
        comparison = self._combined[1]
        return [] if comparison is None else comparison.changed

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """Sentences on the tool, on the wrist and on what was known before."""
        found = (*self._tool_notes(), *self._wrist_notes(), *self._memory_notes())
        return found if self._shaped is None else (*found, self._shaped[1].line)

    def _wrist_notes(self) -> list[str]:
        comparison = self._with_wrist[1]
        if self.wrist is None or comparison is None:
            return []
        if comparison.changed:
            return [
                f"fingertips and wrist differ in {' and '.join(comparison.changed)} beyond chance: "
                f"one of them errs, or {self.wrist.hand.name} is of another posture of the hand; "
                "the fingertips alone count"
            ]
        return [self.wrist.line()]

    def _tool_notes(self) -> list[str]:
        if self.tool is None:
            return []
        mass = f"{self.tool.phi[0]:.4g} kg of {self.tool.name} are taken out"
        exact = ", as if they were known exactly" if self.tool.is_exact else ""
        return [mass + exact]

    def _memory_notes(self) -> list[str]:
        if self.prior is None:
            return []
        if self.changed:
            return [
                f"{' and '.join(self.changed)} differ from {self.prior.name} beyond chance: the "
                "object has changed, or its frame lies otherwise in it; this recording alone counts"
            ]
        before = f"together with {self.prior.recordings} recordings of {self.prior.name}"
        known = set(self.prior.effects) - set(self.found.effects)
        if not known:
            return [before]
        return [before, f"effects that it had: {', '.join(sorted(known))}; add them by --effects"]

    def known(self) -> KnownBody:
        """Return what is known of the body now, as files of bodies hold it.

        Raises:
            BadInputError: there is a shape, which would count again with each recording.
            NotIdentifiableError: the numbers are no answer.
        """
        from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody

        if self.shape is not None:
            raise BadInputError(
                "save: what recordings tell; leave out the shape, and name it later"
            )
        self.require_answer()
        combined = self.prior is not None and not self.changed
        earlier = self.prior if combined else None
        effects = {name: effect.to_json() for name, effect in self.found.effects.items()}
        return KnownBody(
            self.found.inertia.dynamic_parameters,
            self.found.covariance,
            self.recording.source,
            self.found.not_excited,
            effects if earlier is None else earlier.effects | effects,
            1 if earlier is None else earlier.recordings + 1,
            self.found.lasting,
        )

    def save(self, path: str | Path) -> Path:
        """Write what is known of the body, for `tool` or `prior` of later estimates.

        Raises:
            BadInputError: another file is there, or the file of another object.
            NotIdentifiableError: the numbers are no answer.
        """
        from tactile_dynamics_ros.recording.yaml_files import write_body

        if self.changed and self.prior and Path(self.prior.name) == Path(path):
            raise BadInputError(
                f"{path} is the file of another object: {' and '.join(self.changed)} differ; "
                "choose another path"
            )
        return write_body(self.known(), path)

    @property
    def _is_plain(self) -> bool:
        """Whether the numbers are those of this recording's fingertips alone."""
        return self.tool is None and self.prior is None and self.wrist is None

    @property
    def undetermined(self) -> tuple[str, ...]:
        """What this recording does not determine; value and std of it are those of the prior."""
        return self.found.not_excited

    def to_json(self) -> dict[str, Any]:
        """Return the document of `estimate`."""
        document = self.found.to_json()
        if self.tool is not None:
            document["tool"] = {"name": self.tool.name, "mass": float(self.tool.phi[0])}
        if self.wrist is not None:
            apart = self._with_wrist[1]
            differs = [] if apart is None else apart.changed
            document["wrist"] = self.wrist.to_json() | {"differs": differs}
        if self._shaped is not None:
            document["shape"] = self._shaped[1].to_json()
        comparison = self._combined[1]
        if self.prior is not None and comparison is not None:
            document["prior"] = {
                "name": self.prior.name,
                "recordings": self.prior.recordings,
                "p_value": comparison.p_value,
                "changed": comparison.changed,
            }
        return document

    def lines(self) -> list[str]:
        """Return the estimate for people."""
        found, error = self.found, self.found.error
        names = ", ".join(self.recording.streams.contacts)
        return [
            f"{self.recording.source}: {found.duration:.1f} s, {found.samples} samples, "
            f"contacts {names}",
            align_rows(self.rows()),
            *self._open_lines(),
            *self._correction_lines(),
            f"error: {error.whitened_rms:.2f} times the stated sensor noise (whitened RMS), "
            f"{error.force_rms_n:.3g} N, {error.torque_rms_nm:.3g} N m",
            *filter(None, [self.question.misfit]),
        ]

    def headline(self) -> str:
        """Return how well the model fits, and whether the numbers are an answer."""
        try:
            self.require_answer()
        except NotIdentifiableError as reason:
            return str(reason)
        error = self.found.error.whitened_rms
        return f"{self.recording.source}: error {error:.2f} times the stated sensor noise"

    def rows(self) -> Rows:
        """Return name, value, standard deviation and unit of every parameter."""
        return [("", "value", "± std", "unit"), *parameter_rows(self.found)]

    def body_rows(self) -> Rows:
        """Return the rows of mass, centre of mass and inertia alone, without a head."""
        return [*parameter_rows(replace(self.found, effects={}))]

    def draw(self) -> Figure:
        """Draw how the estimate settles; with a tool or prior, what remains unexplained."""
        from tactile_dynamics_ros.report.estimates import draw_convergence, draw_residuals, settle

        if self._is_plain:
            return draw_convergence(settle(self.model), None, self.undetermined)
        time = np.concatenate([samples.time for samples in self.model.samples])
        return draw_residuals(time, -self.model.smooth_residual(), self.model.white_residual)

    def report(self, folder: Path, command: str = "") -> Path:
        """Write folder/report.html with all figures and return its path.

        Raises:
            BadInputError: there is a tool, wrist or prior, of which the page knows nothing.
        """
        if not self._is_plain:
            raise BadInputError(
                "the report is of one recording as it is; leave out tool, wrist and prior"
            )
        from tactile_dynamics_ros.report.estimate_report import write_estimate_report

        return write_estimate_report(
            self.recording,
            self.model,
            Path(folder),
            command=command,
            estimate=self.found,
            misfit="" if self.fits else self.question.misfit,
        )

    def export(self, form: str, name: str = "object", shape: str | Path | None = None) -> Export:
        """Return the body as urdf, sdf, mjcf, ur, franka or moveit takes it.

        Args:
            form: of `tactile_dynamics_ros.export.FORMATS`.
            name: of the link, model or object.
            shape: of "moveit": yaml file of an object, or mesh, in the axes of the object's pose.

        Raises:
            BadInputError: there is no such format, or it takes no shape.
            NotIdentifiableError: the numbers are no answer, or what the format needs is not known.
        """
        from tactile_dynamics_ros.core.shape.object_shape import load_shape
        from tactile_dynamics_ros.export import export

        if self.question.whitened_rms > GROSS_MISFIT:
            raise NotIdentifiableError(self.question.misfit)
        self._require_known()
        surface = None if shape is None else load_shape(Path(shape))
        return export(self.found, form, self.recording.source, name, self._doubts(), surface)

    def _doubts(self) -> list[str]:
        """Return what speaks against using the numbers."""
        return [] if self.fits else [self.question.misfit]

    def require_answer(self) -> None:
        """Check that the numbers are an answer.

        Raises:
            NotIdentifiableError: not even the mass is known, the iteration did not converge, or the
                error is far above the noise.
        """
        if self.question.is_far:
            raise NotIdentifiableError(self.question.misfit)
        self._require_known()

    def _require_known(self) -> None:
        if not self.found.converged:
            raise NotIdentifiableError(
                "not converged: the printed values are the last iterate; check the recording's "
                "motion, contacts and stamps"
            )
        if "mass" in self.undetermined:
            raise NotIdentifiableError(
                f"not identifiable from this motion: {', '.join(self.undetermined)}; the printed "
                "values of these come from the prior. Turn and shake the object about all axes"
            )

    def _open_lines(self) -> list[str]:
        """Return a line on what the recording does not determine, if there is any."""
        if not self.undetermined:
            return []
        unplaced = (
            "no positions were recorded (the origin stays at one place while the object turns): "
            "accelerations are unknown, so inertia is undetermined; record positions or an IMU"
        )
        return [unplaced] * self.model.unplaced + [
            f"* undetermined by this recording: {', '.join(self.undetermined)}; value and std "
            "depend on what was presumed beforehand"
        ]

    def _correction_lines(self) -> list[str]:
        """Return a line on the offset of the sensors that the fit estimated, if it counts.

        A model that does not fit puts what it misses down to the sensors: an effect explains that
        better, and nothing is said of an offset.
        """
        wrench = self.model.corrected_wrench
        if not wrench.any() or not self.fits:
            return []
        stds = self.model.corrected_wrench_std
        numbers = [write_interval(*pair) for pair in zip(wrench, stds, strict=True)]
        torque, force = ", ".join(numbers[:3]), ", ".join(numbers[3:])
        return [f"estimated sensor offset, subtracted: ({force}) N, ({torque}) N m"]
