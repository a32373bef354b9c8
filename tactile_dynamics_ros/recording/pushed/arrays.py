"""Streams of a pushed object from named arrays; see `PushedRecording.from_arrays`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.recording.arrays import start_at_zero, streams_from_arrays
from tactile_dynamics_ros.recording.cleaning import ProblemLog
from tactile_dynamics_ros.recording.pushed.on_support import Support, anticlockwise

Array = NDArray[np.float64]

_MOST_LINKS = 2
"""Parts that an estimate takes, as in recordings."""


def pushes_from_arrays(
    contacts: Mapping[str, Mapping[str, Any]],
    links: Sequence[Mapping[str, Any]],
    contact_frame: str,
    support: Support,
    source: str,
) -> tuple[PushedStreams, ProblemLog, float]:
    """Return cleaned streams, what had to be cleaned, and the time taken off, s.

    Raises:
        BadInputError: an array is missing, unknown or of the wrong shape, or there are no parts or
            too many.
    """
    if not 1 <= len(links) <= _MOST_LINKS:
        raise BadInputError(f"{source}: {len(links)} links; expected one or two")
    stds = {name: arrays.get("point_std") for name, arrays in contacts.items()}
    plain = {name: _without(arrays, "point_std") for name, arrays in contacts.items()}
    outlines, poses = [], []
    for k, link in enumerate(links, start=1):
        if "footprint" not in link:
            raise BadInputError(f"{source}: link_{k} has no footprint; expected corners (V, 2), m")
        corners = np.asarray(link["footprint"], dtype=np.float64)
        outlines.append(anticlockwise(corners, f"{source}: footprint of link_{k}"))
        poses.append(_spatial(_without(link, "footprint")))
    streams, log = streams_from_arrays(plain, poses[0], None, contact_frame, source)
    streams, start = start_at_zero(streams)
    others = [
        streams_from_arrays({}, _earlier(pose, start), None, "world", source)[0].pose
        for pose in poses[1:]
    ]
    parts = [pose for pose in (streams.pose, *others) if pose is not None]
    return (
        PushedStreams(
            tuple(support.link(*pair) for pair in zip(parts, outlines, strict=True)),
            {
                name: support.contact(contact, _scalar(stds[name]))
                for name, contact in streams.contacts.items()
            },
            support.gravity,
        ),
        log,
        start,
    )


def _without(arrays: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in arrays.items() if name != key}


def _earlier(arrays: dict[str, Any], start: float) -> dict[str, Any]:
    return arrays | {"time": np.asarray(arrays["time"], dtype=np.float64) - start}


def _scalar(std: Any) -> float | None:
    """One standard deviation per axis."""
    return None if std is None else float(np.mean(np.asarray(std, dtype=np.float64)))


def _spatial(arrays: dict[str, Any]) -> dict[str, Any]:
    """Poses with x, y and yaw as such of space, at height zero."""
    found = dict(arrays)
    if "yaw" in found:
        yaw = np.asarray(found.pop("yaw"), dtype=np.float64)
        found["rotation"] = exp_so3(yaw[:, None] * np.array([0.0, 0.0, 1.0]))
    position = np.asarray(found.get("position", ()), dtype=np.float64)
    if position.ndim == 2 and position.shape[1] == 2:
        found["position"] = np.column_stack([position, np.zeros(len(position))])
    return found
