"""How a world may lie and a sensor be mounted: tried, written, and read by people."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations, product
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import FINITE, Numbers
from tactile_dynamics_ros.core.rigid_body.rotation import turned_by
from tactile_dynamics_ros.recording.importers.fields import constant_rotation
from tactile_dynamics_ros.recording.importers.guess.answers import Answers
from tactile_dynamics_ros.recording.importers.guess.torques import torque_signs
from tactile_dynamics_ros.recording.importers.guess.weight import UP, Scene, Weighing
from tactile_dynamics_ros.recording.importers.worlds import MIRRORS

_CLOSE = 1e-6
"""Difference of entries of rotations by right angles: rounding."""


@dataclass(frozen=True)
class Mounting:
    """What is written for a world and a sensor that lie in another way.

    Attributes:
        force, torque: signs (3,) of the axes, as recorded, for forces that act on the object.
        turn: (3, 3) `sensor_rotation`, applied after the signs.
        mirror: name of `mirrored_world`, or "".
        up: (3,) unit vector, after the mirror.
        words: what is meant, by label.
    """

    force: Array
    torque: Array
    turn: Array
    mirror: str
    up: Array
    words: Mapping[str, str]

    @classmethod
    def of(cls, scene: Scene, weighing: Weighing) -> Mounting:
        """What is written for the load that fits."""
        sign = 1.0 if weighing.mass > 0.0 else -1.0
        signs = torque_signs(scene, weighing)
        turn, up, words = weighing.turn, weighing.up, _of_gravity(weighing.up)
        own = np.diag(turn)
        if np.allclose(turn, np.eye(3)):
            return cls(sign * np.ones(3), sign * signs, turn, "", up, words | _of_torque(signs))
        if np.allclose(np.abs(own), 1.0) and abs(signs @ own) > 2.5:
            axis = "xyz"[int(np.argmax(own))]
            words |= {"force axes": f"{axis} of the force alone points the other way: turned round"}
            return cls(sign * own, sign * own * signs, np.eye(3), "", up, words)
        if np.all(signs < 0.0):
            name = next((n for n, m in MIRRORS.items() if np.allclose(m, -turn, atol=_CLOSE)), "")
            if name and np.allclose(MIRRORS[name] @ up, UP, atol=_CLOSE):
                words = {"world": f"it is left-handed: {_MIRRORED[name]}"}
                return cls(-sign * np.ones(3), -sign * np.ones(3), np.eye(3), name, UP, words)
        words |= {
            "sensor": f"turned by {_describe(turn)} against the pose: sensor_rotation says so"
        }
        return cls(sign * np.ones(3), sign * signs, turn, "", up, words | _of_torque(signs))

    def world(self) -> dict[str, Any]:
        """Keys at the top of a mapping."""
        found: dict[str, Any] = {"mirrored_world": self.mirror} if self.mirror else {}
        if not np.allclose(self.up, UP):
            found["gravity"] = [float(np.round(-part, 4) + 0.0) for part in self.up]
        return found

    def sensor(self) -> dict[str, Any]:
        """Keys of a contact."""
        if np.allclose(self.turn, np.eye(3)):
            return {}
        angles = Rotation.from_matrix(self.turn).as_euler("xyz", degrees=True)
        euler = [float(np.round(angle, 2) + 0.0) for angle in angles]
        return {"sensor_rotation": {"euler": euler, "order": "xyz", "unit": "deg"}}


_MIRRORED = {
    **{axis: f"{axis} points the other way; mirrored" for axis in "xyz"},
    **{pair: f"{pair[0]} and {pair[1]} are exchanged; mirrored" for pair in ("xy", "xz", "yz")},
}
"""Left-handed worlds in words."""


def scale_of(signs: Array) -> float | list[float]:
    """One factor for all axes, or one for each."""
    return float(signs[0]) if np.all(signs == signs[0]) else [float(sign) for sign in signs]


def _of_gravity(up: Array) -> dict[str, str]:
    if np.allclose(up, UP):
        return {}
    down = ", ".join(f"{-part + 0.0:.3g}" for part in np.round(up, 4))
    away = np.degrees(np.arccos(np.clip(up @ UP, -1.0, 1.0)))
    return {"world": f"gravity acts along ({down}) in it, {away:.3g} deg from -z; turned upright"}


def _of_torque(signs: Array) -> dict[str, str]:
    wrong = [axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0.0]
    if not wrong:
        return {}
    which = "its axes point" if len(wrong) == 3 else f"{' and '.join(wrong)} of it alone point"
    which += "s" if len(wrong) == 1 else ""
    return {"torque axes": f"{which} the other way than the force says: turned round"}


def _describe(turn: Array) -> str:
    vector = Rotation.from_matrix(turn).as_rotvec()
    angle = float(np.linalg.norm(vector))
    axis = vector / angle
    along = int(np.argmax(np.abs(axis)))
    if abs(axis[along]) > 1.0 - 1e-3:
        return f"{np.degrees(angle) * np.sign(axis[along]):.4g} deg about {'xyz'[along]}"
    return f"{np.degrees(angle):.4g} deg about ({', '.join(f'{part:.2f}' for part in axis)})"


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
            up = scene.measured_up(axes, turn)
            if up is not None and _angle_between(up, UP) > _LEANS:
                yield _falling(scene, axes, up, turn)
    if turn is None:
        for up in AXES if given is None else [given]:
            found = scene.measured_turn(up)
            if found is not None and turned_by(found) > _LEANS:
                also = given is None and up @ UP < 1.0
                geometry = Geometry(
                    BOTH if also else TURNED, scene.weigh("sensor", up, _right(found))
                )
                if not also or geometry.is_exact:
                    yield geometry


def _falling(scene: Scene, axes: str, up: Array, turn: Array | None) -> Geometry:
    """Gravity along an axis of the world if that fits as well, else along what is measured."""
    exact = min(AXES, key=lambda axis: _angle_between(axis, up))
    along, measured = scene.weigh(axes, exact, turn), scene.weigh(axes, up, turn)
    away = _angle_between(exact, up)
    near = away < _EXACT or (away < _UNSEEN and along.rms < _AS_WELL * measured.rms)
    return Geometry(AXIS, along) if near else Geometry(LEANING, measured)


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
