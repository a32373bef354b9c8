"""Pushes in directions that differ, by which what has changed is distinguished from friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer, Others
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

PUSHES = 3
"""Made at most: with the push that raised the alarm they go four ways, which parts a lean from
friction; further ones only narrow it."""
_SQUARELY = 1.0
"""Radians of difference that a push along the normal is worth over one across it: oblique ones
slip. Those of 12 deg lose 0.02; at ten times as much only sides of the object would count."""


class DirectionExplorer(Explorer):
    """Chooses pushes whose directions in the world differ most from those before.

    Along one direction a table that leans is like one that rubs more. Slow pushes come first,
    because the tip then follows best.
    """

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._headings: list[float] = []

    def reason_to_stop(self, belief: Belief) -> str:
        """Why nothing more is to be done; what is known of the object does not count."""
        return f"{self.count} pushes in different directions were made" * (self.count >= PUSHES)

    def choose(self, belief: Belief, pose: Array, others: Others = ()) -> Choice | str:
        """Return the next push, or why there is none.

        Args:
            belief: what is known.
            pose: (3,) of the object.
            others: (V, 2) m each, outlines of other parts in the object's frame.
        """
        reason = self.reason_to_stop(belief)
        if reason:
            return reason
        slow = min(self.config.speeds)
        fitting = [c for c in self.pushes(self.around(pose, others)) if c.speed == slow]
        if not fitting:
            return "no push keeps tip and object where the arm may be"
        headings = np.array([_heading(c, pose) for c in fitting])
        k = self._most_different(fitting, headings)
        self.note(fitting[k])
        self._headings.append(float(headings[k]))
        degrees = np.rad2deg(headings[k])
        words = (
            f"push it towards {degrees:.0f} deg: another way than before tells a force that stays "
            "from friction"
        )
        return Choice(fitting[k], 0.0, words, belief)

    def _most_different(self, fitting: list[Candidate], headings: Array) -> int:
        """The push farthest from those before; of about equal ones that along the normal."""
        squarely = np.array([float(c.direction @ c.normal) for c in fitting])
        if not self._headings:
            return int(squarely.argmax())
        off = headings[:, None] - np.array(self._headings)
        apart = np.abs((off + np.pi) % (2.0 * np.pi) - np.pi).min(axis=1)
        return int((apart + _SQUARELY * squarely).argmax())


def _heading(candidate: Candidate, pose: Array) -> float:
    x, y = turned(candidate.direction[None], pose[2:])[0]
    return float(np.arctan2(y, x))
