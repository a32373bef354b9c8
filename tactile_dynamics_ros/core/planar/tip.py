"""Contact of a tip without a force sensor: where it is, and what force a robot's stiffness says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.outline import edge_normals, nearest_edge
from tactile_dynamics_ros.core.planar.streams import LinkStream, PushContact

_MOVES = 0.01
"""m/s from which an object counts as moved: poses of 0.5 mm over the tenth of a second that is
looked back make 7 mm/s of noise."""


def contact_of_tip(link: LinkStream, time: Array, place: Array) -> PushContact:
    """Where a tip meets an outline, by its middle's path: its radius is the usual gap in motion.

    Args:
        link: the object.
        time: (K,) s, of the tip.
        place: (K, 3) m, middle of the tip, frame S; z is the height of the push.
    """
    pose, depth, normal = _in_outline(link, time, place)
    before = np.stack([np.interp(time - 0.1, link.time, part) for part in link.pose.T[:2]], axis=1)
    moves = np.linalg.norm(pose[:, :2] - before, axis=1) > 0.1 * _MOVES
    radius = max(0.0, float(np.median(-depth[moves]))) if moves.any() else 0.0
    inward = turned(normal, pose[:, 2])
    point = place + np.pad(radius * inward, ((0, 0), (0, 1)))
    return PushContact(
        name="pusher",
        time=np.zeros(0),
        force=np.zeros((0, 3)),
        force_std=None,
        pose_time=time,
        point=point,
        normal=np.pad(inward, ((0, 0), (0, 1))),
    )


_CLEAR = 4e-3
"""Distance from the outline from which a tip is free, m: errors of calibration and of outlines are
less, as `_REACH` of slow pushes has it."""
_SMOOTH = 0.03
"""Standard deviation of the Gaussian by which motion of the tip is smoothed, s. At 10 ms noise of
0.2 mm makes forces of 2 N of an arm's mass of 3 kg, at 20 ms 0.6 N, at 30 ms 0.2 N (seeds 9410 to
9414); arms follow no faster than that at 1000 N/m."""
_REACHED = 2.5
"""Deviations of that Gaussian within which a sample counts: from there on 1 % of it is left."""
_FREE_SAMPLES = 40
"""Samples of free motion from which an arm's own forces are known: four numbers are fitted."""


@dataclass(frozen=True)
class Stiffness:
    """Cartesian stiffness of a robot that follows a commanded tip pose.

    Attributes:
        along: (2,) N/m, by axes of the support.
        std: relative standard deviation, of both axes together.
    """

    along: Array
    std: float


def force_by_stiffness(
    link: LinkStream, contact: PushContact, place: Array, target: Array, stiffness: Stiffness
) -> tuple[PushContact, float, float]:
    """Give a contact the forces by which a robot's tip stays behind its command.

    F = K (x_commanded - x_measured) - b - d v - m a. What the arm itself takes up (zero b, drag and
    delay d, mass m) is fitted where the tip moves freely, smoothed alike on both sides, with the
    command's derivatives as instruments, which have no noise; what is left there is the noise of
    the force. Forces are smoothed as the motion is. An error of the arm's mass is one of the
    object's, since both are accelerated together.

    Args:
        link: the object.
        contact: of the tip, as `contact_of_tip` has it.
        place: (K, 3) m, measured at its pose times, frame S.
        target: (K, 3) m, commanded at the same times, frame S.
        stiffness: of the robot.

    Returns:
        The contact with its force while it is near the object, the relative standard deviation of
        all forces together, and the standard deviation of the arm's mass, kg.

    Raises:
        NotIdentifiableError: the tip hardly moves freely, or never touches.
    """
    time, period = contact.pose_time, float(np.median(np.diff(contact.pose_time)))
    pull = stiffness.along * (target - place)[:, :2]
    near = _is_near(link, contact)
    width = _SMOOTH / period
    paused = np.append(True, np.diff(time) > 1.5 * period)
    paused[-1] = True
    reach = np.ones(2 * int(np.ceil(_REACHED * width)) + 1, dtype=bool)
    free = ~binary_dilation(near | paused, reach)
    if free.sum() < _FREE_SAMPLES or not near.any():
        raise NotIdentifiableError(
            f"stiffness: the tip is free in {free.sum()} samples and near the object in "
            f"{near.sum()}; expected {_FREE_SAMPLES} and some: record approach and retreat too"
        )
    own, instruments = (_own_motion(time, path[:, :2], period) for path in (place, target))
    smoothed = _smoothed(time, pull, period, 0)
    rows, tools = own[free].reshape(-1, 4), instruments[free].reshape(-1, 4)
    inverse = np.linalg.pinv(tools.T @ rows)
    values = inverse @ tools.T @ smoothed[free].ravel()
    force = smoothed - own @ values
    std = force[free].std(axis=0)
    alike = max(1.0, 2.0 * np.sqrt(np.pi) * width)
    covariance = inverse @ (tools.T @ tools) @ inverse.T * alike * float(std @ std) / 2.0
    unsure = np.einsum("kip,pq,kiq->k", own[near], covariance, own[near])
    size = np.sum(force[near] ** 2, axis=1)
    doubt = float(np.sqrt(np.median(unsure) / max(float(np.median(size)), 1e-12)))
    pushed = replace(
        contact,
        time=time[near],
        force=np.pad(force[near], ((0, 0), (0, 1))),
        force_std=np.append(std, std.max()),
    )
    return pushed, float(np.hypot(stiffness.std, doubt)), float(np.sqrt(covariance[3, 3]))


def _is_near(link: LinkStream, contact: PushContact) -> NDArray[np.bool_]:
    """Whether a tip (K,) is so near to the outline that it may touch."""
    _, depth, _ = _in_outline(link, contact.pose_time, contact.point)
    return np.asarray(depth > -_CLEAR)


def _in_outline(link: LinkStream, time: Array, place: Array) -> tuple[Array, Array, Array]:
    """Pose (K, 3) of a link at times, depth (K,) of places (K, 3) in it, and nearest normals."""
    pose = np.stack([np.interp(time, link.time, part) for part in link.pose.T], axis=1)
    own = turned(place[:, :2] - pose[:, :2], -pose[:, 2])
    return pose, *nearest_edge(link.footprint, edge_normals(link.footprint), own)


def _own_motion(time: Array, place: Array, period: float) -> Array:
    """What an arm's own forces go with (K, 2, 4): the zero of each axis, speed, acceleration."""
    moving = [_smoothed(time, place, period, order) for order in (1, 2)]
    zeros = np.tile(np.eye(2), (len(time), 1, 1))
    return np.concatenate([zeros, np.stack(moving, axis=2)], axis=2)


def _smoothed(time: Array, values: Array, period: float, order: int) -> Array:
    """Derivatives of an order of values (K, D), smoothed by a Gaussian."""
    grid = np.arange(time[0], time[-1] + period, period)
    even = np.stack([np.interp(grid, time, part) for part in values.T], axis=1)
    found = gaussian_filter1d(even, _SMOOTH / period, axis=0, order=order) / period**order
    return np.stack([np.interp(time, grid, part) for part in found.T], axis=1)
