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
from scipy.special import fdtrc

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import (
    are_rotations,
    exp_so3,
    quaternion_to_matrix,
    skew,
)

Mask = NDArray[np.bool_]

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
WORST_FORCE_STD, WORST_TORQUE_STD, WORST_SHARE = 0.5, 0.05, 0.03
"""Noise that is presumed at most, N and N m, beside that share of how far readings of a load go:
the resolution of coarse wrist sensors (1 N, 0.1 N m) and their gain, to which data sheets state 1
to 3 %. What is left beyond it is a misfit, which would else pass for noise whatever it is."""
CHANCE = 1e-3
"""Chance with which a table without a wrong row loses one. A hundredth misses rows that are off by
6 times the noise instead of 5."""
_NOTHING = 1e-30
"""Squared residual of rows that fit exactly, N^2: only keeps the quotient finite."""
_SHOWN = 10
"""Rows that are named of those left out; more fill the terminal."""
MOST_WRONG = 0.2
"""Share of rows that may be left out as wrong: of more, the table as a whole is not a load's."""


def held_poses(
    force: Any,
    torque: Any = None,
    *,
    rotation: Any = None,
    quaternion: Any = None,
    force_std: float | None = None,
    torque_std: float | None = None,
    rotation_std: float = ROTATION_STD,
    contact_frame: str = "object",
) -> tuple[dict[str, Any], dict[str, Any], dict[str, int]]:
    """Arrays of the contact and of the pose, for `Recording.from_arrays` with object axes.

    Args:
        force: (N, 3) N that the sensor applies on the load, sensor axes.
        torque: (N, 3) N m likewise, about the sensor's origin; None if it was not measured.
        rotation: (N, 3, 3) sensor to world, z up.
        quaternion: (N, 4) xyzw of any length, instead of rotation.
        force_std: N of one reading; what a load and a bias leave unexplained by default.
        torque_std: N m likewise.
        rotation_std: rad.
        contact_frame: axes of force and torque, "object" (the sensor's) or "world".

    Returns:
        Contact, pose, and the rows that were left out, by what is wrong with them.

    Raises:
        BadInputError: a shape is wrong, or fewer than three usable rows.
    """
    if contact_frame not in ("object", "world"):
        raise BadInputError(f"contact_frame '{contact_frame}': expected object or world")
    rows = {"force": _rows("force", force, 3)}
    if torque is not None:
        rows["torque"] = _rows("torque", torque, 3)
    turned = _rotations(rotation, quaternion)
    lengths = {name: len(values) for name, values in rows.items()} | {"orientation": len(turned)}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise BadInputError(f"static poses: {found} rows; expected as many of each")
    turned = np.where(are_rotations(turned)[:, None, None], turned, np.nan)
    complete = np.all([np.isfinite(x).all(axis=1) for x in rows.values()], axis=0)
    oriented = np.isfinite(turned).all(axis=(1, 2))
    lost = _lines("is not finite", ~complete) | _lines("has no rotation", complete & ~oriented)
    _require_enough(complete & oriented)
    if contact_frame == "world":
        rows = {key: np.einsum("nji,nj->ni", turned, values) for key, values in rows.items()}
    gravity = np.swapaxes(turned, 1, 2) @ [0.0, 0.0, -9.81]
    laws = {"force": _with_bias(gravity[:, :, None]), "torque": _with_bias(skew(gravity))}
    wrong = np.zeros(len(turned), dtype=bool)
    for key, values in rows.items():
        wrong |= wrong_rows(laws[key], values, complete & oriented)
    lost |= _lines("does not fit the others, as a mistyped one would not", wrong)
    used = complete & oriented & ~wrong
    rows, turned = {key: values[used] for key, values in rows.items()}, turned[used]
    repeats = int(np.clip(MOST_SAMPLES // len(turned), FEWEST_REPEATS, MOST_REPEATS))
    scatter = {}
    for key, given, least, worst in (
        ("force", force_std, LEAST_FORCE_STD, WORST_FORCE_STD),
        ("torque", torque_std, LEAST_TORQUE_STD, WORST_TORQUE_STD),
    ):
        if key in rows:
            seen = max(_noise(laws[key][used], rows[key]), least) if given is None else given
            most = float(np.hypot(worst, WORST_SHARE * rows[key].std(axis=0).max()))
            misfit = given is None and seen > most  # samples that scatter less show it
            scatter[key] = most if misfit else seen * np.sqrt(repeats)
    contact, pose = _hold(rows, turned, scatter, rotation_std, repeats)
    return contact, pose, lost


def _require_enough(usable: Mask) -> None:
    """Check that a load can be distinguished from the rows.

    Raises:
        BadInputError: there are too few.
    """
    if usable.sum() < FEWEST_ROWS:
        raise BadInputError(
            f"static poses: {int(usable.sum())} usable rows of {len(usable)}; expected at least "
            f"{FEWEST_ROWS} orientations"
        )


def _lines(what: str, rows: Mask) -> dict[str, int]:
    """A line for rows that are left out, with their numbers from 1 on; none if there are none."""
    numbers = (np.flatnonzero(rows) + 1).tolist()
    if not numbers:
        return {}
    named = ", ".join(map(str, numbers[:_SHOWN])) + (", ..." if len(numbers) > _SHOWN else "")
    return {f"static poses: row {named} {what} (left out)": len(numbers)}


def wrong_rows(law: Array, readings: Array, usable: Mask) -> Mask:
    """Rows (N,) that the others contradict, found one after the other.

    Each is judged by the fit to the others, e^T (I - H)^-1 e / (3 s^2) ~ F(3, n - k), at a level
    that all rows share (externally studentised residuals).

    Args:
        law: (N, 3, k) what a load's unknowns and a bias do to each reading.
        readings: (N, 3).
        usable: (N,) rows that may be used.

    Source: Cook & Weisberg 1982, Residuals and Influence in Regression, 2.2.2.
    """
    used, count, unknowns = usable.copy(), int(usable.sum()), law.shape[2]
    for _ in range(int(MOST_WRONG * count) + 1):
        freedom = 3 * int(used.sum()) - unknowns - 3
        if freedom < 1:
            break
        basis = np.linalg.qr(law[used].reshape(-1, unknowns))[0].reshape(-1, 3, unknowns)
        left = readings[used] - basis @ np.einsum("nik,ni->k", basis, readings[used])
        inside = np.eye(3) - basis @ np.swapaxes(basis, 1, 2)
        own = np.einsum("ni,nij,nj->n", left, np.linalg.pinv(inside), left)
        others = np.maximum(np.sum(left**2) - own, _NOTHING) / freedom
        chance = fdtrc(3.0, freedom, own / (3.0 * others))
        if chance.min() > CHANCE / count:
            return usable & ~used
        used[np.flatnonzero(used)[np.argmin(chance)]] = False
    return np.zeros_like(usable)  # of so many, none is the one that is wrong


def _hold(
    rows: Mapping[str, Array],
    turned: Array,
    scatter: Mapping[str, float],
    rotation_std: float,
    repeats: int,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Repeat each row with scatter; seeded, so that a table is always read alike."""
    random = np.random.default_rng(0)
    count = len(turned)
    start = np.arange(count) * (repeats / HOLD_RATE_HZ + PAUSE_S)
    time = (start[:, None] + np.arange(repeats) / HOLD_RATE_HZ).ravel()
    contact: dict[str, Any] = {"time": time, "position": [0.0, 0.0, 0.0], "rotation": np.eye(3)}
    for name, values in rows.items():
        drawn = scatter[name] * _balanced(random, count, repeats)
        contact[name] = np.repeat(values, repeats, axis=0) + drawn
    contact["force_std"] = scatter["force"]
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


def _with_bias(law: Array) -> Array:
    """Matrices (N, 3, k + 3) of what a load's unknowns and a constant bias do."""
    bias = np.broadcast_to(np.eye(3), (len(law), 3, 3))
    return np.concatenate([law, bias], axis=2)


def _noise(law: Array, readings: Array) -> float:
    """RMS per degree of freedom that unknowns leave of readings (N, 3).

    Args:
        law: (N, 3, k) what the unknowns do to each reading.
        readings: (N, 3).
    """
    flat = law.reshape(readings.size, -1)
    solution = np.linalg.lstsq(flat, readings.ravel(), rcond=None)[0]
    squares = float(np.sum((flat @ solution - readings.ravel()) ** 2))
    return float(np.sqrt(squares / (readings.size - flat.shape[1])))


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
