"""How far noise of the poses moves effects that the motion drives through dynamics of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.fitting import fit_model
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.numerics.noise import white_pose_noise_std
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import PoseStream, Streams

_SEED = 7
"""Seed of the noise that is added, so that the same recording gives the same interval. Another one
makes another draw, by which widths differ as single draws of noise do."""


def widen_by_pose_noise(
    model: FittedModel, streams: Streams, config: BatchConfig | None = None
) -> FittedModel:
    """Widen the intervals of a model whose effects ring by what noise of the poses does to them.

    A mass on an internal spring answers to the acceleration, which is known from noisy poses alone.
    Its filter lets that noise into the model at the very frequencies where the effect is seen, and
    the fit makes the effect slower and smaller (a sixth of the mass at 0.5 mm, 0.2 deg and 4 Hz).
    As much noise again is added to the poses and the model fitted anew; how far the parameters move
    is about how far the first noise has moved them, and counts as one standard deviation in that
    direction. A bias of half of the effect is underestimated.

    Args:
        model: fitted.
        streams: what it is fitted to.
        config: settings of the fit.

    Returns:
        The model itself if none of its effects rings or there are no poses.

    Source: Cook and Stefanski 1994 (simulation-extrapolation), of which this is the first step.
    """
    if streams.pose is None or not any(effect.rings for effect in model.effects):
        return model
    config = (config or BatchConfig()).paced(sum(np.ptp(s.problem.grid) for s in model.stretches))
    noisy = replace(streams, pose=_disturbed(streams.pose))
    problems = [
        WrenchProblem.try_from_streams(
            noisy, config.problem, (grid[0], grid[-1] + 1e-6), stretch.problem.start
        )
        for stretch in model.stretches
        for grid in [stretch.problem.grid]
    ]
    found = [problem for problem in problems if problem is not None]
    if not found:
        return model
    other = fit_model(found, model.effects, model.theta, model.xi, config.iterations)
    moved = np.concatenate([other.phi - model.phi, *map(np.subtract, other.theta, model.theta)])
    return replace(model, noise_bias=moved)


def _disturbed(pose: PoseStream) -> PoseStream:
    """The poses with white noise of the size that they show, once more."""
    turn, shift = white_pose_noise_std(pose.time, pose.rotation, pose.position)
    draws = np.random.default_rng(_SEED).normal(size=(len(pose.time), 6))
    rotation = exp_so3(turn * draws[:, :3]) @ pose.rotation
    return replace(pose, position=pose.position + shift * draws[:, 3:], rotation=rotation)
