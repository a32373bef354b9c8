"""Noise of sampled signals and residuals: its level, spikes, values that repeat."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import accumulated_rotation
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    between_turns,
    nearest_samples,
)

_ORDER = 6
"""Order of the differences in which noise is seen. Of a force of 4 Hz at 100 Hz sixth differences
leave 8e-6, of 10 Hz 0.2 %, so that motion does not count as noise. Lower orders leave motion in,
higher ones need longer runs without a gap."""
_MINIMUM_SAMPLES = 20
"""Samples from which noise is read: it is then known to 26 %. Below, what is stated or a fallback
is used. Fewer would trust noise that is known to no more than a half, more leaves short recordings
to fallbacks."""
_SHORTEST, _LONGEST = 0.3, 1.7
"""Steps between samples, in periods, that are no gap and no burst: jitter of a third of a period
and more passes, a lost sample (2) does not. Divided differences of shorter steps see little but
those. Wider bounds let noise be read across gaps, narrower ones leave jittery streams without
samples."""

_ON_STEPS = 0.95
"""Share of the samples that lie on multiples of a step from which a signal is quantised: the others
were interpolated or made up by a driver. Of a fine signal 0.2 % lie on any step by chance."""
_OFF_STEP = 1e-3
"""Distance, in steps, from such a multiple that rounding of printed or stored numbers leaves."""
_MOST_LOOKED_AT = 3000
"""Samples, spread evenly, in which steps are looked for: a signal of 20 bits that turns has as many
levels in them."""


def white_noise_std(time: Array, values: Array) -> float:
    """Standard deviation of the white part, from sixth differences of the samples.

    std = 1.4826 median|D^6 x|, D^6 being divided differences of unit noise: smooth motion vanishes
    under them however unevenly it is sampled, and the median ignores gaps and spikes.

    Args:
        time: (N,) s; windows with gaps are left out.
        values: (N, d).

    Returns:
        One standard deviation for all columns; 0 if there are fewer than 20 samples.
    """
    differences, _ = _differences(time, values)
    return _spread(differences)


def noise_along_axes(contact: ContactStream, values: Array) -> Array:
    """`white_noise_std` (3,) of forces or torques (N, 3) along each axis of the contact frame.

    Args:
        contact: whose frame turns with the sensor.
        values: world axes, at the times of the contact's forces.
    """
    differences, middle = _differences(contact.time, values)
    axes = contact.rotation[nearest_samples(contact.pose_time, contact.time[middle])]
    along = np.einsum("nji,nj->ni", axes, differences)
    return np.array([_spread(along[:, [k]]) for k in range(3)])


def quantisation_step(values: Array) -> float:
    """Step of a signal (N,) all of whose values are multiples of it, but for a constant; else 0."""
    known = values[np.isfinite(values)]
    scale = float(np.ptp(known)) if len(known) else 0.0
    if scale == 0.0:
        return 0.0
    levels, counts = np.unique(np.round(known / scale, 9), return_counts=True)
    step = float(np.quantile(np.diff(levels), 0.1))
    steps = (levels - levels[np.argmax(counts)]) / step
    on_steps = np.abs(steps - np.round(steps)) < _OFF_STEP
    return scale * step if counts[on_steps].sum() >= _ON_STEPS * len(known) else 0.0


def rounding_noise(contact: ContactStream, values: Array) -> Array:
    """Standard deviation (3,) that coarse steps of a sensor add along each axis of its frame.

    std = step / sqrt(12): the error is spread evenly over one step.

    Args:
        contact: whose frame turns with the sensor.
        values: forces or torques (N, 3) in world axes, at the times of the contact's forces.
    """
    looked = np.linspace(0, len(values) - 1, min(len(values), _MOST_LOOKED_AT)).astype(int)
    turned = between_turns(contact.pose_time, contact.rotation, contact.time[looked])
    along = np.einsum("nji,nj->ni", turned, values[looked])
    return np.array([quantisation_step(axis) / math.sqrt(12.0) for axis in along.T])


def _differences(time: Array, values: Array) -> tuple[Array, NDArray[np.intp]]:
    """Sixth divided differences (n, d) of unit noise, and the sample (n,) in the middle.

    sum_k w_k x_k, w_k ~ 1 / prod_(j != k) (t_k - t_j), sum_k w_k^2 = 1.
    """
    if len(time) < _MINIMUM_SAMPLES:
        return values[:0], np.zeros(0, dtype=np.intp)
    steps = np.diff(time) / np.median(np.diff(time))
    regular = (steps > _SHORTEST) & (steps < _LONGEST)
    complete = np.lib.stride_tricks.sliding_window_view(regular, _ORDER).all(axis=1)
    start = np.flatnonzero(complete)
    window = start[:, None] + np.arange(_ORDER + 1)
    place = np.concatenate([[0.0], np.cumsum(steps)])[window]
    between = place[:, :, None] - place[:, None, :] + np.eye(_ORDER + 1)
    weights = 1.0 / np.prod(between, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    change = values[window] - values[start][:, None]
    return np.einsum("nk,nkd->nd", weights, change), start + _ORDER // 2


def _spread(differences: Array) -> float:
    """Standard deviation of the samples behind differences; 0 if there are none."""
    return float(1.4826 * np.median(np.abs(differences))) if len(differences) else 0.0


def white_pose_noise_std(time: Array, rotation: Array, position: Array) -> tuple[float, float]:
    """`white_noise_std` of the orientation (rad) and of the position (m) of a stream of poses.

    Args:
        time: (N,) s.
        rotation: (N, 3, 3).
        position: (N, 3) m.
    """
    return white_noise_std(time, accumulated_rotation(rotation)), white_noise_std(time, position)


_SPIKE = 7.0
"""Largest of six white numbers of a sample from which it may be a spike: noise exceeds 7 in 1.5
samples of 10^11. Lower takes noise of long recordings out; of what lies below a Huber weight (live)
or the diagnosis takes care."""
_NEIGHBOURHOOD = 9
"""Samples over whose median a spike must stand out threefold: 90 ms at 100 Hz. What lasts longer
than half of it is misfit, and left to the diagnosis. Fewer samples let two spikes in a row hide
each other, more let a misfit of a tenth of a second pass for spikes."""
_FRAME = 128
"""Samples of a frame whose spectrum tells noise from misfit: 1.28 s at 100 Hz, lines of 0.8 Hz.
Shorter frames do not resolve the motion (0.5 to 2 Hz) from noise, longer ones blur when a misfit
begins."""
_MISFIT = 1.7
"""Power of white numbers, averaged over six channels and nine neighbouring cells of the spectrum,
from which a cell holds more than noise: white noise exceeds 1.7 in 1.3 cells of a thousand. At 1.35
it would be 3 %, and that much noise of clean recordings would count as misfit."""


def isolated_outlier_variance(white_residual: Array, residual: Array) -> Array:
    """Extra residual variance for samples that stick out of their neighbourhood.

    A sample is a spike if its largest whitened component exceeds 7 and three times the median of
    the nine samples around it: a persisting misfit is left to the diagnosis.

    Args:
        white_residual: (6 N,).
        residual: (N, 6).

    Returns:
        (N,) variance to add, zero for ordinary samples.
    """
    size = np.abs(white_residual.reshape(-1, 6)).max(axis=1)
    typical = median_filter(size, _NEIGHBOURHOOD, mode="nearest")
    spike = (size > _SPIKE) & (size > 3.0 * typical)
    return np.asarray(np.where(spike, 10.0 * np.sum(residual**2, axis=1), 0.0))


def expected_noise(white_residual: Array) -> Array:
    """Noise that is expected in a white residual, given its spectrum around each time.

    Where something that the model lacks adds variance s^2 to white unit noise, the expected noise
    is r / (1 + s^2). The power of frames of 128 samples estimates 1 + s^2 by frequency: what a
    model lacks follows the motion, which is slower than most of the noise.

    Args:
        white_residual: (6 N,).

    Returns:
        (6 N,) of no more power than the residual.

    Source: Wiener 1949.
    """
    rows = white_residual.reshape(-1, 6)
    half = min(_FRAME // 2, len(rows) // 2)
    window = np.sin(np.pi * np.arange(2 * half) / (2 * half)) ** 2
    spectra = np.fft.rfft(_frames(rows, half) * window[:, None], axis=1)
    power = np.mean(np.abs(spectra) ** 2, axis=2) / np.sum(window**2)
    power = uniform_filter(power, 3, mode="nearest")
    share = np.where(power > _MISFIT, 1.0 / np.maximum(power, 1.0), 1.0)
    dual = window / (window**2 + np.roll(window, half) ** 2)
    noise = np.fft.irfft(spectra * share[..., None], 2 * half, axis=1) * dual[:, None]
    return _overlapped(noise, len(rows)).reshape(-1)


def _frames(rows: Array, half: int) -> Array:
    """Frames (F, 2 half, 6) of rows (N, 6), each half a frame after the last; zeros beyond."""
    count = -(-(len(rows) - 1) // half)
    padded = np.zeros(((count + 2) * half, rows.shape[1]))
    padded[half : half + len(rows)] = rows
    halves = padded.reshape(count + 2, half, -1)
    return np.concatenate([halves[:-1], halves[1:]], axis=1)


def _overlapped(frames: Array, count: int) -> Array:
    """Sum (count, 6) of overlapping frames, where the rows of `_frames` were."""
    half = frames.shape[1] // 2
    total = np.zeros((len(frames) + 1, half, frames.shape[2]))
    total[:-1] += frames[:, :half]
    total[1:] += frames[:, half:]
    return total.reshape(-1, frames.shape[2])[half : half + count]


Mask = NDArray[np.bool_]

STUCK = 10
"""Equal forces in a row, all three axes to the last bit, that are no chance: a sensor whose noise
is a fifth of its step still repeats itself so often once in ten million rows. Fewer call coarse
sensors stuck, more believe a stuck one for longer (10 are 0.1 s at 100 Hz)."""
_ROUNDING = 1e-9
"""Relative change of a force that is rounding: what a sensor repeats is turned into the world by
rotations of 16 digits. Larger than 1e-6 would call quiet sensors stuck."""
FROZEN = 8
"""Equal poses in a row that are no chance: a camera of 15 Hz that is published at 100 Hz repeats
each pose seven times. Fewer would refuse such a camera, more believe a tracker that hangs for
longer."""


def repeated_forces(in_world: Array, in_sensor: Array, lost: Mask) -> Mask:
    """Whether forces (N - 1, C) are those of the row before, in the world or in the sensor.

    Args:
        in_world: (N, C, 3) N.
        in_sensor: (N, C, 3) N, the same in the axes of each sensor.
        lost: (N,) whether a row has no reading that could repeat one.
    """
    found = np.zeros((max(len(in_world) - 1, 0), in_world.shape[1]), dtype=bool)
    for force in (in_world, in_sensor):
        change = np.abs(np.diff(force, axis=0)).max(axis=2)
        found |= change <= _ROUNDING * np.abs(force[1:]).max(axis=2)
    loaded = np.any(in_world[1:] != 0.0, axis=2)
    return np.asarray(found & loaded & ~lost[1:, None])


def repeated_poses(position: Array, rotation: Array) -> Mask:
    """Whether poses (N - 1,) are those of the row before; (N, 3) m and (N, 3, 3)."""
    same = np.all(position[1:] == position[:-1], axis=1)
    return np.asarray(same & np.all(rotation[1:] == rotation[:-1], axis=(1, 2)))


def in_runs(same: Mask, least: int) -> Mask:
    """Whether each of N + 1 rows is part of a run of at least `least` equal rows.

    Args:
        same: (N, C) whether a row equals the one before it.
        least: rows.
    """
    runs = np.zeros((len(same) + 1, same.shape[1]), dtype=bool)
    if len(same) < least - 1:
        return runs
    whole = np.all(sliding_window_view(same, least - 1, axis=0), axis=2)
    for shift in range(least):
        runs[shift : shift + len(whole)] |= whole
    return runs
