"""Constants of the analytic force estimator: how they are fitted, stored and read."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.tactile.features import MIRROR, force_features, place_features

Array = NDArray[np.float64]

SHIPPED_CALIBRATION = Path(__file__).parent / "data" / "analytic_force.json"
NORMAL_90 = 1.6449
MIRROR_AXES = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True)
class ForceCalibration:
    """What turns tared signals into force, contact place and their standard deviations.

    Attributes:
        force_weights: (668, 3) N per feature. place_weights: (230, 3) m per feature.
        force_std: (2, 3) std = row 0 + row 1 * |force|, N and dimensionless.
        place_std: (2,) std of the contact point = entry 0 + entry 1 / |force|, m and N m.
        origin: what it was fitted to.
    """

    force_weights: Array
    place_weights: Array
    force_std: Array
    place_std: Array
    origin: str

    def save(self, path: Path) -> None:
        """Write as JSON with six significant digits."""
        content: dict[str, Any] = {"origin": self.origin}
        for name in ("force_weights", "place_weights", "force_std", "place_std"):
            values = np.asarray(getattr(self, name))
            content[name] = [[float(f"{v:.6g}") for v in row] for row in np.atleast_2d(values)]
        path.write_text(json.dumps(content, separators=(",", ":")) + "\n")

    @classmethod
    def load(cls, path: Path) -> ForceCalibration:
        """Read what `save` wrote.

        Raises:
            BadInputError: the file is missing or is no calibration.
        """
        try:
            content = json.loads(path.read_text())
            return cls(
                np.array(content["force_weights"]),
                np.array(content["place_weights"]),
                np.array(content["force_std"]),
                np.array(content["place_std"][0]),
                str(content["origin"]),
            )
        except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
            raise BadInputError(f"calibration file {path}: {error}") from error


@lru_cache(maxsize=1)
def shipped_calibration() -> ForceCalibration:
    """Return the calibration that comes with the package."""
    return ForceCalibration.load(SHIPPED_CALIBRATION)


@dataclass(frozen=True)
class LabelledPresses:
    """Tared signals with the true contact, for fitting and testing.

    Attributes:
        change: (N, 20) hundreds of counts. force: (N, 3) N. point: (N, 3) m. unit: (N,) index.
    """

    change: Array
    force: Array
    point: Array
    unit: NDArray[np.intp]


def fit_calibration(
    presses: LabelledPresses, held_out: LabelledPresses, origin: str, ridge: float = 3.0
) -> ForceCalibration:
    """Fit weights by ridge regression and standard deviations on held-out units.

    Mirrored copies of all presses are added, since the finger is symmetric. Samples are weighted
    by 1 / (0.05 N + 0.1 |f|), about the error that is reached.

    Args:
        presses: to fit the weights to.
        held_out: of other units, to fit the standard deviations to.
        origin: description that is stored.
        ridge: penalty on standardised weights.
    """
    change = np.concatenate([presses.change, presses.change[:, MIRROR]])
    force = np.concatenate([presses.force, presses.force * MIRROR_AXES])
    point = np.concatenate([presses.point, presses.point * MIRROR_AXES])
    strength = np.linalg.norm(force, axis=1)
    force_weights = _ridge(force_features(change), force, 1.0 / (0.05 + 0.1 * strength), ridge)
    touching = strength > 0.1
    place_weights = _ridge(
        place_features(change[touching]),
        point[touching],
        1.0 / (1e-3 + 2e-4 / strength[touching]),
        ridge,
    )
    force_error = force_features(held_out.change) @ force_weights - held_out.force
    held_strength = np.linalg.norm(held_out.force, axis=1)
    force_std = np.stack([_fit_std(held_strength, error) for error in force_error.T], axis=1)
    pressed = held_strength > 0.1
    place_error = place_features(held_out.change[pressed]) @ place_weights - held_out.point[pressed]
    place_std = _fit_std(1.0 / held_strength[pressed], np.sqrt(np.mean(place_error**2, axis=1)))
    return ForceCalibration(force_weights, place_weights, force_std, place_std, origin)


def _ridge(features: Array, target: Array, weight: Array, penalty: float) -> Array:
    scale = features.std(axis=0) + 1e-9
    weighted = features / scale * weight[:, None]
    gram = weighted.T @ weighted + penalty * np.eye(weighted.shape[1])
    return np.asarray(
        np.linalg.solve(gram, weighted.T @ (target * weight[:, None])) / scale[:, None]
    )


def _fit_std(driver: Array, error: Array) -> Array:
    """Return (2,) a, b >= 0 of std = a + b driver, matched to 90 % quantiles in bins."""
    edges = np.quantile(driver, np.linspace(0.0, 1.0, 13))
    rows, deviations = [], []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = (driver >= low) & (driver <= high)
        if high > low and inside.sum() > 20:
            rows.append([1.0, float(np.mean(driver[inside]))])
            deviations.append(float(np.quantile(np.abs(error[inside]), 0.9)) / NORMAL_90)
    target = np.array(deviations)
    solution, _ = nnls(np.array(rows) / target[:, None], np.ones_like(target))
    return np.asarray(solution)
