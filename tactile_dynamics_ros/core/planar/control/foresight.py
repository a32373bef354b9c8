"""How far from a goal pushes would end, given how well the object is known: a reason to stop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer, Others
from tactile_dynamics_ros.core.planar.actions.information import Belief
from tactile_dynamics_ros.core.planar.control.controller import ControlConfig, PushController
from tactile_dynamics_ros.core.planar.control.performance import Seen, WayConfig
from tactile_dynamics_ros.core.planar.control.plan import Bounds, PlanConfig, PushPlanner
from tactile_dynamics_ros.core.planar.control.prediction import PushedBody, pushed

_STEP = 1.0 / 30.0
"""s from one imagined pose to the next: what cameras bring, 1.7 mm of a push at 5 cm/s."""


@dataclass(frozen=True, eq=False)
class Task:
    """A pose to which an object is to be pushed.

    Attributes:
        goal: (3,) x, y (m) and yaw (rad). body: as seen, whatever its centre.
        bounds: of the tip. tip: (4,) where it is now.
        largest: error that is small enough, m; angles count at an arm, as in plans.
        plan, way, control: as `push_controller` has them.
    """

    goal: Array
    body: PushedBody
    bounds: Bounds
    tip: Array
    largest: float
    plan: PlanConfig = field(default_factory=PlanConfig)
    way: WayConfig = field(default_factory=WayConfig)
    control: ControlConfig = field(default_factory=ControlConfig)

    def errors(self, belief: Belief, pose: Array) -> Iterator[float]:
        """Yield the error at the goal, m, for four places of the true centre of mass.

        The controller pushes in closed loop what it takes for an object with the mean centre; the
        places are the cubature points of the belief, x ± sqrt(2) L_k with L L' = its covariance.
        Mass and friction do not count: pushes to a goal are slow.

        Args:
            belief: what is known.
            pose: (3,) of the object.

        Source: Arasaratnam and Haykin 2009, Eq. 19 (points); stop by the task: Poke and Strike,
        2509.00178.
        """
        believed = replace(self.body, com=belief.mean[2:4])
        root = np.linalg.cholesky(belief.covariance[2:4, 2:4])
        for way in np.concatenate([root.T, -root.T]):
            true = replace(self.body, com=belief.mean[2:4] + np.sqrt(2.0) * way)
            yield self._ended(believed, true, pose)

    def _ended(self, believed: PushedBody, true: PushedBody, pose: Array) -> float:
        """Error, m, with which the controller of one object leaves another."""
        planner = PushPlanner(believed, self.goal, self.bounds, self.plan)
        controller = PushController(planner, self.way, self.control)
        tip, time = self.tip.copy(), 0.0
        while controller.outcome is None:
            skipped = controller.skip_way()
            if skipped is not None:
                tip, duration = skipped
                time += duration
            target = controller.advance(Seen(time, tip, pose, time))
            if max(tip[2], target[2]) < 2.0 * self.way.height:
                pose = pushed(true, pose[None], tip[None, :2], (target - tip)[None, :2])[0][0]
            tip, time = target, time + _STEP
        return planner.left(pose)


def next_for(
    task: Task, explorer: Explorer, belief: Belief, pose: Array, others: Others = ()
) -> tuple[Explorer, Choice | str]:
    """Choose in another process as `next_choice` does, unless the task needs no more.

    Args:
        task: what the object is explored for.
        explorer: chooses.
        belief: what is known.
        pose: (3,) of the object.
        others: (V, 2) m each, outlines of other parts in the object's frame.
    """
    worst = 0.0
    for error in task.errors(belief, pose):
        worst = max(worst, error)
        if worst > task.largest:
            return explorer, explorer.choose(belief, pose, others)
    known = 1e3 * float(np.sqrt(np.trace(belief.covariance[2:4, 2:4])))
    return explorer, (
        f"the goal needs no more: with the centre of mass known to {known:.1f} mm, pushes in "
        f"simulation end within {1e3 * worst:.1f} mm of it (wanted {1e3 * task.largest:.1f})"
    )
