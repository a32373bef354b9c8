"""Wrenches of a load at rest, one row per orientation, as holds of a recording.

Such a table has no clock. Each row becomes a hold of even samples with a pause before the next,
over which nothing is derived. Samples scatter about their row by its noise times the root of their
number: their mean is the row, and all of them weigh as much as the one reading did.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3, quaternion_to_matrix, skew

Array = NDArray[np.float64]

FEWEST_ROWS = 3
"""Orientations from which weight, centre of mass and bias can be told apart: 9 equations of the
force for 4 unknowns, 9 of the torque for 6."""
HOLD_RATE_HZ, PAUSE_S = 50.0, 1.0
"""Rate of the samples of a hold, and pause before the next. Half and twice as much give the same
estimate; only windows of 0.34 s must fit into a hold."""
MOST_SAMPLES, FEWEST_REPEATS, MOST_REPEATS = 3000, 20, 50
"""Samples of all holds together (about), and of one hold: many rows get shorter holds, so that the
estimate takes seconds. 20 samples at 50 Hz are the least from which noise is read."""
ROTATION_STD = 1e-4
"""Standard deviation of an orientation, rad, if none is stated: the repeatability of a robot arm of
0.1 mm over 1 m. A static load of 10 N then is uncertain by 1 mN."""
LEAST_FORCE_STD, LEAST_TORQUE_STD = 1e-3, 1e-5
"""Noise that is presumed at least, N and N m, where rows fit each other to the last digit."""


def held_poses(
    force: Any,
    torque: Any = None,
    *,
    rotation: Any = None,
    quaternion: Any = None,
    force_std: float | None = None,
    torque_std: float | None = None,
    rotation_std: float = ROTATION_STD,
) -> tuple[dict[str, Any], dict[str, Any], int]:
    """Arrays of the contact and of the pose, for `Recording.from_arrays` with object axes.

    Args:
        force: (N, 3) N that the sensor applies on the load, sensor axes.
        torque: (N, 3) N m likewise, about the sensor's origin; None if it was not measured.
        rotation: (N, 3, 3) sensor to world, z up.
        quaternion: (N, 4) xyzw of any length, instead of rotation.
        force_std: N of one reading; what a load and a bias leave unexplained by default.
        torque_std: N m likewise.
        rotation_std: rad.

    Returns:
        Contact, pose, and the number of rows that were left out since they are not finite.

    Raises:
        BadInputError: a shape is wrong, or fewer than three usable rows.
    """
    rows = {"force": _rows("force", force, 3)}
    if torque is not None:
        rows["torque"] = _rows("torque", torque, 3)
    turned = _rotations(rotation, quaternion)
    lengths = {name: len(values) for name, values in rows.items()} | {"orientation": len(turned)}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise BadInputError(f"static poses: {found} rows; expected as many of each")
    finite = np.all([np.isfinite(x).reshape(len(x), -1).all(axis=1) for x in rows.values()], axis=0)
    finite &= np.isfinite(turned).all(axis=(1, 2))
    if finite.sum() < FEWEST_ROWS:
        raise BadInputError(
            f"static poses: {int(finite.sum())} usable rows of {len(finite)}; expected at least "
            f"{FEWEST_ROWS} orientations"
        )
    rows, turned = {name: values[finite] for name, values in rows.items()}, turned[finite]
    gravity = np.swapaxes(turned, 1, 2) @ [0.0, 0.0, -9.81]
    noise = {"force": force_std or _noise(gravity[:, :, None], rows["force"], LEAST_FORCE_STD)}
    if "torque" in rows:
        noise["torque"] = torque_std or _noise(skew(gravity), rows["torque"], LEAST_TORQUE_STD)
    contact, pose = _hold(rows, turned, noise, rotation_std)
    return contact, pose, int(np.count_nonzero(~finite))


def _hold(
    rows: Mapping[str, Array], turned: Array, noise: Mapping[str, float], rotation_std: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Repeat each row with scatter; seeded, so that a table is always read alike."""
    random = np.random.default_rng(0)
    count = len(turned)
    repeats = int(np.clip(MOST_SAMPLES // count, FEWEST_REPEATS, MOST_REPEATS))
    start = np.arange(count) * (repeats / HOLD_RATE_HZ + PAUSE_S)
    time = (start[:, None] + np.arange(repeats) / HOLD_RATE_HZ).ravel()
    contact: dict[str, Any] = {"time": time, "position": [0.0, 0.0, 0.0], "rotation": np.eye(3)}
    for name, values in rows.items():
        scatter = noise[name] * np.sqrt(repeats) * _balanced(random, count, repeats)
        contact[name] = np.repeat(values, repeats, axis=0) + scatter
    contact["force_std"] = noise["force"] * np.sqrt(repeats)
    shaken = exp_so3(rotation_std * _balanced(random, count, repeats))
    pose = {
        "time": time,
        "position": np.zeros((len(time), 3)),
        "rotation": shaken @ np.repeat(turned, repeats, axis=0),
        "position_std": ROTATION_STD,
        "rotation_std": rotation_std,
    }
    return contact, pose


def _balanced(random: np.random.Generator, count: int, repeats: int) -> Array:
    """Unit noise (count * repeats, 3) whose mean over each hold is zero."""
    draws = random.normal(size=(count, repeats, 3))
    draws -= draws.mean(axis=1, keepdims=True)
    draws *= np.sqrt(repeats / (repeats - 1.0))
    return np.asarray(draws.reshape(-1, 3))


def _noise(matrix: Array, readings: Array, least: float) -> float:
    """RMS per degree of freedom that a load and a constant bias leave of readings (N, 3).

    Args:
        matrix: (N, 3, k) what the load's unknowns do to each reading.
        readings: (N, 3).
        least: returned if less is left.
    """
    bias = np.tile(np.eye(3), (len(matrix), 1, 1))
    flat = np.concatenate([matrix, bias], axis=2).reshape(readings.size, -1)
    solution = np.linalg.lstsq(flat, readings.ravel(), rcond=None)[0]
    squares = float(np.sum((flat @ solution - readings.ravel()) ** 2))
    return float(max(np.sqrt(squares / (readings.size - flat.shape[1])), least))


def _rows(name: str, values: Any, *shape: int) -> Array:
    """Return finite or missing numbers of the shape (N, *shape).

    Raises:
        BadInputError: they are not.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadInputError(f"static poses: {name} is not numeric: {error}") from error
    if array.shape[1:] != shape:
        wanted = ", ".join(["N", *map(str, shape)])
        raise BadInputError(f"static poses: {name} has shape {array.shape}; expected ({wanted})")
    return array


def _rotations(rotation: Any, quaternion: Any) -> Array:
    """Return (N, 3, 3), NaN where a quaternion has no length."""
    if (rotation is None) == (quaternion is None):
        raise BadInputError("static poses: expected either rotation (N, 3, 3) or quaternion (N, 4)")
    if rotation is not None:
        return _rows("rotation", rotation, 3, 3)
    named = _rows("quaternion", quaternion, 4)
    length = np.linalg.norm(named, axis=1, keepdims=True)
    unit = np.divide(named, length, out=np.full_like(named, np.nan), where=length > 0.0)
    turned = np.full((len(unit), 3, 3), np.nan)
    known = np.isfinite(unit).all(axis=1)
    turned[known] = quaternion_to_matrix(unit[known])
    return turned
