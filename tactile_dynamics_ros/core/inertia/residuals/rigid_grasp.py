"""Poses sharpened by contacts that stay where they are on the object.

A finger that neither slides nor rolls touches one point b_c of the body: p_c(t) = X_WO(t) b_c. Its
place in the world comes from the hand's joints with little noise, so that three such contacts tell
the pose at every instant better than a camera or a marker does, up to one constant displacement of
the body frame, which the mean of all measured poses leaves uncertain by 1 / sqrt(N) of their noise.
Contacts are taken only if their places on the object scatter no more, over any half second, than
white noise explains.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import chdtri

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import MISSED_PERIODS, SYNCHRONOUS
from tactile_dynamics_ros.core.numerics.noise import white_noise_std
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    dynamic_parameters_from_pseudo_inertia,
    pseudo_inertia,
)
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, log_so3, skew
from tactile_dynamics_ros.core.streams.streams import (
    ContactStream,
    PoseStream,
    Streams,
    enclosing_steps,
    nearest_samples,
)

_BLOCK_S = 0.5
"""Length, s, of the means whose scatter shows whether a contact stays at its place on the object.
Noise of poses averages out over it, rolling does not. Half and twice as much gave the same verdicts
on three synthetic recordings whose fingers roll."""
_FEWEST_BLOCKS = 4
"""Such means that a contact needs, 2 s; of fewer their scatter says too little, and the contact is
not used. Fewer let contacts in whose rolling does not show yet, more refuse short grasps."""
_CONFIDENCE = 0.999
"""Quantile of chi squared beyond which means scatter more than noise: one of a thousand contacts
that do stay is refused, which costs accuracy; a lower quantile refuses more, a higher one lets
contacts in that roll by a little, which bends the poses."""
_POINT_STD_FLOOR = 2e-6
"""Standard deviation of a contact point, m, that is presumed at least: points without noise would
get infinite weight. About the rounding of a hand's encoder (26 urad) at 0.1 m. A larger floor makes
exact points count for less, at zero one of them decides the pose alone."""
_WORTH_IT = 0.3
"""Noise of a contact point over that of its place as the poses have it, up to which the contact is
used: at 0.3 one contact weighs eleven times as much as a pose. Points that are hardly better than
the poses bring little and may roll unnoticed. At 1 contacts are used that may do harm for little;
at 0.1 only exact hands sharpen poses."""
_FEWEST_CONTACTS = 3
"""Contacts that fix a pose: three points that are not on one line. Two leave the turn about their
line free; four would leave hands of three fingers to the poses."""
_SMALLEST_SPREAD = 0.005
"""Extent of these points across their line (second singular value), m, from which they fix a turn
about it. At 5 mm a point that is off by 0.01 mm turns the object by 0.1 deg. Less makes poses worse
instead of sharper, more leaves fingertips in a row unused."""
_PASSES = 2
"""Times that the places on the object are averaged anew with the sharper poses. Places are means
over the recording and hardly move after the first pass. One leaves places where the blurred poses
had them, a third changes nothing that counts."""
_NEWTON_STEPS = 2
"""Gauss-Newton steps for a pose at given places. From poses that are off by 1 deg at 5 cm the first
leaves errors of 0.01 mm (a^2/2 of the arm), the second none. One would leave that error in the
poses, a third only costs time."""


@dataclass(frozen=True)
class SharpenedPoses:
    """A recording with better poses.

    Attributes:
        streams: the recording; its poses state their new covariance.
        frame_covariance: (6, 6) covariance of the displacement of the body frame that all poses
            share, body axes, [rotation, translation].
        contacts: whose places were used.
    """

    streams: Streams
    frame_covariance: Array
    contacts: tuple[str, ...]


def sharpen_poses(streams: Streams) -> SharpenedPoses | None:
    """Maximum-likelihood poses given measured poses and contacts that stay on the object.

    Args:
        streams: a recording.

    Returns:
        None where the poses state no covariance, fewer than three contacts stay in place, or their
        places are not much less noisy than the poses.
    """
    pose = streams.pose
    if pose is None or pose.covariance is None or len(pose.time) < 2:
        return None
    if not np.all(np.linalg.eigvalsh(pose.covariance)[:, 0] > 0.0):
        return None
    places = [place for c in streams.contacts.values() if (place := _Place.of(c, pose)) is not None]
    if len(places) < _FEWEST_CONTACTS:
        return None
    points = np.array([place.mean(pose) for place in places])
    if np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1] < _SMALLEST_SPREAD:
        return None
    sharp = pose
    for _ in range(_PASSES):
        sharp = _align(pose, sharp, places)
    held = np.any([place.there for place in places], axis=0)
    names = tuple(place.name for place in places)
    frame = _frame_covariance(pose, held)
    return SharpenedPoses(replace(streams, pose=sharp), frame, names)


@dataclass(frozen=True)
class _Place:
    """Where one contact is at the stamps of the poses.

    Attributes:
        name: name of the contact.
        point: (N, 3) m, world.
        there: (N,) whether it touches and is known.
        std: m, white noise of the point per axis.
    """

    name: str
    point: Array
    there: NDArray[np.bool_]
    std: float

    @classmethod
    def of(cls, contact: ContactStream, pose: PoseStream) -> _Place | None:
        """Read a contact; None unless it stays on the object and is known well."""
        if len(contact.pose_time) < 2 or len(contact.time) < 2:
            return None
        std = max(white_noise_std(contact.pose_time, contact.position), _POINT_STD_FLOOR)
        period = float(np.median(np.diff(contact.pose_time)))
        near = np.abs(contact.pose_time[nearest_samples(contact.pose_time, pose.time)] - pose.time)
        inside = (pose.time >= contact.pose_time[0]) & (pose.time <= contact.pose_time[-1])
        nearest = nearest_samples(contact.time, pose.time)
        touching = np.any(contact.force[nearest] != 0.0, axis=1)
        silence = np.abs(contact.time[nearest] - pose.time)
        _, step = enclosing_steps(contact.pose_time, pose.time)
        known = (near < SYNCHRONOUS) | (step < MISSED_PERIODS * period)
        there = inside & touching & known & (silence < 2.0 * period)
        point = np.asarray(CubicSpline(contact.pose_time, contact.position)(pose.time))
        place = cls(contact.name, point, there, std)
        return place if place._stays(pose) else None

    def mean(self, pose: PoseStream) -> Array:
        """(3,) its place on the object, m."""
        return np.asarray(self.on_body(pose)[self.there].mean(axis=0))

    def on_body(self, pose: PoseStream) -> Array:
        """(N, 3) its place on the object at every pose, m."""
        return np.asarray(np.einsum("nji,nj->ni", pose.rotation, self.point - pose.position))

    def _stays(self, pose: PoseStream) -> bool:
        """Whether means over half a second scatter as white noise has it, and the point pays."""
        held = self.on_body(pose)[self.there]
        noise = white_noise_std(pose.time[self.there], held)
        size = max(int(_BLOCK_S / float(np.median(np.diff(pose.time)))), 1)
        count = len(held) // size
        if count < _FEWEST_BLOCKS or self.std > _WORTH_IT * noise:
            return False
        means = held[: count * size].reshape(count, size, 3).mean(axis=1)
        square = float(np.sum((means - means.mean(axis=0)) ** 2)) * size / noise**2
        return square < float(chdtri(3 * (count - 1), 1.0 - _CONFIDENCE))


def _align(pose: PoseStream, start: PoseStream, places: list[_Place]) -> PoseStream:
    """Most likely poses for contacts at their mean places on the object.

    Minimises |log(measured X^-1)|^2 + sum_c |p_c - X b_c|^2 / s_c^2 at every stamp by Gauss-Newton.

    Args:
        pose: measured.
        start: present poses; the places are read from them.
        places: places of the contacts.
    """
    assert pose.covariance is not None
    body = np.array([place.mean(start) for place in places])
    measured = np.stack([place.point for place in places], axis=1)
    weight = np.stack([place.there / place.std**2 for place in places], axis=1)
    stated = np.linalg.inv(pose.covariance)
    rotation, position = start.rotation, start.position
    for _ in range(_NEWTON_STEPS):
        arm = np.einsum("nij,cj->nci", rotation, body)
        misfit = measured - position[:, None] - arm
        unit = np.broadcast_to(np.eye(3), (*arm.shape, 3))
        by_pose = np.concatenate([-skew(arm), unit], axis=3)
        weighted = by_pose * weight[..., None, None]
        information = np.einsum("ncij,ncik->njk", weighted, by_pose, optimize=True) + stated
        turn = log_so3(pose.rotation @ np.swapaxes(rotation, 1, 2))
        away = np.concatenate([turn, pose.position - position], axis=1)
        slope = np.einsum("ncij,nci->nj", weighted, misfit, optimize=True)
        slope += np.einsum("nij,nj->ni", stated, away)
        step = np.linalg.solve(information, slope[..., None])[..., 0]
        rotation, position = exp_so3(step[:, :3]) @ rotation, position + step[:, 3:]
    covariance = np.linalg.inv(information)
    return replace(pose, rotation=rotation, position=position, covariance=covariance, white=True)


def _frame_covariance(pose: PoseStream, held: NDArray[np.bool_]) -> Array:
    """(6, 6) of the mean noise of the measured poses, body axes [rotation, translation]."""
    assert pose.covariance is not None
    to_body = np.zeros((int(held.sum()), 6, 6))
    to_body[:, :3, :3] = to_body[:, 3:, 3:] = np.swapaxes(pose.rotation[held], 1, 2)
    each = to_body @ pose.covariance[held] @ np.swapaxes(to_body, 1, 2)
    return np.asarray(each.sum(axis=0) / len(each) ** 2)


def displacement_jacobian(phi: Array) -> Array:
    """Derivative (10, 6) of dynamic parameters by a displacement of the body, [rotation, shift].

    P' = T P T^T with T = exp(displacement).

    Args:
        phi: (10,).
    """
    matrix = pseudo_inertia(phi)
    columns = []
    for axis in np.eye(6):
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = skew(axis[:3]), axis[3:]
        change = generator @ matrix + matrix @ generator.T
        columns.append(dynamic_parameters_from_pseudo_inertia(change))
    return np.stack(columns, axis=1)
