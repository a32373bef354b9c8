"""Which samples of a stream can be trusted, and whether it was made to the contract.

None of them is proof: a note is given, and the recording is used as it is.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.numerics.noise import quantisation_step
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams, on_lines

Mask = NDArray[np.bool_]

FORCE_LIMIT = 1e4
TORQUE_LIMIT = 1e3
POSITION_LIMIT = 1e4
ANGULAR_VELOCITY_LIMIT = 1e3
SPECIFIC_FORCE_LIMIT = 1e4
_STRAY = 50.0

QUATERNION_TOLERANCE = 1e-3
QUATERNION_SHORTEST = 0.5
QUATERNION_LONGEST = 2.0
GLITCH_DISTANCE = 0.02
GLITCH_ANGLE = 0.1
GLITCH_FACTOR = 20.0
STEP_FACTOR = 5.0
SATURATED_RUN = 5
TURNING_STEPS = 16.0
"""Steps of a quantised channel that its values have gone, at most, half a run before and after a
run of one value at which a smooth signal turns: even one that turns as flatly as t^4 and stays
within one step for a time goes 2^4 - 1 steps in half of it, and rounding adds one. At 4, as of a
parabola, weights that come to hang straight down were called a rail; a rail of a sensor that has
fewer than some 40 steps in all is not seen."""
HELD_SHARE = 0.3
HELD_REGULAR = 0.95
HELD_FEWEST = 30
GAP_SECONDS = 0.1
GAP_FACTOR = 5.0
STEP_RUN = 5
"""Samples in a row whose stamps jump from which the clock has stepped, as of live streams
(`stamps._BEHIND`): links that change the order do so among two or three."""
STEP_GAP = 0.25
"""Time left out after such a step, s: longer than any window of the motion, so that nothing is
derived across it. Stamps go on there as if the time between had not passed."""


class ProblemLog(Counter[str]):
    """Counts what was wrong with a recording, one line of text per kind of problem."""

    def note(self, where: str, what: str, count: int) -> None:
        """Add a number of occurrences of a problem; nothing is added for none."""
        if count:
            self[f"{where}: {what}"] += int(count)

    def drop(self, where: str, what: str, bad: Mask) -> Mask:
        """Count the bad samples and return the mask of the good ones."""
        self.note(where, f"{what} (dropped)", int(np.count_nonzero(bad)))
        return ~bad


def ranked_lines(problems: Mapping[str, int]) -> list[str]:
    """Return one line per kind of problem, the most frequent first."""
    ranked = sorted(problems.items(), key=lambda item: -item[1])
    return [f"{text}: {count}" for text, count in ranked]


def find_not_finite(*columns: Array) -> Mask:
    """Return which samples have a NaN or an infinity in any column."""
    finite = [np.isfinite(c).all(axis=tuple(range(1, c.ndim))) for c in columns]
    return np.asarray(~np.all(finite, axis=0))


def find_absurd(values: Array, limit: float) -> Mask:
    """Return which samples exceed what any hand, arm or sensor of this kind can show.

    Values that are large all along are in another unit, such as mN, and not absurd: what is far
    larger than most of them is.
    """
    size = np.abs(values).max(axis=1, initial=0.0)
    typical = float(np.median(size)) if len(size) else 0.0
    return np.asarray(size > max(limit, _STRAY * typical))


def find_not_increasing(time: Array) -> Mask:
    """Return the fewest samples whose removal leaves strictly increasing stamps.

    A lone stamp that is far ahead or behind is dropped alone; behind a clock that was set back
    the samples resume where the old time is passed again.
    """
    if np.all(np.diff(time) > 0):
        return np.zeros(len(time), dtype=bool)
    tails: list[float] = []
    tail_index: list[int] = []
    previous = np.full(len(time), -1)
    for index, stamp in enumerate(time.tolist()):
        rank = bisect_left(tails, stamp)
        previous[index] = tail_index[rank - 1] if rank else -1
        if rank == len(tails):
            tails.append(stamp)
            tail_index.append(index)
        else:
            tails[rank], tail_index[rank] = stamp, index
    bad = np.ones(len(time), dtype=bool)
    index = tail_index[-1]
    while index >= 0:
        bad[index] = False
        index = int(previous[index])
    return bad


def find_seams(time: Array, bad: Mask) -> Mask:
    """Return the samples just after a clock stepped back, where the motion of the step is missing.

    A run that begins again with the first stamp is a file that is there twice.

    Args:
        time: (N,) s, stamps as recorded.
        bad: (N,) those that are dropped because they do not increase.
    """
    seams = np.zeros(len(time), dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(int), [0]])))
    for first, after in zip(edges[0::2], edges[1::2], strict=True):
        back = np.diff(time[max(first - 1, 0) : after + 1]).min() < 0.0
        again = time[first:after].min() == time[0]
        if back and not again and after - first >= STEP_RUN and after < len(time):
            seams |= ~bad & (time >= time[after]) & (time < time[after] + STEP_GAP)
    return seams


def find_held(*columns: Array) -> Mask:
    """Return repetitions of a slower sensor whose last sample is published again and again.

    They come in a regular rhythm, many times, unlike those of a signal that rests now and then or
    is coarsely quantised.
    """
    same = np.all([(c[1:] == c[:-1]).all(axis=tuple(range(1, c.ndim))) for c in columns], axis=0)
    held = np.concatenate([np.zeros(min(len(columns[0]), 1), dtype=bool), same])
    if len(held) < 2 or held.mean() < HELD_SHARE:
        return np.zeros(len(held), dtype=bool)
    starts = np.flatnonzero(~held)
    lengths = np.diff(starts)
    ratio = len(held) / len(starts)
    usual = (lengths >= np.floor(ratio)) & (lengths <= np.ceil(ratio))
    regular = len(lengths) >= HELD_FEWEST and usual.mean() >= HELD_REGULAR
    return held if regular else np.zeros(len(held), dtype=bool)


def scale_quaternions(quaternion: Array) -> Array:
    """Return quaternions (N, 4) over their median length where that is far from one.

    Integers of a sensor (16384 for one) and sums that nobody normalised name rotations too.
    """
    length = np.linalg.norm(quaternion, axis=1)
    known = np.isfinite(length) & (length > 0.0)
    usual = float(np.median(length[known])) if known.any() else 1.0
    return quaternion if QUATERNION_SHORTEST < usual < QUATERNION_LONGEST else quaternion / usual


def find_bad_quaternions(quaternion: Array) -> Mask:
    """Return which quaternions are much too short or too long to name a rotation."""
    size = np.abs(quaternion).max(axis=1, initial=0.0)
    length = np.linalg.norm(np.clip(quaternion, -QUATERNION_LONGEST, QUATERNION_LONGEST), axis=1)
    return np.asarray((size > QUATERNION_LONGEST) | (length < QUATERNION_SHORTEST))


def find_glitches(position: Array, direction: Array) -> Mask:
    """Return poses that leap away from their neighbours and back within two samples.

    Args:
        position: (N, 3) m.
        direction: (N, K) unit vectors whose distance grows like an angle in rad.
    """
    if len(position) < 5:
        return np.zeros(len(position), dtype=bool)
    leaps = _leaves_and_returns(position, GLITCH_DISTANCE)
    return leaps | _leaves_and_returns(direction, GLITCH_ANGLE)


def _leaves_and_returns(values: Array, least: float) -> Mask:
    """Return samples farther from the running median than their neighbours' motion explains."""
    away = np.linalg.norm(values - _running_median(values), axis=1)
    step = float(np.median(np.linalg.norm(np.diff(values, axis=0), axis=1)))
    usual = float(np.median(away))
    return np.asarray(away > max(least, GLITCH_FACTOR * usual, STEP_FACTOR * step))


