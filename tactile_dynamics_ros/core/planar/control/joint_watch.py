"""Whether two parts turn against each other, and about which place: from poses seen so far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.planar.control.joint_friction import PRESUMED, PushRecord, rubbing
from tactile_dynamics_ros.core.planar.control.jointed import Hinge, JointedBody, Rubbing
from tactile_dynamics_ros.core.planar.control.prediction import Pushable, PushedBody
from tactile_dynamics_ros.core.planar.linked.outlines import distance_outside
from tactile_dynamics_ros.core.planar.mechanics.linkage import in_frame, placed, turned

Array = NDArray[np.float64]

_TURNS = np.deg2rad(3.0)
"""Turn of two parts against each other from which a joint is presumed, rad: markers tell each to
0.2 deg, and rigid pairs stay within 1 deg; pushes turn joints by 5 deg and more."""
_AVERAGED, _TOGETHER = 15, 1e-3
"""Relative poses that are averaged, half a second of 30 Hz, and s within which two poses are of
one image: of different ones a turning object would seem to have a joint."""
_ALIKE = np.deg2rad(1.0)
"""Turn within which averages count as one place seen again, rad: more of them tell no more of the
joint's place, and a day at rest must not outweigh a turn of a second."""
_MOST_SEEN = 20
"""Averages that count at one turn: trackers have lasting errors that no average removes."""
_NOISE = 4e-4
"""m by which an average of relative places is off, along x and y: of 0.7 mm each, and moving."""
_KNOWN = 0.01
"""m to which the place of a joint has to be known before it counts: a tenth of what parts measure,
and beyond it turns are predicted about the wrong place by as much as their lever arms."""
_LOOSE = 0.003
"""m by which seen places may miss those of a joint: joints have play, separate parts slide by more
within one push."""
_BESIDE = 0.015
"""m by which a joint may lie outside both outlines: joints lie where parts meet; two parts that
slide a little have a pole anywhere."""
LOW = 0.03
"""m above the support up to which a tip may push parts: pushes are made at 12 mm, ways there go
high above, and parts of less than 3 cm are seldom."""


@dataclass
class _Seen:
    """Mean relative pose (3,) at one turn, and of how many averages."""

    mean: Array
    count: int = 1

    def add(self, pose: Array) -> None:
        self.count = min(self.count + 1, _MOST_SEEN)
        self.mean = self.mean + (pose - self.mean) / self.count


class JointWatch:
    """Takes poses of both parts; tells whether they turned, and the joint once it is known.

    Attributes:
        turned: whether they turned against each other. pushes: what moved them so far.
    """

    def __init__(self) -> None:
        self.turned, self.pushes = False, PushRecord()
        self._numbers, self._fitted, self._pushing = PRESUMED, (0, True), False
        self._newest: list[Array] = []
        self._seen: list[_Seen] = []
        self._hinge: Hinge | None = None
        self._fresh = True

    def add(
        self, first: tuple[float, Array], second: tuple[float, Array], tip: Array | None
    ) -> None:
        """Note times, s, and poses (3,) of both parts; from two images they tell nothing.

        Args:
            first: time and pose of the first part.
            second: of the second.
            tip: (2,) m, at that time; None where it is too high to push.
        """
        if abs(first[0] - second[0]) > _TOGETHER:
            return
        self.pushes.add(tip, first[1], second[1])
        self._pushing = tip is not None
        place = in_frame(second[1][None, :2], first[1])[0]
        turn = float(second[1][2] - first[1][2])
        before = self._newest[-1][2] if self._newest else 0.0
        turn = before + (turn - before + np.pi) % (2.0 * np.pi) - np.pi
        self._newest.append(np.array([*place, turn]))
        if len(self._newest) == _AVERAGED:
            self._note(np.mean(self._newest, axis=0))
            del self._newest[:-1]

    def _note(self, pose: Array) -> None:
        away = [abs(seen.mean[2] - pose[2]) for seen in self._seen]
        near = int(np.argmin(away)) if away else -1
        if near >= 0 and away[near] < _ALIKE:
            self._seen[near].add(pose)
        else:
            self._seen.append(_Seen(pose))
        turns = [seen.mean[2] for seen in self._seen]
        self.turned = self.turned or max(turns) - min(turns) > _TURNS
        self._fresh = True

    def hinge(self, first: Array, second: Array) -> Hinge | None:
        """Return the joint of parts with outlines (V, 2), each in its frame; None while unknown.

        j_1 - R(turn) j_2 = place of the second part in the first one's frame, least squares.
        """
        if self._fresh and self.turned:
            self._hinge, self._fresh = self._found(first, second), False
        return self._hinge

    def rubbing(self, parts: tuple[PushedBody, PushedBody], hinge: Hinge) -> Rubbing:
        """Return friction under the parts, fitted anew after each push."""
        known = self.pushes.count, hinge.locked
        if known != self._fitted and not self._pushing:
            self._numbers, self._fitted = self.pushes.fitted(parts, hinge), known
        return rubbing(parts, hinge, self._numbers)

    def _found(self, first: Array, second: Array) -> Hinge | None:
        poses = np.array([seen.mean for seen in self._seen])
        weight = np.sqrt([float(seen.count) for seen in self._seen])
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        one, none = np.ones_like(cos), np.zeros_like(cos)
        rows = (
            np.concatenate(
                [
                    np.stack([one, none, -cos, sin], axis=1),
                    np.stack([none, one, -sin, -cos], axis=1),
                ]
            )
            * np.tile(weight, 2)[:, None]
        )
        information = rows.T @ rows / _NOISE**2
        std = np.sqrt(np.diag(np.linalg.pinv(information)))
        if np.linalg.cond(information) > 1e10 or std.max() > _KNOWN:
            return None
        wanted = np.concatenate([poses[:, 0], poses[:, 1]]) * np.tile(weight, 2)
        found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        at = found[:2] - turned(np.tile(found[2:], (len(poses), 1)), poses[:, 2])
        miss = np.linalg.norm(at - poses[:, :2], axis=1)
        outside = max(
            float(distance_outside(outline, place[None])[0])
            for outline, place in ((first, found[:2]), (second, found[2:]))
        )
        if miss.max() > _LOOSE or outside > _BESIDE:
            return None
        return Hinge(found[:2], found[2:])


def body_of_two(
    parts: tuple[PushedBody, PushedBody], poses: tuple[Array, Array], watch: JointWatch
) -> Pushable:
    """Return what is to be pushed of two parts at poses (3,), each with its outline in its frame.

    They are one body until they turn; then two parts on a joint once its place is known; else the
    second is only in the way.
    """
    first, second = parts
    hinge = watch.hinge(first.outline, second.outline)
    if not watch.turned:
        middle = 0.5 * (placed(first.com[None], poses[0]) + placed(second.com[None], poses[1]))
        one, two = (in_frame(middle, pose)[0] for pose in poses)
        hinge = Hinge(one, two, locked=True)
    if hinge is not None:
        return JointedBody(
            parts, hinge, float(poses[1][2] - poses[0][2]), watch.rubbing(parts, hinge)
        )
    return first.beside(in_frame(placed(second.outline, poses[1]), poses[0]))
