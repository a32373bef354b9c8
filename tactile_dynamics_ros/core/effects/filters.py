"""Linear filters along time with exact derivatives: first-order lag and spring-damper."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

_GAP = 1.8


def uniform_segments(time: Array) -> list[slice]:
    """Stretches of samples without gaps longer than 1.8 periods."""
    if len(time) < 2:
        return [slice(0, len(time))]
    steps = np.diff(time)
    edges = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    bounds = [0, *edges.tolist(), len(time)]
    return [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def sample_period(time: Array) -> float:
    """Median period, s."""
    return float(np.median(np.diff(time))) if len(time) > 1 else 1.0


def first_order_lag(time: Array, values: Array, tau: float) -> tuple[Array, Array]:
    """Response y of ``tau y' + y = u`` from rest at the first value, and d y / d tau.

    Exact for values that are linear between samples; each uniform stretch starts settled.

    Args:
        time: (N,) s.
        values: (N, ...) u.
        tau: s, positive.

    Returns:
        y and dy/dtau, both (N, ...).
    """
    ratio = sample_period(time) / tau
    decay = np.exp(-ratio)
    mean = (1.0 - decay) / ratio
    change_of_decay = decay * ratio / tau
    change_of_mean = mean / tau - change_of_decay / ratio
    now, before = 1.0 - mean, mean - decay
    now_change, before_change = -change_of_mean, change_of_mean - change_of_decay
    response, change = np.empty_like(values), np.empty_like(values)
    for part in uniform_segments(time):
        u = values[part] - values[part][:1]
        y = lfilter([now, before], [1.0, -decay], u, axis=0)
        shifted = np.concatenate([np.zeros_like(y[:1]), y[:-1]])
        earlier = np.concatenate([np.zeros_like(u[:1]), u[:-1]])
        drive = change_of_decay * shifted + now_change * u + before_change * earlier
        response[part] = y + values[part][:1]
        change[part] = lfilter([1.0], [1.0, -decay], drive, axis=0)
    return response, change


def integrate_linear(system: Array, drive: Array, start: Array) -> Array:
    """States of s_k+1 = A_k s_k + d_k, in about sqrt(N) blocks that advance side by side.

    Each block is integrated from zero together with its transition matrix; the states at the
    beginnings of the blocks follow one from the other.

    Args:
        system: (N - 1, S, S).
        drive: (N - 1, S, m).
        start: (S, m).

    Returns:
        (N, S, m).
    """
    count, size = drive.shape[:2]
    length = max(1, math.isqrt(count))
    blocks = -(-count // length)
    spare = blocks * length - count
    steps = np.concatenate([system, np.tile(np.eye(size), (spare, 1, 1))])
    pushes = np.concatenate([drive, np.zeros((spare, *drive.shape[1:]))])
    joined = np.concatenate([steps, pushes], axis=2)
    joined = joined.reshape(blocks, length, size, joined.shape[2])
    for k in range(1, length):
        onwards = joined[:, k, :, :size] @ joined[:, k - 1]
        onwards[..., size:] += joined[:, k, :, size:]
        joined[:, k] = onwards
    begin = np.empty((blocks + 1, *start.shape))
    begin[0] = start
    for k in range(blocks):
        begin[k + 1] = joined[k, -1, :, :size] @ begin[k] + joined[k, -1, :, size:]
    states = joined[..., :size] @ begin[:-1, None] + joined[..., size:]
    return np.concatenate([start[None], states.reshape(-1, *start.shape)[:count]])