def align_signs(quaternion: Array) -> Array:
    """Choose the sign of each quaternion (N, 4) nearest to the one before it."""
    flips = np.einsum("ni,ni->n", quaternion[1:], quaternion[:-1]) < 0.0
    signs = np.where(np.concatenate([[0], np.cumsum(flips)]) % 2 == 1, -1.0, 1.0)
    return np.asarray(quaternion * signs[: len(quaternion), None])


def _running_median(values: Array) -> Array:
    """Return the median over five samples; the first and last two samples stand as they are."""
    windows = np.lib.stride_tricks.sliding_window_view(values, 5, axis=0)
    middle = np.median(windows, axis=-1)
    return np.concatenate([values[:2], middle, values[-2:]])


def find_saturated(values: Array) -> Mask:
    """Return samples in which a channel rests on its largest or smallest value.

    A rail shows as a run of identical extreme values in a channel that otherwise keeps changing,
    while other channels go on, and that comes and goes at speed.

    Args:
        values: (N, C) one column per channel.
    """
    bad = np.zeros(len(values), dtype=bool)
    far = TURNING_STEPS * np.array([quantisation_step(channel) for channel in values.T])
    for k, channel in enumerate(values.T if len(values) else ()):
        for start, stop in _extreme_runs(channel):
            quarter = (stop - start) // 4
            middle = np.ptp(np.delete(values[start + quarter : stop - quarter], k, axis=1), axis=0)
            rests = bool(len(middle)) and np.all(middle <= np.delete(far, k))
            if not rests and _is_left_at_speed(channel, start, stop, far[k]):
                bad[start:stop] = True
    return bad


