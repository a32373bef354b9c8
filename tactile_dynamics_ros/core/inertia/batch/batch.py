"""Batch estimation of inertia, and of the parameters of effects, from a whole recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import (
    fit_corrected,
    fit_model,
    fit_unfolded,
)
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import choose_grid
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import (
    ProblemConfig,
    WrenchProblem,
)
from tactile_dynamics_ros.core.inertia.residuals.rigid_grasp import sharpen_poses
from tactile_dynamics_ros.core.streams.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


_FEWEST = 500
"""Grid times of a stretch at least: one of a minute of a logger of 1 Hz would lose a third of it to
the windows at its ends. Recordings above 8 Hz are cut as `stretch_duration` says."""


@dataclass(frozen=True)
class BatchConfig:
    """Iterations and stretch length of the batch estimator."""

    problem: ProblemConfig = field(default_factory=ProblemConfig)
    iterations: int = parameter(4, "re-evaluations of covariance and denoised signals", "", 1, 20)
    stretch_duration: float = parameter(60.0, "stretch that is whitened as one piece", "s", 2.0)
    most_samples: int = parameter(
        12000, "grid times, two minutes at 100 Hz, beyond which the grid is coarser", "", 100
    )
    least_rate: float = parameter(50.0, "of such a grid", "Hz", 1.0)

    def __post_init__(self) -> None:
        """Check ranges."""
        check_ranges(self)

    def paced(self, duration: float) -> BatchConfig:
        """These settings with the rate of the grid that a duration (s) allows.

        Forces between grid times are averaged, not lost: at 62.5 instead of 125 Hz, three minutes
        at 1 kHz take half the time and memory, and their intervals are at most 6 % wider (mass).
        """
        rate = max(self.least_rate, self.most_samples / duration)
        problem = replace(self.problem, maximum_rate=min(self.problem.maximum_rate, rate))
        return replace(self, problem=problem)


def read_stretches(streams: Streams, config: BatchConfig) -> tuple[WrenchProblem, ...]:
    """Cut a recording into stretches of about `stretch_duration`.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
    """
    grid = choose_grid(streams, config.problem.maximum_rate)
    config = config.paced(float(grid[-1] - grid[0]))
    grid = choose_grid(streams, config.problem.maximum_rate)
    shortest = _FEWEST * float(np.median(np.diff(grid)))
    count = max(1, round((grid[-1] - grid[0]) / max(config.stretch_duration, shortest)))
    edges = np.linspace(grid[0], grid[-1] + 1e-6, count + 1)
    start = float(grid[0])
    if count == 1:
        return (WrenchProblem.from_streams(streams, config.problem, start=start),)
    problems = [
        WrenchProblem.try_from_streams(streams, config.problem, (low, high), start)
        for low, high in zip(edges[:-1], edges[1:], strict=True)
    ]
    found = tuple(problem for problem in problems if problem is not None)
    return found or (WrenchProblem.from_streams(streams, config.problem, start=start),)


def fit_recording(
    streams: Streams, effects: Sequence[Effect] = (), config: BatchConfig | None = None
) -> FittedModel:
    """Read a recording and fit the model to it.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    config = config or BatchConfig()
    return fit_problems(read_stretches(streams, config), effects, config)


def fit_problems(
    problems: Sequence[WrenchProblem], effects: Sequence[Effect], config: BatchConfig
) -> FittedModel:
    """Fit the model to stretches of a recording.

    Raises:
        NotIdentifiableError: the iteration diverged.
    """
    model = fit_model(problems, effects, iterations=config.iterations)
    if not np.all(np.isfinite(model.white_residual)):
        raise NotIdentifiableError("the estimation diverged; check units and stamps of the streams")
    thicker = fit_unfolded(model, config.iterations)
    if thicker is not None and thicker.whitened_rms < model.whitened_rms:
        return thicker
    return model


def fit_body(streams: Streams, config: BatchConfig | None = None) -> FittedModel:
    """`fit_recording` of a rigid body, corrected by lasting errors of the sensors.

    Poses are sharpened where the contacts allow it.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    sharp = sharpen_poses(streams)
    if sharp is None:
        return fit_corrected(fit_recording(streams, (), config))
    model = fit_corrected(fit_recording(sharp.streams, (), config))
    return replace(model, frame_covariance=sharp.frame_covariance)
