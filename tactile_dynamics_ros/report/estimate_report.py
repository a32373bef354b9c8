"""The report of an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_dynamics_ros.core.discrepancy.verdict.judgement import FAR
from tactile_dynamics_ros.core.discrepancy.verdict.wording import capitalise
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.report.estimates import (
    EstimateHistory,
    draw_comparison_with_truth,
    draw_convergence,
    draw_residuals,
    settle,
)
from tactile_dynamics_ros.report.measurements import draw_forces, draw_motion, draw_scene
from tactile_dynamics_ros.report.numbers import parameter_rows, with_uncertainty
from tactile_dynamics_ros.report.page import Page, Picture, Section, write_page
from tactile_dynamics_ros.report.style import house_style

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
    from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate

_FEWEST_LIVE_ESTIMATES = 5
MILLI = 1e3


def write_estimate_report(
    recording: Recording,
    model: FittedModel,
    folder: Path,
    history: EstimateHistory | None = None,
    truth: InertialParameters | None = None,
    command: str = "",
    introduction: Sequence[Section] = (),
    estimate: InertialEstimate | None = None,
    misfit: str | None = None,
) -> Path:
    """Write the report of an estimate.

    Args:
        recording: what was measured.
        model: fitted to it.
        folder: where report.html and the figures go.
        history: estimates as they came live; computed from the fit if absent.
        truth: true parameters where they are known.
        command: how to make the page again.
        introduction: sections that come before all others.
        estimate: to be reported in place of the model's own, with the error that all verbs tell.
        misfit: what is said of a model that does not fit, empty where it fits; None: the error
            decides.

    Returns:
        The path of report.html.
    """
    estimate = estimate or model.to_estimate()
    if misfit is None:
        misfit = _misfit(estimate.error.whitened_rms)
    with house_style():
        sections = [
            *introduction,
            _result(estimate, truth),
            _convergence(model, estimate, history, truth),
            _scene(model, estimate, truth),
            _residual(model),
            _measurements(recording),
        ]
        page = Page(
            title="What the hand holds",
            verdict=_verdict(estimate),
            good=estimate.converged and not misfit,
            source=recording.source,
            command=command or f"tactile-dynamics estimate {recording.source} --out {folder}",
            sentences=_advice(estimate, misfit),
            sections=sections,
        )
        return write_page(page, folder)


def _verdict(estimate: InertialEstimate) -> str:
    """Return the result in one sentence."""
    std, body = estimate.parameter_std, estimate.inertia
    mass = " ± ".join(with_uncertainty(MILLI * body.mass, MILLI * float(std[0])))
    distance = MILLI * float(np.linalg.norm(body.com))
    place = " ± ".join(with_uncertainty(distance, MILLI * float(std[1:4].max())))
    return (
        f"The object weighs {mass} g, and its centre of mass lies {place} mm from the origin of "
        "its frame."
    )


def _misfit(error: float) -> str:
    """Return what is said of a model of which nothing but its error is known."""
    if error <= FAR:
        return ""
    return f"the error is {error:.1f} times the noise; `tactile-dynamics diagnose` finds out why"


def _advice(estimate: InertialEstimate, misfit: str) -> list[str]:
    """Return what the reader should know about the quality of the result."""
    rms = estimate.error.whitened_rms
    sentences = [
        f"This follows from {estimate.duration:.1f} s of motion, {estimate.samples} samples of the "
        "forces that the contacts apply and of the motion that they cause."
    ]
    if not estimate.converged:
        sentences.append("The iteration did not converge: treat every number with suspicion.")
    if not misfit:
        effects = ", ".join(estimate.effects)
        model = f"a rigid body with {effects}" if effects else "a rigid body"
        sentences.append(
            f"What the model leaves unexplained is {rms:.2f} times the noise that the sensors "
            f"state: {model} explains the measurements."
        )
    else:
        sentences.append(f"{capitalise(misfit)}.")
    if estimate.not_excited:
        sentences.append(
            f"This motion does not determine {', '.join(estimate.not_excited)}; those values "
            "come from the prior. Turning and shaking the object about all axes would."
        )
    return sentences


def _result(estimate: InertialEstimate, truth: InertialParameters | None) -> Section:
    """Return the table of all parameters."""
    header = ["", "value", "± std", "unit"]
    if truth is not None:
        header.insert(3, "truth")
    return Section(
        title="The numbers",
        sentences=["Inertia is about the centre of mass, in the axes of the object's frame."],
        header=header,
        rows=parameter_rows(estimate, truth),
    )


def _convergence(
    model: FittedModel,
    estimate: InertialEstimate,
    history: EstimateHistory | None,
    truth: InertialParameters | None,
) -> Section:
    """Return how the estimate settles."""
    live = history is not None and len(history.time) >= _FEWEST_LIVE_ESTIMATES
    history = history if history is not None and live else settle(model)
    caption = "Bands are ± one standard deviation."
    if live:
        caption += " Bars at the end are the estimate from the whole recording."
    pictures = [
        Picture(
            "convergence",
            draw_convergence(history, truth, estimate.not_excited, estimate if live else None),
            "mass, centre of mass and inertia over seconds of data, with bands that narrow",
            f"{caption} Dashed lines are the truth." if truth else caption,
        )
    ]
    if truth is not None:
        pictures.append(
            Picture(
                "truth",
                draw_comparison_with_truth(history, truth),
                "error of each parameter in its own standard deviations",
                "How far each final value is from the truth, in its own standard deviations.",
            )
        )
    how = "as they were published live" if live else "from the first seconds to all data"
    return Section("The estimates settle", [f"Estimates {how}."], pictures)


def _scene(
    model: FittedModel, estimate: InertialEstimate, truth: InertialParameters | None
) -> Section:
    """Return the contacts on the object."""
    open_inertia = any(name.startswith("inertia") for name in estimate.not_excited)
    warning = " Its shape is open: this motion does not determine the inertia." * open_inertia
    longest = max(model.samples, key=lambda samples: len(samples.time))
    picture = Picture(
        "scene",
        draw_scene(longest, estimate.inertia, truth, estimate.covariance),
        "contact points with mean forces, centre of mass, ellipsoid of the same inertia",
        "Dots are where each contact touched, arrows its mean force on the object. The grey "
        "ellipsoid is the solid of even density with the estimated mass and inertia; blue ones and "
        f"small dots are as likely by its interval.{warning}",
    )
    return Section("The object between its contacts", (), [picture])


def _residual(model: FittedModel) -> Section:
    """Return what remains unexplained."""
    time = np.concatenate([samples.time for samples in model.samples])
    picture = Picture(
        "residuals",
        draw_residuals(time, -model.smooth_residual(), model.white_residual),
        "unexplained force and torque over time, and their distribution over that of the noise",
        "Measured minus predicted, in the object's axes; strong lines are means over half a "
        "second. If the bars on the right fill the line, only the stated noise remains.",
    )
    return Section("What remains unexplained", (), [picture])


def _measurements(recording: Recording) -> Section:
    """Return the raw measurements and what was wrong with them."""
    pictures = [
        Picture(
            "forces",
            draw_forces(recording.streams),
            "force of each contact on the object over time",
            "Force that each contact applies on the object, world axes.",
        ),
        Picture(
            "motion",
            draw_motion(recording.streams),
            "motion of the object over time",
            "Motion of the object since the recording began.",
        ),
    ]
    lines = recording.problem_lines()
    sentences = [f"Problems met while reading: {'; '.join(lines)}."] if lines else []
    return Section("What was measured", sentences, pictures)
