"""Rotations: exponential and logarithm of SO(3), quaternions; poses; alignment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array

_SMALL_ANGLE = 1e-6
"""Sine of an angle (rad) below which the logarithm is its first-order form; that is off by a sixth
of the cube, 2e-19, less than rounding. Below 1e-8 the ratio of two vanishing numbers loses its
digits, above 1e-5 the form is off by more than rounding."""
_NO_ANGLE = 1e-100
"""Angle, rad, that takes the place of zero in sin(h) / h, which then is 1 exactly. Any number whose
sine is itself and that is not zero has the same effect; zero makes 0 / 0."""
_IDENTITY = np.eye(3)
"""The rotation by nothing, made once since every exponential adds it; it is not to be written
to."""
_DEFECT = 0.01
"""Deviation from R^T R = I up to which a matrix is a rotation that was rounded to two digits. Less
refuses such files, more takes matrices that stretch."""
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]
"""Axes after and before each axis, in turn. Fixed by right-handed axes; exchanged they give -a x
b."""
_SKEW = np.zeros((3, 9))
"""Matrix (3, 9) with vec([v]) = v S: the entries of a cross-product matrix. Fixed by [v] w = v x w;
with other signs every rotation turns the other way."""
_SKEW[[2, 1, 2, 0, 1, 0], [1, 2, 3, 5, 6, 7]] = [-1.0, 1.0, 1.0, -1.0, -1.0, 1.0]
_HALF_DIFFERENCE = 0.5 * _SKEW.T
"""Matrix (9, 3) that takes the vector of the antisymmetric part out of a matrix. Fixed by `_SKEW`,
whose inverse on antisymmetric matrices it is."""


def skew(vector: Array) -> Array:
    """Return the cross-product matrix, ``skew(a) @ b = a x b``.

    Args:
        vector: (..., 3).

    Returns:
        (..., 3, 3).
    """
    v = np.asarray(vector, dtype=float)
    return np.asarray((v @ _SKEW).reshape(*v.shape, 3))


def cross(a: Array, b: Array) -> Array:
    """Return a x b of vectors (..., 3); for few of them twice as fast as `numpy.cross`."""
    return np.asarray(a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT])


def twice(rotation: Array) -> Array:
    """Return diag(R, R) (6, 6), which turns twists, wrenches and their covariances."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    return both


def exp_so3(rotation_vector: Array) -> Array:
    """Rotation of a rotation vector, R = I + sin(a)/a [v] + (1 - cos(a))/a^2 [v]^2.

    With half angles h both factors are exact near zero: sin(h)/h cos(h) and (sin(h)/h)^2 / 2.

    Args:
        rotation_vector: (..., 3) rad.

    Returns:
        (..., 3, 3) rotation matrices.
    """
    v = np.asarray(rotation_vector, dtype=float)
    half = 0.5 * np.maximum(np.sqrt((v * v).sum(axis=-1)), _NO_ANGLE)[..., None, None]
    ratio = np.sin(half) / half
    cross = skew(v)
    turn = (ratio * np.cos(half)) * cross + (0.5 * ratio * ratio) * (cross @ cross)
    return np.asarray(_IDENTITY + turn)


def log_so3(rotation: Array) -> Array:
    """Rotation vector of a rotation, the inverse of `exp_so3`, angle in [0, pi].

    Angles below 90 deg follow from the antisymmetric part, others by the quaternion.

    Args:
        rotation: (..., 3, 3).

    Returns:
        (..., 3) rad.
    """
    flat = np.asarray(rotation, dtype=float).reshape(*np.shape(rotation)[:-2], 9)
    cosine = 0.5 * (flat[..., 0] + flat[..., 4] + flat[..., 8] - 1.0)
    if (cosine > 0.0).all():
        half = flat @ _HALF_DIFFERENCE
        sine = np.sqrt((half * half).sum(axis=-1))
        small = sine < _SMALL_ANGLE
        ratio = np.arctan2(sine, cosine) / np.where(small, 1.0, sine)
        return np.asarray(np.where(small, 1.0, ratio)[..., None] * half)
    quaternion = matrix_to_quaternion(rotation)
    vector, scalar = quaternion[..., :3], quaternion[..., 3]
    sine = np.linalg.norm(vector, axis=-1)
    angle = 2.0 * np.arctan2(sine, scalar)
    small = sine < _SMALL_ANGLE
    factor = np.where(small, 2.0, angle / np.where(small, 1.0, sine))
    return np.asarray(factor[..., None] * vector)


