"""Live reading of one fingertip: tare, touch, drift and faults around a model of the force."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import cross
from tactile_dynamics_ros.core.tactile.electrodes import (
    ELECTRODE_POSITION,
    ELECTRODES,
    FULL_SCALE,
    TDC,
)
from tactile_dynamics_ros.core.tactile.signal_change import (
    COUNTS_PER_KELVIN,
    RestState,
    check_frame,
    temperature,
)

Array = NDArray[np.float64]

_PRESSURE = 19


@dataclass(frozen=True)
class FingertipConfig:
    """When a fingertip counts as touching, and how its rest state follows drift."""

    touch_counts: float = parameter(10.0, "PDC rise that begins a contact", "counts", 1.0, 500.0)
    release_counts: float = parameter(6.0, "PDC rise below which it ends", "counts", 0.0, 500.0)
    least_force: float = parameter(0.03, "force that a contact has at least", "N", 0.0, 1.0)
    touch_frames: int = parameter(2, "frames in a row that begin or end a contact", "", 1, 100)
    rest_gain: float = parameter(0.0005, "least share of a frame in the rest state", "", 0, 1)
    gain: tuple[float, ...] = parameter(
        (1.0,), "of this unit, from a known force: a number, or the nine of a matrix by rows"
    )
    drift: tuple[float, ...] = parameter(
        (COUNTS_PER_KELVIN,), "of this unit's electrodes: a number, or E1 to E19", "counts/K"
    )
    period: float = parameter(0.01, "time between frames", "s", 1e-4, 1.0)
    saturation_margin: float = parameter(10.0, "counts from the range's ends", "counts", 0, 500)
    drift_warning: float = parameter(3.0, "warming since the rest state that is flagged", "K", 0.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if len(self.gain) not in (1, 9) or not np.all(np.isfinite(self.gain)):
            raise BadInputError(
                f"gain: {len(self.gain)} numbers, expected one, or nine of a matrix, all finite"
            )
        if not 0.1 <= abs(np.linalg.det(self.gain_matrix)) <= 1e3:
            raise BadInputError(f"gain: {list(self.gain)} is no gain of a fingertip")
        if len(self.drift) not in (1, 19) or not np.all(np.isfinite(self.drift)):
            raise BadInputError(
                f"drift: {len(self.drift)} numbers, expected one, or 19, all finite"
            )

    @property
    def gain_matrix(self) -> Array:
        """G (3, 3) of the published force f = G f_model."""
        values = np.array(self.gain, dtype=float)
        return values.reshape(3, 3) if len(values) == 9 else values[0] * np.eye(3)

    def with_gain(self, gain: tuple[float, ...]) -> FingertipConfig:
        """Return the configuration with a further gain, one number or nine, applied last."""
        own = replace(self, gain=gain)
        total = own.gain_matrix @ self.gain_matrix
        return replace(self, gain=tuple(total.ravel().tolist()))


@dataclass(frozen=True)
class TactileEstimate:
    """What one frame of one fingertip says.

    Attributes:
        force: (3,) N on the object, sensor frame. std: (3,) N.
        in_contact: whether anything is touched (force is zero otherwise).
        point: (3,) contact point on the skin, sensor frame, m. point_std: m.
        saturated: whether an electrode is at the end of its range.
        warming: change of the core's temperature since the rest state, K.
        drifting: whether the warming is large enough to spoil the force.
    """

    force: Array
    std: Array
    in_contact: bool
    point: Array
    point_std: float
    saturated: bool
    warming: float
    drifting: bool

    @property
    def torque(self) -> Array:
        """Torque (3,) of the force about the sensor origin, N m."""
        return cross(self.point, self.force)


Felt = tuple[Array, Array, Array, float]
"""Force (3,), std (3,), N, contact point (3,) and its std, m."""


class ForceModel(Protocol):
    """Turns tared signals, frame by frame, into a contact."""

    def reset(self, rest: Array) -> None:
        """Forget past frames; the electrodes rest at (19,) counts."""

    def predict(self, change: Array) -> Felt:
        """Return force (3,), std (3,), contact point (3,) and its std for the next frame (20,)."""


class FingertipEstimator:
    """Force of one fingertip, frame by frame.

    Args:
        model: of the force.
        config: thresholds.

    Attributes:
        last: the latest estimate, or None.
        dead: (19,) electrodes that did not change at all during the tare.
    """

    def __init__(self, model: ForceModel, config: FingertipConfig | None = None) -> None:
        self.model = model
        self.config = config or FingertipConfig()
        self._gain = self.config.gain_matrix
        self._rest: RestState | None = None
        self._in_contact = False
        self._streak = 0
        self.last: TactileEstimate | None = None
        self.dead: NDArray[np.bool_] = np.zeros(19, dtype=bool)

    @property
    def tared(self) -> bool:
        """Whether the rest state is known."""
        return self._rest is not None

    def tare(self, raw: ArrayLike) -> None:
        """Take frames (K, 44) read without contact as the rest state.

        Raises:
            BadInputError: the frames are malformed or show a contact.
        """
        self._rest = RestState.from_frames(raw, np.array(self.config.drift))
        self._in_contact, self._streak = False, 0
        self.dead = find_dead_electrodes(np.atleast_2d(np.asarray(raw, dtype=float)))
        self.model.reset(self._rest.electrodes)

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
        change = self.tared_signals(raw)
        return self.conclude(raw, change, self.model.predict(change))

    def tared_signals(self, raw: ArrayLike) -> Array:
        """Return the changes (20,) of the signals in a frame (44,), for the model."""
        if self._rest is None:
            raise NotIdentifiableError(
                "BioTac force: the rest state is unknown; tare with frames without contact"
            )
        return fill_dead_electrodes(self._rest.change(check_frame(raw)), self.dead)

    def conclude(self, raw: ArrayLike, change: Array, found: Felt) -> TactileEstimate:
        """Return everything that a frame (44,) says, given what the model found in its changes."""
        assert self._rest is not None
        counts = np.asarray(raw, dtype=float)
        force, std, point, point_std = found
        rise = 100.0 * float(change[_PRESSURE])
        in_contact = self._touches(rise, float(np.linalg.norm(force)))
        if not in_contact and self._streak == 0 and rise <= self.config.release_counts:
            self._rest = self._rest.follow(counts, self.config.rest_gain)
        saturated = self._saturated(counts)
        force = self._gain @ force if in_contact else np.zeros(3)
        warming = float(temperature(counts[TDC])) - self._rest.temperature
        doubt = 3.0 if saturated else 1.0 + 0.3 * float(self.dead.sum())
        self.last = TactileEstimate(
            force=force,
            std=doubt * std,
            in_contact=in_contact,
            point=point,
            point_std=point_std,
            saturated=saturated,
            warming=warming,
            drifting=abs(warming) > self.config.drift_warning,
        )
        return self.last

    def _touches(self, rise: float, strength: float) -> bool:
        """Switch contact on and off with hysteresis and debouncing.

        PDC lingers for seconds after a firm grip (creep of the skin), when the force is back at
        zero: a contact needs a force too.
        """
        limit = self.config.release_counts if self._in_contact else self.config.touch_counts
        touching = rise > limit and strength > self.config.least_force
        self._streak = self._streak + 1 if touching != self._in_contact else 0
        if self._streak >= self.config.touch_frames:
            self._in_contact, self._streak = not self._in_contact, 0
        return self._in_contact

    def _saturated(self, counts: Array) -> bool:
        margin = self.config.saturation_margin
        electrodes = counts[ELECTRODES][~self.dead]
        return bool(np.any((electrodes <= margin) | (electrodes >= FULL_SCALE - margin)))


def find_dead_electrodes(raw: Array) -> NDArray[np.bool_]:
    """Return which electrodes (19,) are stuck: at an end of the range, or without any noise.

    Args:
        raw: (K, 44) frames without contact; noise is judged from ten frames on.
    """
    electrodes = raw[:, ELECTRODES]
    stuck = np.all((electrodes < 50) | (electrodes > FULL_SCALE - 5), axis=0)
    if len(electrodes) >= 10:
        quiet = np.ptp(electrodes, axis=0) == 0.0
        stuck |= quiet & (quiet.sum() < 10)
    return np.asarray(stuck)


def fill_dead_electrodes(change: Array, dead: NDArray[np.bool_]) -> Array:
    """Return changes (20,) with dead electrodes replaced by the mean of their live neighbours."""
    if not dead.any():
        return change
    filled = change.copy()
    for k in np.flatnonzero(dead):
        weight = np.where(dead, 0.0, _NEARNESS[k])
        filled[k] = weight @ change[:19] / weight.sum() if weight.any() else 0.0
    return filled


def _nearness() -> Array:
    gap = np.linalg.norm(ELECTRODE_POSITION[:, None] - ELECTRODE_POSITION, axis=-1)
    near: Array = np.exp(-((gap / 3e-3) ** 2)) * (1.0 - np.eye(len(gap)))
    return near


_NEARNESS = _nearness()
