"""A push through the centre by hand-written rules: what searching for pushes is compared with."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.control.plan import Push, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody
from tactile_dynamics_ros.core.planar.mechanics.linkage import placed, turned

_BEHIND = 0.03
"""m: a tip that lies so far beside the line from centre to goal moves sideways as fast as ahead.
Longer lets the object turn away, shorter makes the tip slide along the edge."""


class CentringPusher(PushPlanner):
    """Turns the object by a push far from its centre, then pushes it through the centre.

    The tip stays behind the centre as seen from the goal; nothing is predicted. Source: the rule
    of Igarashi, Kamio and Inaba 2010 (dipole field) without its circle.
    """

    body: PushedBody

    def plan(self, pose: Array) -> Push:
        """Return a push that turns where the angle is the larger part of the error, else a line."""
        turn = (self.goal[2] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
        away = self.goal[:2] - self._centre(pose)
        arm = self.config.arm
        turns = arm * abs(turn) > max(float(np.hypot(*away)), 0.02) if len(away) else False
        share = self._lever(turn) if turns else self._opposite(pose, away)
        start, normal = self._starts(np.array([share]), pose[None])
        length = abs(turn) * self._reach(share) if turns else float(np.hypot(*away))
        length = min(length, self.config.most_length)
        direction = normal[0] if turns else self._towards(pose, start[0], away)
        plan = np.zeros((1, 5))
        plan[0, 0], plan[0, 4] = share, float(turns)
        error = float(self.error(pose[None])[0])
        return Push(start[0], direction, length + self.config.gap, normal[0], error, plan)

    def go_on(self, plan: Array, pose: Array, tip: Array, normal: Array) -> Push:
        """Return the rest of the push."""
        turns = plan[0, 4] > 0.0
        if turns:
            turn = (self.goal[2] - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
            lever = tip - self._centre(pose)
            left = turn * (lever[0] * normal[1] - lever[1] * normal[0])
            return Push(tip, normal, float(max(left, 0.0)), normal, 0.0, plan)
        away = self.goal[:2] - self._centre(pose)
        ahead = max(float(away @ normal), 0.0)
        return Push(tip, self._towards(pose, tip, away), ahead, normal, 0.0, plan)

    def _centre(self, pose: Array) -> Array:
        """Centre of mass (2,) of an object whose frame is to come to the goal's angle last."""
        return np.asarray(placed(self.body.com[None], pose)[0] - self._offset())

    def _offset(self) -> Array:
        return np.asarray(turned(self.body.com[None], self.goal[2:])[0])

    def _towards(self, pose: Array, tip: Array, away: Array) -> Array:
        """Direction (2,) to the goal, turned so that the tip comes behind the centre."""
        ahead = away / max(float(np.hypot(*away)), 1e-6)
        side = np.array([-ahead[1], ahead[0]])
        beside = float((tip - self._centre(pose) - self._offset()) @ side)
        way = ahead - beside / _BEHIND * side
        return np.asarray(way / np.hypot(*way))

    def _opposite(self, pose: Array, away: Array) -> float:
        """Share of the outline that lies behind the centre of mass, as seen from the goal."""
        shares = np.linspace(0.0, 1.0, 400, endpoint=False)
        point, _ = self.body.at(shares)
        arm = turned(point - self.body.com, np.full(400, pose[2]))
        size = np.linalg.norm(arm, axis=1) * max(float(np.hypot(*away)), 1e-9)
        return float(shares[np.argmin(arm @ away / size)])

    def _lever(self, turn: float) -> float:
        """Share of the outline with the largest lever arm that turns the right way."""
        shares = np.linspace(0.0, 1.0, 400, endpoint=False)
        point, normal = self.body.at(shares)
        arm = point - self.body.com
        return float(
            shares[np.argmax(np.sign(turn) * (arm[:, 0] * normal[:, 1] - arm[:, 1] * normal[:, 0]))]
        )

    def _reach(self, share: float) -> float:
        """Lever arm of a push along the normal, m."""
        point, normal = self.body.at(np.array([share]))
        arm = (point - self.body.com)[0]
        return float(abs(arm[0] * normal[0, 1] - arm[1] * normal[0, 0]))