def matrix_to_quaternion(rotation: Array) -> Array:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation matrix.

    Args:
        rotation: (..., 3, 3).

    Returns:
        (..., 4).
    """
    r = np.asarray(rotation, dtype=float)
    if r.ndim == 2:
        return np.array(_quaternion_of_one(*r.ravel().tolist()))
    trace = np.einsum("...ii->...", r)
    diagonal = np.einsum("...ii->...i", r)
    squares = np.concatenate([1.0 + 2.0 * diagonal - trace[..., None], 1.0 + trace[..., None]], -1)
    products = np.empty((*r.shape[:-2], 4, 4))
    products[..., range(4), range(4)] = squares
    for i, j in ((0, 1), (0, 2), (1, 2)):
        products[..., i, j] = products[..., j, i] = r[..., i, j] + r[..., j, i]
    products[..., 0, 3] = products[..., 3, 0] = r[..., 2, 1] - r[..., 1, 2]
    products[..., 1, 3] = products[..., 3, 1] = r[..., 0, 2] - r[..., 2, 0]
    products[..., 2, 3] = products[..., 3, 2] = r[..., 1, 0] - r[..., 0, 1]
    largest = np.argmax(squares, axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.asarray(np.where(quaternion[..., 3:] < 0.0, -quaternion, quaternion))


def _quaternion_of_one(
    xx: float,
    xy: float,
    xz: float,
    yx: float,
    yy: float,
    yz: float,
    zx: float,
    zy: float,
    zz: float,
) -> tuple[float, float, float, float]:
    """Return (x, y, z, w) of one rotation matrix; arrays cost ten times more for a single one."""
    squares = (1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz, 1.0 + xx + yy + zz)
    rows = (
        (squares[0], xy + yx, xz + zx, zy - yz),
        (xy + yx, squares[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, squares[2], yx - xy),
        (zy - yz, xz - zx, yx - xy, squares[3]),
    )
    x, y, z, w = rows[squares.index(max(squares))]
    length = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return x / length, y / length, z / length, w / length


def quaternion_to_matrix(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion (x, y, z, w), normalised first.

    Args:
        quaternion: (..., 4), non-zero.

    Returns:
        (..., 3, 3).
    """
    q = np.asarray(quaternion, dtype=float)
    if q.ndim == 1:
        return np.array(_matrix_of_one(*q.tolist()))
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    cross = skew(q[..., :3])
    return np.asarray(np.eye(3) + 2.0 * q[..., 3, None, None] * cross + 2.0 * (cross @ cross))


def _matrix_of_one(x: float, y: float, z: float, w: float) -> tuple[tuple[float, ...], ...]:
    """Return the rows of the rotation matrix of one quaternion; arrays cost five times more."""
    scale = 2.0 / (x * x + y * y + z * z + w * w)
    a, b, c = scale * x, scale * y, scale * z
    return (
        (1.0 - b * y - c * z, a * y - c * w, a * z + b * w),
        (a * y + c * w, 1.0 - a * x - c * z, b * z - a * w),
        (a * z - b * w, b * z + a * w, 1.0 - a * x - b * y),
    )


def accumulated_rotation(rotation: Array) -> Array:
    """Rotation vectors (N, 3) from sample to sample, summed: a signal with the same noise."""
    steps = log_so3(rotation[1:] @ np.swapaxes(rotation[:-1], 1, 2))
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def turned_between(first: Array, then: Array, share: Array) -> Array:
    """Return rotations (..., 3, 3) on the shortest turn from one to another.

    Args:
        first: (..., 3, 3), where the share is 0.
        then: (..., 3, 3), where it is 1.
        share: (...) of the turn that is made, 0 to 1.
    """
    turn = log_so3(np.swapaxes(first, -1, -2) @ then)
    return np.asarray(first @ exp_so3(share[..., None] * turn))


def turned_by(rotation: Array) -> float:
    """Angle, rad, of a rotation (3, 3)."""
    return float(np.linalg.norm(log_so3(rotation)))


def nearest_rotation(matrices: Array) -> Array:
    """Rotations (..., 3, 3) nearest to matrices in the Frobenius norm.

    Source: Higham 1986, SIAM J. Sci. Stat. Comput. 7 (the polar factor).
    """
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return np.asarray(left @ right)


def upright(gravity: Array) -> Array:
    """The least rotation (3, 3) that takes the direction (3,) of gravity to -z.

    Args:
        gravity: of any length but zero.
    """
    x, y, z = gravity / np.linalg.norm(gravity)
    if z > 1.0 - 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    turn = skew(np.array([-y, x, 0.0]))
    return np.asarray(np.eye(3) + turn + turn @ turn / (1.0 - z))


def are_rotations(matrices: Array) -> NDArray[np.bool_]:
    """Which of (N, 3, 3) have R^T R = I, to two digits; mirrored ones have it too."""
    defect = np.abs(np.einsum("nji,njk->nik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
    return np.asarray(defect < _DEFECT)  # NaN is none


def align_points(points: Array, reference: Array) -> tuple[Array, Array]:
    """Return R (3, 3) and t (3,) that bring points onto a reference, min sum |R p_k + t - q_k|^2.

    Args:
        points: (K, 3), at least three.
        reference: (K, 3).

    Source: Kabsch 1976.
    """
    centre, goal = points.mean(axis=0), reference.mean(axis=0)
    turn = nearest_rotation((reference - goal).T @ (points - centre))
    return np.asarray(turn), np.asarray(goal - turn @ centre)


def rpy_to_matrix(rpy: Sequence[float] | Array) -> Array:
    """R = R_z(yaw) R_y(pitch) R_x(roll) of fixed-axis angles (3,) in rad."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(xyz: Sequence[float] | Array, rpy: Sequence[float] | Array) -> Array:
    """Pose (4, 4) of a position (3,) in m and fixed-axis angles (3,) in rad, as in a URDF."""
    pose = np.eye(4)
    pose[:3, :3] = rpy_to_matrix(rpy)
    pose[:3, 3] = xyz
    return pose


def inverse_pose(pose: Array) -> Array:
    """Return the inverse of a pose (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def described_pose(values: Mapping[str, Any]) -> Array:
    """Pose (4, 4) of a description: ``centre`` in m and ``rpy_deg``, each zero where absent."""
    centre = np.asarray(values.get("centre", (0.0, 0.0, 0.0)), dtype=float)
    angles = np.asarray(values.get("rpy_deg", (0.0, 0.0, 0.0)), dtype=float)
    return pose_of(centre, np.deg2rad(angles))
