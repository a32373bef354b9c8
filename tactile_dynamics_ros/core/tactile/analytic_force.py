"""Analytic force estimator: raw counts of one BioTac to force, contact point and uncertainty.

The classic estimate F_k = S_k sum_i e_i n_ki is linear in the electrodes' changes e_i; here the
linear part is extended by pressure and low-order products (`features`), still one matrix product.

Source: Lin, Erickson, Fishel, Wettels and Loeb, 2009; Su et al., 2012 (classic formula).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.contact.skin_surface import project_to_skin
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.tactile.calibration import (
    CreepFilter,
    ForceCalibration,
    shipped_calibration,
)
from tactile_dynamics_ros.core.tactile.electrodes import (
    ELECTRODE_NORMAL,
    ELECTRODE_POSITION,
    ELECTRODES,
    FULL_SCALE,
)
from tactile_dynamics_ros.core.tactile.features import force_features, place_features
from tactile_dynamics_ros.core.tactile.signal_change import RestState, check_frame

Array = NDArray[np.float64]

_PRESSURE = 19


@dataclass(frozen=True)
class AnalyticForceConfig:
    """When a fingertip counts as touching, and how its rest state follows drift."""

    touch_counts: float = parameter(10.0, "PDC rise that begins a contact", "counts", 1.0, 500.0)
    release_counts: float = parameter(6.0, "PDC rise below which it ends", "counts", 0.0, 500.0)
    touch_frames: int = parameter(2, "frames in a row that begin or end a contact", "", 1, 100)
    rest_gain: float = parameter(0.01, "share by which the rest state follows a frame", "", 0, 1)
    force_scale: float = parameter(1.0, "gain of this unit, from a known force", "", 0.1, 10.0)
    period: float = parameter(0.01, "time between frames", "s", 1e-4, 1.0)
    saturation_margin: float = parameter(10.0, "counts from the range's ends", "counts", 0, 500)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class TactileEstimate:
    """What one frame of one fingertip says.

    Attributes:
        force: (3,) N on the object, sensor frame. std: (3,) N.
        in_contact: whether anything is touched (force is zero otherwise).
        point: (3,) contact point on the skin, sensor frame, m. point_std: m.
        saturated: whether an electrode is at the end of its range.
    """

    force: Array
    std: Array
    in_contact: bool
    point: Array
    point_std: float
    saturated: bool

    @property
    def torque(self) -> Array:
        """Torque (3,) of the force about the sensor origin, N m."""
        return np.cross(self.point, self.force)


class AnalyticForceEstimator:
    """Force of one fingertip, frame by frame.

    Args:
        config: thresholds.
        calibration: constants; those shipped with the package if None.
    """

    def __init__(
        self,
        config: AnalyticForceConfig | None = None,
        calibration: ForceCalibration | None = None,
    ) -> None:
        self.config = config or AnalyticForceConfig()
        self.calibration = calibration or shipped_calibration()
        self._rest: RestState | None = None
        self._in_contact = False
        self._streak = 0
        self._creep = CreepFilter(self.calibration.creep, self.config.period)
        self.last: TactileEstimate | None = None

    @property
    def tared(self) -> bool:
        """Whether the rest state is known."""
        return self._rest is not None

    def tare(self, raw: ArrayLike) -> None:
        """Take frames (K, 44) read without contact as the rest state.

        Raises:
            BadInputError: the frames are malformed or show a contact.
        """
        self._rest = RestState.from_frames(raw)
        self._in_contact, self._streak = False, 0
        self._creep.reset()

    def estimate(self, raw: ArrayLike) -> tuple[Array, Array, bool]:
        """Return force (3,), std (3,) in the sensor frame, and whether there is contact.

        Args:
            raw: (44,) counts.

        Raises:
            NotIdentifiableError: the sensor was not tared.
            BadInputError: the frame is malformed.
        """
        result = self.observe(raw)
        return result.force, result.std, result.in_contact

    def observe(self, raw: ArrayLike) -> TactileEstimate:
        """Return everything that a frame (44,) says; see `estimate`."""
        if self._rest is None:
            raise NotIdentifiableError(
                "BioTac force: the rest state is unknown; tare with frames without contact"
            )
        counts = check_frame(raw)
        change = self._rest.change(counts)
        in_contact = self._touches(100.0 * float(change[_PRESSURE]))
        if not in_contact and self._streak == 0:
            self._rest = self._rest.follow(counts, self.config.rest_gain)
        saturated = self._saturated(counts)
        force = self._creep.update(estimate_force(change, self.calibration))
        force = self.config.force_scale * force
        std = force_std(force, self.calibration)
        point, point_std = estimate_point(change, force, self.calibration)
        if not in_contact:
            force = np.zeros(3)
        self.last = TactileEstimate(
            force, std * (3.0 if saturated else 1.0), in_contact, point, float(point_std), saturated
        )
        return self.last

    def _touches(self, rise: float) -> bool:
        """Switch contact on and off with hysteresis and debouncing."""
        limit = self.config.release_counts if self._in_contact else self.config.touch_counts
        self._streak = self._streak + 1 if (rise > limit) != self._in_contact else 0
        if self._streak >= self.config.touch_frames:
            self._in_contact, self._streak = not self._in_contact, 0
        return self._in_contact

    def _saturated(self, counts: Array) -> bool:
        margin = self.config.saturation_margin
        electrodes = counts[ELECTRODES]
        return bool(np.any((electrodes <= margin) | (electrodes >= FULL_SCALE - margin)))


def estimate_force(change: Array, calibration: ForceCalibration) -> Array:
    """Return the force (..., 3) of tared signals (..., 20) before creep is taken out, N."""
    return np.asarray(force_features(change) @ calibration.force_weights)


def estimate_sequence(
    change: Array, calibration: ForceCalibration, period: float = 0.01
) -> tuple[Array, Array]:
    """Return force and std (T, 3) of a sequence of tared signals (T, 20), sensor frame, N."""
    creep = CreepFilter(calibration.creep, period)
    force = np.array([creep.update(raw) for raw in estimate_force(change, calibration)])
    return force, force_std(force, calibration)


def force_std(force: Array, calibration: ForceCalibration) -> Array:
    """Return the standard deviation (..., 3) that goes with an estimated force (..., 3), N."""
    strength = np.linalg.norm(force, axis=-1, keepdims=True)
    return np.asarray(calibration.force_std[0] + calibration.force_std[1] * strength)


def estimate_point(
    change: Array, force: Array, calibration: ForceCalibration
) -> tuple[Array, Array]:
    """Return contact points (..., 3) on the skin and their std (...), sensor frame, m."""
    point = project_to_skin(place_features(change) @ calibration.place_weights)
    strength = np.maximum(np.linalg.norm(force, axis=-1), 0.02)
    return point, np.asarray(calibration.place_std[0] + calibration.place_std[1] / strength)


def classic_force(change: Array, scale: Array) -> Array:
    """Return the classic estimate f_k = -S_k sum_i e_i n_ki (..., 3), N.

    Args:
        change: (..., 20) tared signals, hundreds of counts.
        scale: (3,) S_k in N per hundred counts.

    Source: Lin et al., 2009.
    """
    return np.asarray(-scale * (change[..., :19] @ ELECTRODE_NORMAL))


def electrode_centroid(change: Array) -> Array:
    """Return the contact point (..., 3) as centroid of electrodes weighted by squared change, m.

    Source: contact-point estimate of the biotac_force_net package.
    """
    weight = np.minimum(change[..., :19], 0.0) ** 2
    total = np.maximum(weight.sum(axis=-1, keepdims=True), 1e-9)
    return project_to_skin(weight @ ELECTRODE_POSITION / total)
