"""Faults of what a robot's drivers write into messages: noise, clocks, poses, forces, bytes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.replay.changes import (
    Change,
    delayed,
    doubled,
    each,
    framed,
    frozen,
    garbled,
    numbers,
    put,
    scaled,
    shifted,
    silent,
    thinned,
)
from benchmarks.replay.stream_faults import FINGER, RIVAL, StreamFault
from benchmarks.replay.tape import NANOSECONDS, Message
from tactile_dynamics_ros.core.array import Array

TENTH_NS = NANOSECONDS // 10
OTHER = "thumb"
"""The finger whose topics are confused with those of the one at fault."""
_COVARIANCE = slice(7, 43)
"""Doubles of the covariance in a pose of the object."""
_SHAKE = np.random.default_rng(0)
"""Source of noise that is put on top; the rows need no particular draw."""


def _covariance(variance: float) -> Change:
    """State the same variance of all six."""
    return _matrix(np.diag(np.full(6, variance)))


def _matrix(covariance: Array) -> Change:
    def changed(values: Array) -> Array:
        values[_COVARIANCE] = covariance.ravel()
        return values

    return numbers(changed, stream="object")


def _std(value: float) -> Change:
    return numbers(lambda std: np.full_like(std, value), stream="force_std", finger=FINGER)


def _swapped_axes(values: Array) -> Array:
    values[[0, 1]] = values[[1, 0]]
    return values


def _moved(*shift: float) -> Change:
    """Shift the places of poses, m."""

    def changed(values: Array) -> Array:
        values[:3] += shift
        return values

    return numbers(changed, stream="object")


def _turned(order: tuple[int, ...], signs: tuple[int, ...] = (1, 1, 1, 1)) -> Change:
    """Write the quaternion in another order, or with other signs."""

    def changed(values: Array) -> Array:
        values[3:7] = values[3:7][list(order)] * np.array(signs)
        return values

    return numbers(changed, stream="object")


def _scaled_part(factor: float, part: slice, stream: str, finger: str = "") -> Change:
    def changed(values: Array) -> Array:
        values[part] *= factor
        return values

    return numbers(changed, stream=stream, finger=finger)


def _noisy(std: float, part: slice, stream: str, finger: str = "") -> Change:
    def changed(values: Array) -> Array:
        values[part] += std * _SHAKE.normal(size=3)
        return values

    return numbers(changed, stream=stream, finger=finger)


def _rounded(values: Array) -> Array:
    values[:3] = np.round(values[:3], 3)
    return values


def _offset(values: Array) -> Array:
    values[0] += 1.0
    return values


def _saturated(values: Array) -> Array:
    return np.clip(values, -0.8, 0.8)


def _confused(messages: list[Message]) -> Iterator[Message]:
    """Exchange the forces of two fingers."""
    names = {FINGER: OTHER, OTHER: FINGER}
    for message in messages:
        other = names.get(message.finger) if message.stream == "force" else None
        yield replace(message, topic=f"/contact/{other}/force") if other else message


def _jittered(messages: list[Message]) -> Iterator[Message]:
    """Let each stamp of the poses be off by up to 3 ms."""
    for message in messages:
        off = int(_SHAKE.uniform(-3e-3, 3e-3) * NANOSECONDS)
        moved = message.stream == "object"
        yield replace(message, stamp_ns=message.stamp_ns + off) if moved else message


_RING = {"finger": FINGER}
_FORCE = {"stream": "force", "finger": FINGER}
_PLACE = {"stream": "pose", "finger": FINGER}
_OBJECT = {"stream": "object"}
_INDEFINITE = 1e-6 * (np.eye(6) + 2.0 * (np.eye(6, k=1) + np.eye(6, k=-1)))

INPUT_FAULTS = (
    # what is stated of the noise
    StreamFault("covariance_1e6", _covariance(1e6)),
    StreamFault("covariance_1", _covariance(1.0)),
    StreamFault("covariance_0", _covariance(0.0), lossless=True),
    StreamFault("covariance_1e-18", _covariance(1e-18)),
    StreamFault("covariance_negative", _covariance(-1e-6)),
    StreamFault("covariance_indefinite", _matrix(_INDEFINITE)),
    StreamFault("covariance_nan", _covariance(np.nan)),
    StreamFault("covariance_inf", _covariance(np.inf)),
    StreamFault("covariance_0_always", _covariance(0.0), whole=True, lossless=True),
    StreamFault("covariance_1e-18_always", _covariance(1e-18), whole=True),
    StreamFault("force_std_0", _std(0.0)),
    StreamFault("force_std_negative", _std(-0.03)),
    StreamFault("force_std_nan", _std(np.nan)),
    StreamFault("force_std_inf", _std(np.inf)),
    StreamFault("force_std_silent", silent(stream="force_std"), lossless=True),
    # clocks
    StreamFault("clock_steps_back_0.9s", shifted(-9 * TENTH_NS), -9 * TENTH_NS),
    StreamFault("clock_steps_back_0.3s", shifted(-3 * TENTH_NS), -3 * TENTH_NS),
    StreamFault("clock_steps_ahead_0.9s", shifted(9 * TENTH_NS), 9 * TENTH_NS),
    StreamFault("finger_behind_0.9s", shifted(-9 * TENTH_NS, **_RING)),
    StreamFault("finger_ahead_0.5s", shifted(5 * TENTH_NS, **_RING)),
    StreamFault("pose_behind_0.5s", shifted(-5 * TENTH_NS, **_OBJECT)),
    StreamFault("pose_stamps_jitter_3ms", _jittered, lossless=True),
    StreamFault("pose_delayed_0.3s", delayed(0.3, **_OBJECT), lossless=True),
    StreamFault("forces_delayed_0.3s", delayed(0.3, stream="force"), lossless=True),
    # poses of the object
    StreamFault("pose_nan", put(np.nan, 0, **_OBJECT)),
    StreamFault("pose_inf", put(np.inf, 2, **_OBJECT)),
    StreamFault("quaternion_0", _turned((0, 1, 2, 3), (0, 0, 0, 0))),
    StreamFault("quaternion_wxyz", _turned((3, 0, 1, 2))),
    StreamFault("quaternion_inverse", _turned((0, 1, 2, 3), (-1, -1, -1, 1))),
    StreamFault("quaternion_length_2", _turned((0, 1, 2, 3), (2, 2, 2, 2))),
    StreamFault("pose_mm", _scaled_part(1e3, slice(3), "object")),
    StreamFault("pose_axes_swapped", numbers(_swapped_axes, **_OBJECT)),
    StreamFault("pose_frame_camera", framed("camera", **_OBJECT)),
    StreamFault("pose_frame_empty", framed("", **_OBJECT)),
    StreamFault("pose_moved_5cm", _moved(0.05, 0.0, 0.0)),
    StreamFault("pose_moved_1m", _moved(0.0, 1.0, 0.0)),
    StreamFault("pose_noise_1cm", _noisy(0.01, slice(3), "object")),
    StreamFault("pose_rounded_1mm", numbers(_rounded, **_OBJECT), lossless=True),
    StreamFault("pose_10hz", thinned(lambda n: n % 10 == 0, **_OBJECT)),
    StreamFault("pose_half_lost", thinned(lambda n: n % 2 == 0, **_OBJECT)),
    StreamFault("pose_silent", silent(**_OBJECT)),
    StreamFault("pose_twice", doubled(2, **_OBJECT)),
    # forces and places of contacts
    StreamFault("force_nan", put(np.nan, 1, **_FORCE)),
    StreamFault("force_inf", put(np.inf, 1, **_FORCE)),
    StreamFault("force_frame_sensor", framed("ring_tip", **_FORCE)),
    StreamFault("force_axes_swapped", numbers(_swapped_axes, **_FORCE)),
    StreamFault("force_half", _scaled_part(0.5, slice(3), "force", FINGER)),
    StreamFault("forces_gram", scaled(101.97, "force", "force_std")),
    StreamFault("force_off_1n", numbers(_offset, **_FORCE)),
    StreamFault("force_flipped", _scaled_part(-1.0, slice(3), "force", FINGER)),
    StreamFault("force_noise_1n", _noisy(1.0, slice(3), "force", FINGER)),
    StreamFault("force_saturated", numbers(_saturated, **_FORCE)),
    StreamFault("force_silent", silent(**_FORCE)),
    StreamFault("force_half_lost", thinned(lambda n: n % 2 == 0, **_FORCE), lossless=True),
    StreamFault("force_flood_10_times", doubled(10, **_FORCE)),
    StreamFault("fingers_confused", _confused),
    StreamFault("payload_18_percent", scaled(1.18, "force")),
    StreamFault("contact_pose_nan", put(np.nan, 0, **_PLACE)),
    StreamFault("contact_pose_frame_tip", framed("ring_tip", **_PLACE)),
    StreamFault("contact_quaternion_0", numbers(lambda v: 0.0 * v, **_PLACE)),
    StreamFault("contact_pose_silent", silent(**_PLACE)),
    StreamFault("contact_pose_frozen", frozen(**_PLACE)),
    StreamFault("contact_pose_mm", _scaled_part(1e3, slice(3), "pose", FINGER)),
    # who sends, and bytes
    StreamFault("rival_forces", doubled(2, RIVAL, 0.004, **_FORCE)),
    StreamFault("rival_contact_poses", doubled(2, RIVAL, 0.004, **_PLACE)),
    StreamFault("all_silent", silent()),
    StreamFault("finger_missing_always", silent(**_RING), whole=True, anew=True),
    StreamFault("no_forces_always", silent(stream="force"), whole=True, anew=True),
    StreamFault("pose_empty_bytes", garbled(lambda raw: b"", **_OBJECT)),
    StreamFault("pose_zero_bytes", garbled(lambda raw: bytes(len(raw)), **_OBJECT)),
    StreamFault("force_cut_short", garbled(lambda raw: raw[:-9], **_FORCE)),
    StreamFault("force_other_endian", garbled(lambda raw: b"\x00\x00" + raw[2:], **_FORCE)),
    StreamFault("stamps_negative", each(lambda m: replace(m, stamp_ns=-1, absolute=True))),
)
