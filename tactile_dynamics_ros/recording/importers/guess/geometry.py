"""How a world may lie and a sensor be mounted, tried where forces do not agree as is written."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import FINITE, Numbers
from tactile_dynamics_ros.core.rigid_body.rotation import turned_by
from tactile_dynamics_ros.recording.importers.fields import constant_rotation
from tactile_dynamics_ros.recording.importers.guess.answers import Answers
from tactile_dynamics_ros.recording.importers.guess.weight import UP, Scene, Weighing

Array = NDArray[np.float64]

SIMPLE, AXIS, TURNED, LEANING, BOTH = range(5)
"""Kinds of geometry, the simplest first: as it is written; gravity along an axis of the world; the
sensor turned or mirrored; gravity in any direction; axes of both exchanged. The first of those
that fit alike is taken."""
_LEANS = 0.05
"""Angle, rad, up to which worlds are levelled and sensors screwed on: 3 deg, which the effects
`gravity_tilt` and `sensor_rotation` find. At 0.02 every base that is not levelled is written as
one that leans, at 0.1 a mass is wrong by 0.5 %."""
_EXACT = 0.02
"""Angle, rad, from a right angle up to which a world or a sensor stands at it: ten times what is
left of one that does. At 0.1 sensors at 5 deg from it would be put straight."""
_UNSEEN, _AS_WELL = 0.3, 1.02
"""Angle, rad, from an axis of a direction that poses which turn about one axis alone do not show,
and misfit over its own up to which gravity acts along that axis: as noise makes misfits differ."""
AXES = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
"""Directions along which worlds have up."""


@dataclass(frozen=True)
class Geometry:
    """A load under one way in which world and sensor may lie.

    Attributes:
        kind: of `SIMPLE` to `BOTH`.
        weighing: the load.
    """

    kind: int
    weighing: Weighing

    @property
    def is_exact(self) -> bool:
        """Whether world and sensor stand at right angles."""
        largest = np.abs(self.weighing.turn).max(axis=1)
        return self.kind != LEANING and bool(np.allclose(largest, 1.0))


def read_gravity(answers: Answers) -> Array | None:
    """Direction up (3,) that the user says, or None.

    Raises:
        BadInputError: it is none.
    """
    given = answers.get("gravity")
    if given is None:
        return None
    down = _three("gravity", given)
    if not down.any():
        raise BadInputError(f"--say gravity={given}: expected the direction in which things fall")
    return -down / np.linalg.norm(down)


def read_mounting(answers: Answers) -> Array | None:
    """Rotation (3, 3) of the sensor against the pose that the user says, or None."""
    given = answers.get("sensor_rotation")
    if given is None:
        return None
    angles = _three("sensor_rotation", given).tolist()
    entry = {"euler": angles, "order": "xyz", "unit": "deg"}
    return constant_rotation("--say sensor_rotation", entry)


def _three(key: str, text: str) -> Array:
    try:
        return np.array(Numbers(FINITE, 3)(text))
    except ArgumentTypeError as error:
        raise BadInputError(
            f"--say {key}={text}: expected three numbers with commas between them"
        ) from error


def simple(scene: Scene, answers: Answers) -> list[Geometry]:
    """The load as it is written, or as the user says that world and sensor lie."""
    up, turn = read_gravity(answers), read_mounting(answers)
    up = UP if up is None else up
    if turn is not None:
        return [Geometry(SIMPLE, scene.weigh("sensor", up, turn))]
    return [Geometry(SIMPLE, scene.weigh(axes, up)) for axes in ("sensor", "world")]


def others(scene: Scene, answers: Answers) -> Iterator[Geometry]:
    """Other ways in which world and sensor may lie, those that fit best."""
    given, turn = read_gravity(answers), read_mounting(answers)
    if given is None:
        for axes in ("sensor", "world") if turn is None else ("sensor",):
            up = scene.felt_up(axes, turn)
            if up is not None and _angle_between(up, UP) > _LEANS:
                yield _falling(scene, axes, up, turn)
    if turn is None:
        for up in AXES if given is None else [given]:
            found = scene.felt_turn(up)
            if found is not None and turned_by(found) > _LEANS:
                also = given is None and up @ UP < 1.0
                geometry = Geometry(
                    BOTH if also else TURNED, scene.weigh("sensor", up, _right(found))
                )
                if not also or geometry.is_exact:
                    yield geometry


def _falling(scene: Scene, axes: str, up: Array, turn: Array | None) -> Geometry:
    """Gravity along an axis of the world if that fits as well, else along the direction felt."""
    exact = min(AXES, key=lambda axis: _angle_between(axis, up))
    along, felt = scene.weigh(axes, exact, turn), scene.weigh(axes, up, turn)
    away = _angle_between(exact, up)
    near = away < _EXACT or (away < _UNSEEN and along.rms < _AS_WELL * felt.rms)
    return Geometry(AXIS, along) if near else Geometry(LEANING, felt)


def say_gravity(up: Array) -> str:
    """The answer by which a user says that gravity acts along -up."""
    return "gravity=" + ",".join(f"{-part + 0.0:.4g}" for part in np.round(up, 4))


def _right(turn: Array) -> Array:
    """The rotation by right angles that a rotation is, or the rotation itself."""
    nearest = min(RIGHT_ANGLES, key=lambda other: turned_by(other.T @ turn))
    return nearest if turned_by(nearest.T @ turn) < _EXACT else turn


def _angle_between(one: Array, other: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


RIGHT_ANGLES = [
    matrix
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(matrix := np.diag(signs)[list(order)]) > 0.0
]
"""The 24 rotations that put axes on axes."""
