"""Node: pushes and pulls the object where that tells most; differently, if it changes."""

from __future__ import annotations

import json
import time
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.task import Future as RosFuture
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.planar.actions.affordances import ExploreConfig
from tactile_dynamics_ros.core.planar.actions.directions import DirectionExplorer
from tactile_dynamics_ros.core.planar.actions.exploration import Choice, Explorer, next_choice
from tactile_dynamics_ros.core.planar.actions.information import (
    Belief,
    PredictedObject,
    SensingConfig,
)
from tactile_dynamics_ros.core.planar.actions.pair import PairExplorer
from tactile_dynamics_ros.core.planar.actions.straight import drawing_back, freeing
from tactile_dynamics_ros.core.planar.control.foresight import Task, next_for
from tactile_dynamics_ros.core.planar.control.performance import (
    Guard,
    GuardConfig,
    Performance,
    Seen,
    WayConfig,
    action_of,
)
from tactile_dynamics_ros.core.planar.mechanics.outline import convex_hull
from tactile_dynamics_ros.ros.actions import CANCELED, Action
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.conversions import pose_to_message
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import (
    EXPLORE,
    EXPLORE_CHANGE,
    EXPLORE_PROGRESS,
    GRIPPER_TARGET,
    PROPERTY_STATUS,
    PUSHER_TARGET,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.refitter import PairFits
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.table_scene import (
    AT_REST,
    CONTACTS,
    OPEN,
    WORLD,
    TableScene,
    TableSceneConfig,
    tip_pose,
)
from tactile_dynamics_ros.ros.wire import Stamp

GAP = 0.006
"""Between tip and object before a push, m: outlines from cameras are right to 2 mm."""
_FORCE = "friction_force_n"
"""Name of what `explore` has to know at least: the friction force, of two parts that of both."""
JERKED = "so that it jerked: numbers from it may be wrong by more than they say"
"""What is said of a push that had to wait for poses midway: in two such explorations of a simulated
object its friction force was off by 1.8 and 2.3 standard deviations, in a smooth one by 0.6."""
_STOPPED = 3
"""Pushes of one call that may be stopped by too much force, each at half the speed of those before,
or where the arm cannot go: at an eighth of the speed the next one says that the object is blocked
or too heavy, not hit too hard."""
SILENT = 5.0
"""Real time without a pose of the tip after which exploring is given up, s."""


@dataclass
class Run:
    """A call of the service that is being answered.

    Attributes:
        answer: where it is awaited. explorer: that chooses. part: that is pushed, 0 or 1.
        actions: done, as told in the end. rivals: of the last action, as JSON.
        choosing: while that runs. choice: made. performance: while it is carried out.
        fits: estimates before the last push. since: monotonic s, when it ended.
        touched: whether it touched anything, so that an estimate of it will come.
        stopped: pushes that too much force has stopped, or an arm that could not follow.
    """

    answer: RosFuture
    explorer: Explorer | PairExplorer
    part: int = 0
    actions: list[dict[str, object]] = field(default_factory=list)
    rivals: str = "[]"
    choosing: Future[tuple[Explorer | PairExplorer, Choice | str]] | None = None
    performance: Performance | None = None
    fits: int = 0
    since: float = -np.inf
    touched: bool = False
    stopped: int = 0

    @property
    def waits(self) -> bool:
        """Whether the next push is chosen by the estimate from the last one."""
        return not isinstance(self.explorer, DirectionExplorer)


class ExplorerNode(Shell):
    """On request chooses a push or a pull, makes it, waits for the estimate, and chooses again."""

    skimming = by_arrival = True

    def __init__(self) -> None:
        super().__init__("explorer")
        self.config = declare_config(
            self, ExploreConfig, live=["goal", "goal_error"], on_change=self._ask_otherwise
        )
        self.sensing = declare_config(self, SensingConfig, "sensing.")
        self.way = declare_config(self, WayConfig, "way.")
        self.guard = declare_config(self, GuardConfig)
        self.scene = TableScene(self, declare_config(self, TableSceneConfig), self._follow)
        self._background = Background()
        self._pair: PairFits | None = None
        self._run: Run | None = None
        self._heard = time.monotonic()
        self._target = self.create_publisher(PoseStamped, PUSHER_TARGET, 10)
        self._jaws = self.create_publisher(Float64, GRIPPER_TARGET, 10)
        self._width: float | None = None
        self._progress = self.latched(DiagnosticStatus, EXPLORE_PROGRESS)
        self.stop = EmergencyStop(self, lambda why: self._finish(why, False))
        for name, kind in ((EXPLORE, Explorer), (EXPLORE_CHANGE, DirectionExplorer)):
            self.create_service(Trigger, name, partial(self._answer, kind), qos_profile=REQUESTS)
        self.action = Action(
            self,
            "Explore",
            EXPLORE,
            lambda goal: self._start(DirectionExplorer if goal.change else Explorer),
            lambda: self._finish(CANCELED, False),
        )
        self.every(0.1, self._advance)

    def destroy_node(self) -> None:
        """Stop the background work too."""
        self._background.close()
        self.action.close()
        super().destroy_node()

    async def _answer(
        self, kind: type[Explorer], _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Explore, or push in directions that differ; the answer comes at the end, or why not."""
        try:
            response.success, response.message = await self._start(kind)
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
        return response

    def _start(self, kind: type[Explorer]) -> RosFuture:
        """Begin to explore, or say why not; return where the answer will be."""
        self.stop.require_released()
        if self._run is not None:
            raise NotIdentifiableError("it is already exploring")
        self._run = Run(RosFuture(), self._chooser(kind), performance=self._freeing())
        self._heard = time.monotonic()
        return self._run.answer

    def _chooser(self, kind: type[Explorer]) -> Explorer | PairExplorer:
        """Two parts are only pushed, as a grip may hold them together."""
        first = self.scene.first_part().outline
        if self._pair is None:
            return self._explorer(kind, first, self.config)
        manners = tuple(each for each in self.config.manners if each in ("push", "stop"))
        pushing = replace(self.config, manners=manners or ("push",))
        if kind is not Explorer:
            return self._explorer(kind, first, pushing)
        outlines = first, self.scene.of_second()[1]
        return PairExplorer([self._explorer(kind, each, pushing) for each in outlines])

    def _explorer(self, kind: type[Explorer], outline: Array, chosen: ExploreConfig) -> Explorer:
        config = self.scene.config
        thing = PredictedObject(
            convex_hull(outline),
            config.tip_friction,
            push_height=self.way.height,
            footprint=outline,
        )
        room = (np.array(config.low), np.array(config.high))
        return kind(thing, chosen, self.sensing, room, config.tip_radius, self.way.opening)

    def _view(self, part: int) -> tuple[Seen, list[Array]]:
        """What is seen of a part, and the outlines of others in its frame."""
        if part:
            seen, _, beside = self.scene.of_second()
            return seen, [beside]
        second = self.scene.second_outline()
        return self.scene.seen(), [] if second is None else [second]

    def _beliefs(self, explorer: PairExplorer) -> list[Belief]:
        """What is known of each of two parts."""
        assert self._pair is not None
        outlines = [each.thing.outline for each in explorer.explorers]
        return [self.scene.belief(o, self._pair.values(k)) for k, o in enumerate(outlines)]

    def _freeing(self) -> Performance | None:
        """Let go first of what a pull still holds that was stopped; None where jaws are closed."""
        if self.scene.width < OPEN:
            return None
        action = freeing(self.scene.seen().tip, self.way, self.scene.support)
        return Performance(action, Guard(self.guard, unloads=True))

    def _follow(self) -> None:
        """Answer a pose of the tip while a push is made."""
        self._heard = time.monotonic()
        run, performance = self._run, None if self._run is None else self._run.performance
        if run is None or performance is None:
            return
        if self.scene.fallen:
            self._move(self.scene.seen().tip, None, AT_REST)
            self._finish("the object has fallen over", False)
            return
        target = performance.advance(self.scene.seen())
        self._move(target, performance.width, AT_REST if performance.finished else self.scene.stamp)
        if performance.why:
            self._interrupt(run, performance)
        elif performance.finished:
            self._conclude(run, performance)

    def _interrupt(self, run: Run, performance: Performance) -> None:
        """Draw back from too much force, or from where the arm cannot go; end for all else."""
        if run.actions:
            run.actions[-1]["stopped"] = performance.why
        run.touched = run.touched or performance.touched
        goes_on = performance.pressed or performance.off_target
        run.stopped += goes_on
        if not goes_on or run.stopped > _STOPPED:
            self._finish(performance.why, False)
            return
        (run.explorer.soften if performance.pressed else run.explorer.avoid)()
        run.performance = self._drawing_back(run)
        gently = "at half the speed, " if performance.pressed else ""
        self._tell("stopped", f"{performance.why}: the next pushes go {gently}elsewhere")

    def _drawing_back(self, run: Run) -> Performance:
        """Let go of what is gripped, or go back along the way of the push, and rise."""
        direction = np.array(run.actions[-1]["direction"] if run.actions else (0.0, 0.0))
        back = drawing_back(self.scene.seen().tip, direction, self.way, self.scene.support)
        return self._freeing() or Performance(back, Guard(self.guard, unloads=True))

    def _conclude(self, run: Run, performance: Performance) -> None:
        """Wait for the estimate from a motion, if it was a push that touched anything."""
        run.performance, holes = None, performance.holes
        run.touched = run.touched or performance.touched
        if run.actions and holes:
            run.actions[-1]["jerked"] = f"{holes} gaps between poses of the tip, {JERKED}"
        if run.actions and not run.touched:
            run.actions[-1]["missed"] = "no force was felt and nothing moved"
            self._tell("missed", "no force was felt and nothing moved: no estimate is awaited")
        elif run.actions:
            run.since = time.monotonic()
            self._tell("waiting", "for the estimate from this push")
            if self._pair is not None and run.waits:
                self._pair.ask()

    def _move(self, target: Array, width: float | None, stamp: Stamp) -> None:
        """Send tip and jaws where they should be now."""
        if width is not None and width != self._width:
            self._jaws.publish(Float64(data=width))
        self._width = width
        self._target.publish(pose_to_message(tip_pose(target), stamp, WORLD))

    def _advance(self) -> None:
        """Choose when the last push has been judged; begin what is chosen."""
        if self._pair is None and self.scene.second_outline() is not None:
            self._pair = PairFits(self, CONTACTS, self._background)
        if self._pair is not None:
            self._pair.advance()
        run = self._run
        if run is None or run.performance is not None:
            return
        if time.monotonic() - self._heard > SILENT:
            self._finish(f"no pusher/pose for {SILENT:g} s", False)
        elif run.choosing is not None:
            if run.choosing.done():
                self._begin(run, run.choosing)
        elif not run.waits or self._is_judged(run) or self._is_late(run):
            if self._pair is None and run.actions and not self.scene.properties:
                self._finish(f"no {PROPERTY_STATUS} came: is property_estimator running?", False)
                return
            self._choose(run)

    def _is_judged(self, run: Run) -> bool:
        """Whether the estimate of the last push has come, or there is nothing to estimate."""
        if run.actions and not run.touched:
            return True
        return self.scene.fits > run.fits if self._pair is None else not self._pair.busy

    def _is_late(self, run: Run) -> bool:
        """Whether the estimate of the last push has been awaited for too long; it is noted."""
        late = time.monotonic() - run.since > self.config.patience
        if late and run.actions:
            run.actions[-1]["late"] = f"no estimate of it after {self.config.patience:g} s"
        return late

    def _choose(self, run: Run) -> None:
        """Begin to choose."""
        if isinstance(run.explorer, PairExplorer):
            assert self._pair is not None
            poses = np.stack([self._view(part)[0].pose for part in (0, 1)])
            run.choosing = self._background.submit(
                next_choice, run.explorer, self._pair.found, self._beliefs(run.explorer), poses
            )
        else:
            seen, others = self._view(0)
            asked = run.explorer, self.scene.belief(run.explorer.thing.outline), seen.pose, others
            if self.config.goal_error and run.waits:
                run.choosing = self._background.submit(next_for, self._task(), *asked)
            else:
                run.choosing = self._background.submit(next_choice, *asked)
        self._tell("choosing", "simulating pushes")

    def _task(self) -> Task:
        """What the object is explored for."""
        x, y, turn = self.config.goal
        goal, scene = np.array([x, y, np.deg2rad(turn)]), self.scene
        error, tip = self.config.goal_error, scene.seen().tip
        return Task(goal, scene.first_part(), scene.config.bounds, tip, error, way=self.way)

    def _ask_otherwise(self, config: ExploreConfig) -> str:
        """Explore for another goal, or for none, from the next choice on."""
        self.config = config
        return "counts from the next push on that is chosen"

    def _begin(
        self, run: Run, choosing: Future[tuple[Explorer | PairExplorer, Choice | str]]
    ) -> None:
        run.choosing = None
        try:
            run.explorer, choice = choosing.result()
            if isinstance(choice, str):
                self._finish(choice, True)
                return
            run.part = choice.part
            seen, _ = self._view(run.part)
            radius = self.scene.config.tip_radius
            action = action_of(choice.candidate, seen, self.way, self.scene.support, radius, GAP)
        except TactileDynamicsError as error:
            self._finish(str(error), False)
            return
        run.fits, run.performance = self.scene.fits, Performance(action, Guard(self.guard))
        run.touched = False
        run.actions.append(choice.to_json(seen.pose))
        run.rivals = json.dumps(choice.rivals_json(seen.pose))
        self._tell("pushing", choice.because)

    def _tell(self, state: str, text: str, level: bytes = DiagnosticStatus.OK) -> None:
        assert self._run is not None
        values: dict[str, object] = {"state": state, "actions": len(self._run.actions)}
        if self._run.actions:
            values |= {**self._run.actions[-1], "rivals": self._run.rivals}
        self._progress.publish(status_message("explorer", values, level, text))
        self.action.tell(state, min(1.0, len(self._run.actions) / self.config.budget), text)

    def _finish(self, why: str, success: bool) -> None:
        """Leave the tip where it is and answer."""
        if self._run is None:
            return
        level = DiagnosticStatus.OK if success else DiagnosticStatus.WARN
        self._tell("finished", why, level)
        told = {
            "actions": self._run.actions,
            "properties": self._properties(),
            "stopped_because": why,
        }
        answer, self._run = self._run.answer, None
        answer.set_result((success, json.dumps(told)))
        known = told["properties"].get("undetermined", [])
        self.action.end(success, why, told, actions=len(told["actions"]), undetermined=known)

    def _properties(self) -> dict[str, object]:
        """The newest estimate as `estimate --json` tells it; of two parts with what they are."""
        if self._pair is None:
            return self.scene.properties_json()
        unknown: dict[str, object] = {"links": [], "undetermined": ["structure", _FORCE]}
        told = {"said": self._pair.said, "refused": self._pair.refused}
        return (self._pair.found or unknown) | told


def main() -> int:
    """Run the node."""
    return run_node(ExplorerNode)
