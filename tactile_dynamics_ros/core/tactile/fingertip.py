"""Live reading of fingertips: tare, touch, drift and faults around a model of the force."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.rotation import cross
from tactile_dynamics_ros.core.tactile.electrodes import (
    CHANNELS,
    ELECTRODE_POSITION,
    ELECTRODES,
    FULL_SCALE,
    PDC,
)
from tactile_dynamics_ros.core.tactile.signal_change import (
    COUNTS_PER_KELVIN,
    RestState,
    check_frame,
)
from tactile_dynamics_ros.core.tactile.slip import Debounced

Flags = NDArray[np.bool_]


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
    """Contact that one frame of a fingertip, or of several (...), shows.

    Attributes:
        force: (..., 3) N on the object, sensor frame. std: (..., 3) N.
        in_contact: (...) whether anything is touched (force is zero otherwise).
        point: (..., 3) contact point on the skin, sensor frame, m. point_std: (...) m.
        saturated: (...) whether an electrode is at the end of its range.
        warming: (...) change of the core's temperature since the rest state, K.
        drifting: (...) whether the warming is large enough to spoil the force.
    """

    force: Array
    std: Array
    in_contact: Flags
    point: Array
    point_std: Array
    saturated: Flags
    warming: Array
    drifting: Flags

    @property
    def torque(self) -> Array:
        """Torque (..., 3) of the force about the sensor origin, N m."""
        return cross(self.point, self.force)


TactileReading = tuple[Array, Array, Array, Array]
"""Force (..., 3), std (..., 3), N, contact point (..., 3) and its std (...), m."""


class ForceModel(Protocol):
    """Turns tared signals, frame by frame, into contacts."""

    def reset(self, rest: Array) -> None:
        """Forget past frames; the electrodes rest at (..., 19) counts."""

    def predict(self, change: Array) -> TactileReading:
        """Return the contacts in the next frame, given its tared signals (..., 20)."""


FingertipConfigs = FingertipConfig | Sequence[FingertipConfig]
"""Settings of one fingertip, or of each of several that are read together."""


class FingertipEstimator:
    """Force of one fingertip, or of several (...) at once, frame by frame.

    Args:
        model: model of the force.
        config: thresholds and constants of the fingertip, or of each of several.

    Attributes:
        last: the latest estimate, or None.
        dead: (..., 19) electrodes that did not change at all during the tare.
    """

    def __init__(self, model: ForceModel, config: FingertipConfigs | None = None) -> None:
        self.model = model
        self.config = config or FingertipConfig()
        alone = isinstance(self.config, FingertipConfig)
        self._shape: tuple[int, ...] = () if alone else (len(_listed(self.config)),)

        def each(read: Callable[[FingertipConfig], ArrayLike]) -> Array:
            values = [read(own) for own in _listed(self.config)]
            return np.asarray(values[0] if alone else values)

        self._gain = each(lambda own: own.gain_matrix)
        self._drift = each(lambda own: np.broadcast_to(own.drift, 19))
        self._touch_counts = each(lambda own: own.touch_counts)
        self._release_counts = each(lambda own: own.release_counts)
        self._least_force = each(lambda own: own.least_force)
        self._rest_gain = each(lambda own: own.rest_gain)
        self._far = 0.5 * FULL_SCALE - each(lambda own: own.saturation_margin)[..., None]
        self._drift_warning = each(lambda own: own.drift_warning)
        self._touch = Debounced(each(lambda own: own.touch_frames))
        self._rest: RestState | None = None
        self._filling: Array | None = None
        self.last: TactileEstimate | None = None
        self.dead: Flags = np.zeros((*self._shape, 19), dtype=bool)

    @property
    def tared(self) -> bool:
        """Whether the rest state is known."""
        return self._rest is not None

    def tare(self, raw: ArrayLike) -> None:
        """Take frames (K, ..., 44) read without contact as the rest state.

        Raises:
            BadInputError: the frames are malformed or show a contact.
        """
        counts = check_frame(raw)
        frames = counts[None] if counts.ndim == len(self._shape) + 1 else counts
        self._expect(frames.shape[1:])
        self._rest = RestState.from_frames(frames, self._drift)
        self._touch.reset()
        self.dead = find_dead_electrodes(frames)
        self._filling = fill_dead_electrodes(self.dead) if self.dead.any() else None
        self.model.reset(self._rest.electrodes)

    def estimate(self, raw: ArrayLike) -> tuple[Array, Array, Flags]:
        """Return force (..., 3), std (..., 3) in the sensor frame, and whether there is contact.

        Args:
            raw: (..., 44) counts.

        Raises:
            NotIdentifiableError: the sensor was not tared.
            BadInputError: the frame is malformed.
        """
        result = self.observe(raw)
        return result.force, result.std, result.in_contact

    def observe(self, raw: ArrayLike) -> TactileEstimate:
        """Return everything that a frame (..., 44) says; see `estimate`."""
        if self._rest is None:
            raise NotIdentifiableError(
                "BioTac force: the rest state is unknown; tare with frames without contact"
            )
        counts = check_frame(raw)
        self._expect(counts.shape)
        warming = self._rest.warming(counts)
        change = self._rest.change(counts, warming)
        if self._filling is not None:
            change[..., ELECTRODES] = _apply(self._filling, change[..., ELECTRODES])
        force, std, point, point_std = self.model.predict(change)
        in_contact = self._feel(counts, 100.0 * change[..., PDC], np.sqrt((force**2).sum(axis=-1)))
        saturated = self._saturated(counts)
        doubt = np.where(saturated, 3.0, 1.0 + 0.3 * self.dead.sum(axis=-1))
        self.last = TactileEstimate(
            force=np.where(in_contact[..., None], _apply(self._gain, force), 0.0),
            std=doubt[..., None] * std,
            in_contact=in_contact,
            point=point,
            point_std=point_std,
            saturated=saturated,
            warming=warming,
            drifting=np.abs(warming) > self._drift_warning,
        )
        return self.last

    def _expect(self, shape: tuple[int, ...]) -> None:
        """Check that a frame is one of as many fingertips as there are."""
        if shape != (*self._shape, CHANNELS):
            raise BadInputError(
                f"BioTac frame of shape {shape}: expected {(*self._shape, CHANNELS)}"
            )

    def _feel(self, counts: Array, rise: Array, strength: Array) -> Flags:
        """Switch contacts on and off with hysteresis and debouncing; follow the rest of others.

        PDC lingers for seconds after a firm grip (creep of the skin), when the force is back at
        zero: a contact needs a force too.

        Args:
            counts: (..., 44) counts of the frame.
            rise: (...) rise of PDC, counts.
            strength: (...) magnitude of the force, N.
        """
        assert self._rest is not None
        limit = np.where(self._touch.on, self._release_counts, self._touch_counts)
        touching = (rise > limit) & (strength > self._least_force)
        in_contact = self._touch.update(touching)
        free = ~in_contact & (self._touch.streak == 0) & (rise <= self._release_counts)
        if free.any():
            self._rest = self._rest.follow(counts, self._rest_gain, free)
        return in_contact

    def _saturated(self, counts: Array) -> Flags:
        far = np.abs(counts[..., ELECTRODES] - 0.5 * FULL_SCALE) >= self._far
        return np.asarray((far & ~self.dead).any(axis=-1))


def _listed(config: FingertipConfigs) -> Sequence[FingertipConfig]:
    return [config] if isinstance(config, FingertipConfig) else config


def frame_period(config: FingertipConfigs | None) -> float:
    """Return the time between frames, s.

    Raises:
        BadInputError: it is not the same for all fingertips.
    """
    periods = {own.period for own in _listed(config or FingertipConfig())}
    if len(periods) != 1:
        raise BadInputError(f"period: {sorted(periods)} s, expected one for all fingertips")
    return periods.pop()


def find_dead_electrodes(raw: Array) -> Flags:
    """Return which electrodes (..., 19) are stuck: at an end of the range, or without any noise.

    Args:
        raw: (K, ..., 44) frames without contact; noise is judged from ten frames on.
    """
    electrodes = raw[..., ELECTRODES]
    stuck = np.all((electrodes < 50) | (electrodes > FULL_SCALE - 5), axis=0)
    if len(electrodes) >= 10:
        quiet = np.ptp(electrodes, axis=0) == 0.0
        stuck |= quiet & (quiet.sum(axis=-1, keepdims=True) < 10)
    return np.asarray(stuck)


def fill_dead_electrodes(dead: Flags) -> Array:
    """Return the matrix (..., 19, 19) that replaces changes of ``dead`` (..., 19) electrodes.

    Each becomes the mean of its live neighbours, the nearer ones counting more.
    """
    weight = _NEARNESS * ~dead[..., None, :]
    total = np.sum(weight, axis=-1, keepdims=True)
    mean = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0.0)
    return np.where(dead[..., None], mean, np.eye(19))


def _apply(matrix: Array, vector: Array) -> Array:
    """Return matrices (..., n, n) times vectors (..., n)."""
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _nearness() -> Array:
    gap = np.linalg.norm(ELECTRODE_POSITION[:, None] - ELECTRODE_POSITION, axis=-1)
    near: Array = np.exp(-((gap / 3e-3) ** 2)) * (1.0 - np.eye(len(gap)))
    return near


_NEARNESS = _nearness()
"""Weights (19, 19) by which an electrode's neighbours replace it: they fall to 1/e at 3 mm, about
the distance between neighbours. Wider makes a dead electrode the mean of all, narrower the copy of
one."""
