"""What stops every motion: force, stale poses, an arm that does not follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter

Array = NDArray[np.float64]

_MISSED, _MISSED_FOR = 0.03, 1.0
"""m by which a tip may be from its target, and s for how long: a tip that travels at 0.3 m/s lags
by 15 mm. Beyond, the arm is blocked, out of reach or commanded by somebody else."""


@dataclass(frozen=True)
class GuardConfig:
    """What no motion may go on with."""

    most_force: float = parameter(25.0, "of the contact, at which it stops", "N", 0.1, 200.0)
    stale: float = parameter(0.5, "age of the object's pose at which it stops", "s", 0.05, 10.0)

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True)
class Seen:
    """What is known at an instant.

    Attributes:
        time: s. tip: (4,) x, y, z (m) and turn (rad). pose: (3,) of the object. pose_time: s.
        force: N of the contact; 0 where nothing is felt or nobody tells.
    """

    time: float
    tip: Array
    pose: Array
    pose_time: float
    force: float = 0.0


class Guard:
    """Watches a motion.

    Args:
        config: limits.
        unloads: whether the motion only draws back; then no force stops it.

    Attributes:
        pressed: whether it was too much force that stopped the motion.
        off_target: whether it was that the arm does not follow its targets.
    """

    def __init__(self, config: GuardConfig, unloads: bool = False) -> None:
        self._most_force, self._stale = config.most_force, config.stale
        self._unloads, self.pressed, self.off_target = unloads, False, False
        self._missed = np.inf

    def reason(self, seen: Seen, target: Array | None) -> str:
        """Why the motion has to stop, in words; empty if it may go on.

        Args:
            seen: now.
            target: (4,) where the tip was sent last; None at first.
        """
        if seen.force > self._most_force and not self._unloads:
            self.pressed = True
            return f"the contact bears {seen.force:.1f} N, more than {self._most_force:g} N"
        if seen.time - seen.pose_time > self._stale:
            return f"the object's pose is {seen.time - seen.pose_time:.2g} s old"
        far = miss(seen, target) >= _MISSED
        self._missed = min(self._missed, seen.time) if far else np.inf
        if seen.time - self._missed > _MISSED_FOR:
            self.off_target = True
            return "the arm does not follow its targets"
        return ""


def miss(seen: Seen, target: Array | None) -> float:
    """Distance of the tip from where it was last sent, m."""
    return 0.0 if target is None else float(np.linalg.norm(target[:3] - seen.tip[:3]))
