"""Streams of a pushed object from named arrays, and as they lie on a support."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact, PushedStreams
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream
from tactile_dynamics_ros.recording.arrays import start_at_zero, streams_from_arrays
from tactile_dynamics_ros.recording.cleaning import ProblemLog

GRAVITY_W = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True)
class Support:
    """Axes of a support, z its normal upwards.

    Attributes:
        place: (3,) origin in the world, m.
        R_WS: (3, 3) axes in the world.
    """

    place: Array = field(default_factory=lambda: np.zeros(3))
    R_WS: Array = field(default_factory=lambda: np.eye(3))

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2 in axes of the support."""
        return np.asarray(self.R_WS.T @ GRAVITY_W)

    def link(self, pose: PoseStream, footprint: Array) -> LinkStream:
        """Return a part by its poses and its outline (V, 2), m."""
        turn = self.R_WS.T @ pose.rotation
        yaw = np.unwrap(np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
        place = (pose.position - self.place) @ self.R_WS
        planar = np.column_stack([place[:, :2], yaw])
        return LinkStream(pose.time, planar, self._planar_std(pose), footprint)

    def path(self, name: str, path: PoseStream, point_std: float | None) -> PushContact:
        """Return a contact of which only the way is known."""
        return PushContact(
            name=name,
            time=np.zeros(0),
            force=np.zeros((0, 3)),
            force_std=None,
            pose_time=path.time,
            point=(path.position - self.place) @ self.R_WS,
            normal=path.rotation[:, :, 2] @ self.R_WS,
            point_std=point_std,
        )

    def contact(self, measured: ContactStream, point_std: float | None) -> PushContact:
        """Return a contact with its forces."""
        std = measured.force_std
        return PushContact(
            name=measured.name,
            time=measured.time,
            force=measured.force @ self.R_WS,
            force_std=None if std is None else np.sqrt(np.median(std**2, axis=0)),
            pose_time=measured.pose_time,
            point=(measured.position - self.place) @ self.R_WS,
            normal=measured.rotation[:, :, 2] @ self.R_WS,
            point_std=point_std,
            torque=measured.torque @ self.R_WS if measured.carries_torque else None,
        )

    def _planar_std(self, pose: PoseStream) -> Array | None:
        """Return stated std of x, y and yaw on the support, or None."""
        if pose.covariance is None:
            return None
        turn, shift = pose.covariance[:, :3, :3], pose.covariance[:, 3:, 3:]
        variances = np.einsum("ia,nij,ja->na", self.R_WS, shift, self.R_WS)[:, :2]
        about = np.einsum("i,nij,j->n", self.R_WS[:, 2], turn, self.R_WS[:, 2])
        found = np.sqrt(np.median(np.column_stack([variances, about]), axis=0))
        return np.asarray(found) if np.all(found > 0.0) else None


def anticlockwise(corners: Array, where: str) -> Array:
    """Return the corners (V, 2) of an outline anticlockwise.

    Raises:
        BadInputError: there are fewer than three, or some are not numbers.
    """
    if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3:
        raise BadInputError(f"{where} has shape {corners.shape}; expected three corners (V, 2)")
    if not np.isfinite(corners).all():
        raise BadInputError(f"{where} has corners that are no numbers")
    after = np.roll(corners, -1, axis=0)
    area = np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0])
    return corners if area > 0.0 else corners[::-1]


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
