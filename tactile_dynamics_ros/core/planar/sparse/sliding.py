"""Friction coefficient from objects that slide on by themselves after the pusher has stopped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import Link, Linkage, placed, turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import StepConfig, simulate
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams

_STOPPED = 0.2
"""Speed of the pusher over its largest in the tenth of a second before, below which it has stopped:
an object with friction of 0.5 on its own loses less than that within two poses of 100 Hz."""
_AFTER = 0.4
"""s after a stop that are looked at: at 0.3 m/s what slides rests within 0.2 s from 0.15 on."""
_LEAST_POSES = 5
"""Poses of a slide from which it is fitted: three say how a motion bends, two are beside it."""
_ABOVE_NOISE = 6.0
"""Way of a slide, and gap that it opens, over the noise of poses: of shorter ones nothing is known
to better than a third, and it is not sure that the tip let go."""
_ROUNDS = 8
"""Gauss-Newton steps; four suffice."""
_STEPS = np.array([0.02, 1e-4, 1e-4, 1e-3, 2e-3, 2e-3, 2e-2])
"""Differences by ln friction, pose (m, m, rad) and twist (m/s, m/s, rad/s) at the start of a slide:
far below what they move poses by, far above rounding."""
_SCATTER = 0.1
"""Relative std of friction from place to place of real tables, as the prior of `fit_sparse`."""


_CURVED = 2.0
"""Factor on the std of a slide: where a slide comes to rest its poses have a kink, of which the
slopes at the optimum know nothing. Seven slides of seeds 9300 to 9327 were off by 1.7 of their
std, the largest by 3.5; at 1 one coefficient of three is off by a third at a stated eighth."""


@dataclass(frozen=True, eq=False)
class Sliding:
    """What free slides tell.

    Attributes:
        friction: coefficient and its std; None where nothing slid on by itself.
        slides: how many did.
    """

    friction: tuple[float, float] | None
    slides: int


def friction_from_slides(streams: PushedStreams, centre: Array) -> Sliding:
    """Friction coefficient from the deceleration of free slides; no force, no mass.

    m dv/dt = -mu sum_i p_i g v_i / |v_i|, solved over the footprint from an unknown pose and twist.

    Args:
        streams: poses of one part at 30 Hz or more, and the pusher's path.
        centre: (2,) m, of mass, link frame.
    """
    link = streams.links[0]
    height = _com_height(streams)
    found = []
    for contact in streams.contacts.values():
        for start, stop in _stops(contact):
            rows = np.flatnonzero((link.time >= start) & (link.time <= stop))
            fitted = _fitted(link, contact, rows, centre, height)
            if fitted is not None:
                found.append(fitted)
    if not found:
        return Sliding(None, 0)
    value, std = np.array(found).T
    weight = 1.0 / (std**2 + _SCATTER**2)
    mean = float(weight @ value / weight.sum())
    misfit = float(weight @ (value - mean) ** 2) / max(len(found) - 1, 1)
    relative = float(np.sqrt(max(misfit, 1.0) / weight.sum()))
    return Sliding((float(np.exp(mean)), float(np.exp(mean)) * relative), len(found))


def _com_height(streams: PushedStreams) -> float:
    """Height of the centre of mass, m; where it is not known, that of the push."""
    if streams.com_height is not None:
        return float(streams.com_height[0])
    return float(np.median(np.concatenate([c.point[:, 2] for c in streams.contacts.values()])))


def _stops(contact: PushContact) -> list[tuple[float, float]]:
    """Spans, s, from where the pusher has stopped until it moves again, at most `_AFTER`."""
    time = contact.pose_time
    if len(time) < _LEAST_POSES:
        return []
    lag = max(1, round(0.02 / float(np.median(np.diff(time)))))
    way = np.linalg.norm(contact.point[lag:, :2] - contact.point[:-lag, :2], axis=1)
    speed = way / (time[lag:] - time[:-lag])
    after, window = time[lag:], round(0.1 / float(np.median(np.diff(time)))) + 1
    before = np.array([speed[max(0, k - window) : k + 1].max() for k in range(len(speed))])
    still = speed < _STOPPED * before
    starts = np.flatnonzero(still & ~np.append(False, still[:-1]))
    spans = []
    for k in starts:
        moving = np.flatnonzero(speed[k:] > before[k])
        end = after[k + moving[0] - lag] if len(moving) else np.inf
        spans.append((float(after[k]), float(min(end, after[k] + _AFTER))))
    return spans


def _fitted(
    link: LinkStream,
    contact: PushContact,
    rows: NDArray[np.intp],
    centre: Array,
    height: float,
) -> tuple[float, float] | None:
    """Ln of friction and its std from the poses of a slide; None where it is none."""
    if len(rows) < _LEAST_POSES:
        return None
    time, pose, noise = link.time[rows], link.pose[rows], link.presumed_pose_std
    middle = placed(np.tile(centre, (len(pose), 1)), pose)
    way = float(np.linalg.norm(middle[-1] - middle[0]))
    tip = np.array([np.interp(time, contact.pose_time, part) for part in contact.point.T[:2]]).T
    own = turned(tip - pose[:, :2], -pose[:, 2])
    gap = -nearest_edge(link.footprint, edge_normals(link.footprint), own)[0]
    if min(way, float(gap[-1] - gap[0])) < _ABOVE_NOISE * noise[0]:
        return None
    velocity = (pose[2] - pose[0]) / (time[2] - time[0])
    speed = float(np.linalg.norm(velocity[:2]))
    numbers = np.array([np.log(speed**2 / (2.0 * 9.81 * way)), *pose[0], *velocity])
    for _ in range(_ROUNDS):
        variants = np.vstack([numbers, numbers + np.diag(_STEPS)])
        told = _slid(link.footprint, variants, time - time[0], centre, height)
        slope = (told[1:] - told[:1]).transpose(1, 2, 0) / _STEPS
        lack = (pose - told[0]) / noise
        rows_by = (slope / noise[:, None]).reshape(-1, len(numbers))
        step = np.linalg.lstsq(rows_by, lack.ravel(), rcond=None)[0]
        numbers = numbers + np.clip(step, -25.0 * _STEPS, 25.0 * _STEPS)
    freedom = lack.size - len(numbers)
    error = float(np.sqrt(np.sum(lack**2) / freedom))
    covariance = np.linalg.pinv(rows_by.T @ rows_by)
    std = _CURVED * max(error, 1.0) * float(np.sqrt(covariance[0, 0]))
    return (float(numbers[0]), std) if np.isfinite(numbers[0]) and std < 1.0 else None


def _slid(outline: Array, variants: Array, time: Array, centre: Array, height: float) -> Array:
    """Poses (B, T, 3) at times (T,) s of objects that slide freely from numbers (B, 7)."""
    count, patch = len(variants), SupportPatch(outline, 36)
    same = np.ones(count)
    inertia = patch.gyration + float(np.sum((centre - patch.centroid) ** 2))
    body = Link(
        patch, same, np.exp(variants[:, 0]), np.tile(centre, (count, 1)), height * same,
        inertia * same, same,
    )  # fmt: skip
    config = StepConfig(step=2e-3, rounds=3)
    steps = int(np.ceil(time[-1] / config.step)) + 1
    away = np.full((count, steps + 1, 3), 1e3)  # the pusher is nowhere near
    arm = turned(body.com, variants[:, 3])
    twist = variants[:, 4:].copy()
    twist[:, :2] += twist[:, 2:] * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    nobody = Tip(outline, 0.0 * same, same)
    start = variants[:, None, 1:4]
    motion = simulate(Linkage((body,)), nobody, start, away, config, twist[:, None])
    at = np.clip(time / config.step, 0, steps)
    low = np.floor(at).astype(np.intp)
    share = (at - low)[None, :, None]
    high = np.minimum(low + 1, steps)
    pose = motion.pose[:, :, 0]
    return np.asarray((1.0 - share) * pose[:, low] + share * pose[:, high])