def _extreme_runs(channel: Array) -> list[tuple[int, int]]:
    """Return first index and end of long runs of a channel's largest or smallest value."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(channel) != 0]))
    lengths = np.diff(np.concatenate([starts, [len(channel)]]))
    level = channel[starts]
    least = SATURATED_RUN * max(1, int(np.median(lengths)))
    long = (lengths >= least) & (lengths < len(channel)) & (level != 0.0)
    long &= (level == channel.max()) | (level == channel.min())
    return [(int(k), int(k + n)) for k, n in zip(starts[long], lengths[long], strict=True)]


def _is_left_at_speed(channel: Array, start: int, stop: int, far: float) -> bool:
    """Whether values half a run before and after it are farther away than at a smooth turn."""
    near = (stop - start) // 2
    sides = [channel[max(start - near, 0) : start], channel[stop : stop + near]]
    return all(np.abs(side - channel[start]).max() > far for side in sides if len(side))


def count_gaps(time: Array) -> int:
    """Return how many pauses are much longer than the usual sample interval."""
    if len(time) < 3:
        return 0
    steps = np.diff(time)
    return int(np.count_nonzero(steps > max(GAP_SECONDS, GAP_FACTOR * float(np.median(steps)))))


def select(mask: Mask, columns: Sequence[Array]) -> tuple[Array, ...]:
    """Apply one mask to several columns."""
    return tuple(column[mask] for column in columns)


_FEWEST = 10
_FARTHEST = 3.0
"""Distance of a contact from the object's origin that no held object has, m."""
_FARTHEST_STEP, _WIDEST_STEP = 0.1, 0.5
"""Median step from one pose to the next that no hand makes, m and rad."""
_STEADY = 0.9
"""Length of the mean net force over its mean length, from which its direction is steady."""
_UPWARD = 0.5
"""Cosine of the angle between the mean net force and up, below which it does not carry."""


def doubtful_conventions(streams: Streams) -> list[str]:
    """Return one line for each thing that a recording made to the contract does not show.

    Args:
        streams: cleaned measurements.
    """
    doubts = [_doubt_forces(list(streams.contacts.values()))]
    if streams.pose is not None and len(streams.pose.time) >= _FEWEST:
        units = _doubt_units(streams.pose, list(streams.contacts.values()))
        doubts += [units or _doubt_order(streams.pose), _doubt_tracker(streams.pose)]
    return [doubt for doubt in doubts if doubt]


def _doubt_forces(contacts: list[ContactStream]) -> str:
    """Where the net force of the contacts steadily points anywhere but up."""
    net = _net_force([c for c in contacts if len(c.time) >= _FEWEST])
    if not len(net):
        return ""
    mean = net.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if size < _STEADY * np.linalg.norm(net, axis=1).mean() or mean[2] > _UPWARD * size:
        return ""
    x, y, z = np.round(mean / size, 1) + 0.0
    return (
        f"the contact forces add up to {size:.2g} N along ({x:.1f}, {y:.1f}, {z:.1f}), but to "
        "carry the object they should point up, (0, 0, 1): negate them if they are forces on the "
        "fingers; check that z of the world is up; or something else carries the object"
    )


def _net_force(contacts: list[ContactStream]) -> Array:
    """Sum of the forces (N, 3) while any contact touches, in world axes."""
    if not contacts:
        return np.zeros((0, 3))
    time = max((c.time for c in contacts), key=len)
    each = [on_lines(c.time, c.force, time) for c in contacts]
    total = np.asarray(np.sum(each, axis=0))
    return total[np.any(each, axis=(0, 2))]


def _doubt_units(pose: PoseStream, contacts: list[ContactStream]) -> str:
    """Where contacts lie metres away from the object."""
    for contact in contacts:
        if not len(contact.pose_time):
            continue
        points = on_lines(contact.pose_time, contact.position, pose.time)
        distance = float(np.median(np.linalg.norm(points - pose.position, axis=1)))
        if distance > _FARTHEST:
            return (
                f"contact {contact.name} is {distance:.3g} m from the object's origin: positions "
                "must be in metres, of the same world frame for object and contacts"
            )
    return ""


def _doubt_order(pose: PoseStream) -> str:
    """Where poses jump from sample to sample."""
    step = float(np.median(np.linalg.norm(np.diff(pose.position, axis=0), axis=1)))
    turns = log_so3(pose.rotation[1:] @ np.swapaxes(pose.rotation[:-1], 1, 2))
    turn = float(np.median(np.linalg.norm(turns, axis=1)))
    if step < _FARTHEST_STEP and turn < _WIDEST_STEP:
        return ""
    return (
        f"the object's pose jumps by {step:.2g} m and {turn:.2g} rad from one sample to the next: "
        "check that stamps are those of the measurement and the tracker follows one object"
    )


def _doubt_tracker(pose: PoseStream) -> str:
    """Where the pose is the same to the last digit all along."""
    if np.any(pose.position != pose.position[0]) or np.any(pose.rotation != pose.rotation[0]):
        return ""
    return (
        f"the object's pose never changes ({len(pose.time)} equal samples): check the tracker; "
        "an object at rest shows no inertia"
    )
