"""Errors and consistency of tracked poses, up to turns that leave the object's surface alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from benchmarks.tracking.tape import Tape
from benchmarks.tracking.trackers import Track
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.kinematic_tracker import pose_error


@dataclass(frozen=True)
class Errors:
    """Errors over time of one track against the truth.

    Attributes:
        time: (N,) s. position: (N,) m, of the object's middle. rotation: (N,) rad.
        nees: (N,) squared error over covariance, NaN where there is none.
        flagged: (N,) whether the tracker said that it does not know.
        freedom: degrees of freedom that a camera can see, 6 or less.
    """

    time: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    nees: np.ndarray
    flagged: np.ndarray
    freedom: int


def measure(tape: Tape, shape: ObjectShape, track: Track) -> Errors:
    """Compare a track with the truth.

    The symmetry of the shape that fits the first pose best is taken for the whole track; turns
    about an axis of symmetry, which no camera sees, do not count.
    """
    times = np.array([moment.time for moment in tape.moments])
    rows = []
    turn: np.ndarray | None = None
    for when, pose, covariance in zip(track.time, track.pose, track.covariance, strict=True):
        truth = tape.moments[int(np.argmin(np.abs(times - when)))].truth
        if turn is None:
            turn = nearest_symmetry(shape, truth[:3, :3], pose[:3, :3])
        rows.append(compare_poses(shape, truth, pose, covariance, turn))
    position, rotation, nees = np.array(rows).reshape(-1, 3).T
    return Errors(
        np.array(track.time),
        position,
        rotation,
        nees,
        np.array(track.flagged, dtype=bool),
        6 - len(shape.symmetry_axes),
    )


def nearest_symmetry(shape: ObjectShape, truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Return the symmetry S (4, 4) of the object that brings truth S nearest to a rotation."""
    likeness = np.einsum("ij,sij->s", found, truth @ shape.symmetries)
    turn = np.eye(4)
    turn[:3, :3] = shape.symmetries[int(np.argmax(likeness))]
    turn[:3, 3] = shape.centre - turn[:3, :3] @ shape.centre
    return turn


def compare_poses(
    shape: ObjectShape,
    truth: np.ndarray,
    pose: np.ndarray,
    covariance: np.ndarray | None,
    turn: np.ndarray,
) -> tuple[float, float, float]:
    """Return the errors of position, m, and rotation, rad, and the NEES (NaN without covariance).

    Args:
        shape: of the object.
        truth: (4, 4) X_WO.
        pose: (4, 4) X_WO that was told.
        covariance: (6, 6) that was told with it, or None.
        turn: (4, 4) symmetry of the shape by which the truth may be turned.
    """
    alike = truth @ turn
    error = pose_error(pose, alike)
    middle = (pose - alike)[:3, :3] @ shape.centre + (pose - alike)[:3, 3]
    unseen = truth[:3, :3] @ shape.symmetry_axes.T
    rotation = error[:3] - unseen @ (unseen.T @ error[:3])
    nees = np.nan
    if covariance is not None:
        shown = _complement(unseen)
        error = shown.T @ error
        nees = float(error @ np.linalg.solve(shown.T @ covariance @ shown, error))
    return float(np.linalg.norm(middle)), float(np.linalg.norm(rotation)), nees


def _complement(unseen: np.ndarray) -> np.ndarray:
    """Return a basis (6, 6 - A) of all errors but turns about the unseen axes (3, A)."""
    padded = np.vstack([unseen, np.zeros_like(unseen)])
    basis, _ = np.linalg.qr(np.hstack([padded, np.eye(6)]))
    return basis[:, unseen.shape[1] :]


def summarise(runs: list[Errors]) -> dict[str, Any]:
    """Root mean squares over all runs, and the mean NEES with the 95 % band of as many runs."""
    position = np.concatenate([run.position for run in runs])
    rotation = np.concatenate([run.rotation for run in runs])
    nees = [float(np.mean(run.nees)) for run in runs]
    freedom = sum(run.freedom for run in runs)
    band = chi2.ppf([0.025, 0.975], freedom) / len(runs)
    return {
        "runs": len(runs),
        "position_rms_mm": 1e3 * float(np.sqrt(np.mean(position**2))),
        "rotation_rms_deg": float(np.rad2deg(np.sqrt(np.mean(rotation**2)))),
        "worst_run_position_rms_mm": 1e3 * max(_rms(run.position) for run in runs),
        "worst_run_rotation_rms_deg": float(np.rad2deg(max(_rms(run.rotation) for run in runs))),
        "nees": None if np.isnan(nees).all() else float(np.mean(nees)),
        "nees_runs": None if np.isnan(nees).all() else nees,
        "nees_band_95": band.tolist(),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
