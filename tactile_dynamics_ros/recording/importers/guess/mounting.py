"""How a mapping says, and people read, that a world lies or a sensor is mounted in another way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tactile_dynamics_ros.recording.importers.guess.torques import torque_signs
from tactile_dynamics_ros.recording.importers.guess.weight import UP, Scene, Weighing
from tactile_dynamics_ros.recording.importers.worlds import MIRRORS

Array = NDArray[np.float64]

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
