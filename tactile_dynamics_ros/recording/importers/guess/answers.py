"""Questions that a table leaves open, and the answers of the user."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tactile_dynamics_ros.core.errors import BadInputError

KNOWN = {
    "time": "column, or none for a table of static poses",
    "time_unit": "s, ms, us or ns",
    "rate_hz": "rows per second, where no column is time",
    "pose": "which columns are the pose",
    "acceleration": "which columns an IMU's accelerations are, where there is no position",
    "position_unit": "m, cm or mm",
    "orientation": "how the orientation is written",
    "wrench": "which columns are the force",
    "force_unit": "N, mN, kN, kgf or lbf",
    "torque_unit": "N m, N mm or so",
    "frame": "axes of the forces: sensor or world",
    "gravity": "direction in which things fall in the world of the poses, as 0,-1,0",
    "sensor_rotation": "Euler angles xyz, deg, of a sensor that is mounted turned, as 0,0,90",
    "stamps": "header, or receive for the times at which a recorder received the messages",
    "body": "frame of /tf_static that the pose is of",
    "urdf": "file of the arm whose joint angles were recorded",
    "reads": "load (the sensor reads the load's weight) or object (forces on the object)",
}
"""Keys of answers and what they mean."""
_SHOWN = 6
"""Answers that a question shows: three numbers of an orientation have 24 readings. More make no
line that anybody reads."""


class Question(Exception):  # noqa: N818 - it is no error
    """Something that neither names nor numbers tell; carries one line of text."""


class Answers:
    """What the user said beforehand, by key."""

    def __init__(self, given: Mapping[str, str] | None = None) -> None:
        self._given = dict(given or {})
        unknown = sorted(set(self._given) - set(KNOWN))
        if unknown:
            raise BadInputError(f"--say {unknown[0]}: unknown; expected one of {', '.join(KNOWN)}")

    @property
    def given(self) -> dict[str, str]:
        """What was said, by key."""
        return dict(self._given)

    def get(self, key: str) -> str | None:
        """Return the answer, if it was given."""
        return self._given.get(key)

    def choose(self, key: str, options: Iterable[str], question: str) -> str:
        """Return the answer.

        Raises:
            Question: it was not given.
            BadInputError: it is none of the options.
        """
        known = list(options)
        answer = self._given.get(key)
        if answer is None:
            raise Question(
                f"{question}; answer with --say '{key}={known[0]}' (or {_others(known)})"
            )
        if answer not in known:
            raise BadInputError(f"--say {key}={answer}: expected one of {', '.join(known)}")
        return answer


def _others(options: list[str]) -> str:
    shown = ", ".join(options[1:_SHOWN]) or "another value"
    left = len(options) - _SHOWN
    return f"{shown} and {left} more; any other word lists them" if left > 0 else shown
