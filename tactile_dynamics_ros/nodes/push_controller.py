"""Node: pushes the object to a pose."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message

from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.planar.control.controller import (
    ControlConfig,
    PushController,
)
from tactile_dynamics_ros.core.planar.control.performance import WayConfig
from tactile_dynamics_ros.core.planar.control.plan import PlanConfig, PushPlanner
from tactile_dynamics_ros.ros.actions import CANCELED, Action
from tactile_dynamics_ros.ros.conversions import pose_to_core, pose_to_message
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.names import (
    GOAL_POSE,
    PUSH,
    PUSH_PROGRESS,
    PUSH_STOP,
    PUSHER_POSE,
    PUSHER_TARGET,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import Shell, run_node
from tactile_dynamics_ros.ros.table_scene import (
    AT_REST,
    OPEN,
    WORLD,
    TableScene,
    TableSceneConfig,
    tip_pose,
)
from tactile_dynamics_ros.ros.wire import Stamped, decode_stamped

SILENT = 5.0
"""Real time without a pose of the tip after which a push is given up, s: nothing is sent meanwhile,
so that the tip rests, and a loaded machine falls silent for a second or two."""


class PushControllerNode(Shell):
    """Takes /goal_pose as the call to push; answers each pose of the tip with its next target."""

    skimming = by_arrival = True

    def __init__(self) -> None:
        super().__init__("push_controller")
        self.plan = declare_config(self, PlanConfig, "plan.")
        self.straight = declare_config(self, WayConfig, "way.")
        self.config = declare_config(self, ControlConfig)
        self.scene = TableScene(self, declare_config(self, TableSceneConfig), self._answer)
        self.controller: PushController | None = None
        self._heard, self._farthest = time.monotonic(), 0.0
        self._target = self.create_publisher(PoseStamped, PUSHER_TARGET, 10)
        self._progress = self.latched(DiagnosticStatus, PUSH_PROGRESS)
        self.stop = EmergencyStop(self, self._halt)
        self.listen(PoseStamped, GOAL_POSE, self._on_goal)
        self.serve(PUSH_STOP, self._on_stop)
        self.action = Action(self, "Push", PUSH, self._begin, lambda: self._halt(CANCELED))
        self.every(0.2, self._tell)

    def destroy_node(self) -> None:
        """Leave the tip where it is."""
        self.action.close()
        super().destroy_node()

    def _answer(self) -> None:
        """Answer a pose of the tip while a goal is pursued."""
        controller = self.controller
        if controller is None:
            return
        if controller.phase in ("look", "push") and self.scene.second_outline() is not None:
            controller.planner.body = self.scene.body()  # where parts lie now, and whether jointed
        if self.scene.fallen:
            rest = tip_pose(self.scene.seen().tip)
            self._target.publish(pose_to_message(rest, AT_REST, WORLD))
            self._halt("the object has fallen over")
            return
        target = controller.advance(self.scene.seen())
        self._heard = time.monotonic()  # a plan takes a while, and nothing is heard meanwhile
        stamp = self.scene.stamp if controller.outcome is None else AT_REST
        self._target.publish(pose_to_message(tip_pose(target), stamp, WORLD))
        if controller.outcome is not None:
            self._finish()

    def _on_goal(self, message: Stamped) -> None:
        """Begin, or take the new goal from where the tip is."""
        try:
            self.action.require_free()
            self._pursue(message, GOAL_POSE)
        except TactileDynamicsError as error:
            self._publish(False, str(error), {})
            raise

    def _begin(self, goal: Any) -> None:
        """Begin with the goal of the action, unless one of goal_pose is pursued."""
        if self.controller is not None:
            raise NotIdentifiableError(f"a goal of {GOAL_POSE} is pursued; {PUSH_STOP} ends that")
        self._pursue(decode_stamped(serialize_message(goal.pose), 7), PUSH)

    def _pursue(self, message: Stamped, source: str) -> None:
        """Plan for a goal that came on `source`.

        Raises:
            TactileDynamicsError: the stop is on, the object is not known, or the jaws are open.
        """
        pose = pose_to_core(message, source, WORLD)
        goal = np.array([*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])])
        self.stop.require_released()
        body = self.scene.body()
        if self.scene.width > OPEN:
            raise NotIdentifiableError(
                f"the jaws are {1e3 * self.scene.width:.0f} mm open, perhaps around the "
                "object, and only a closed gripper pushes: call /explorer/explore, which lets "
                "go first, or close them"
            )
        planner = PushPlanner(body, goal, self.scene.config.bounds, self.plan)
        self.controller = PushController(planner, self.straight, self.config, self.scene.support)
        self._heard, self._farthest = time.monotonic(), 1e-9

    def _on_stop(self) -> str:
        self._halt("it was told to stop")
        return "stopped"

    def _halt(self, why: str) -> None:
        """Leave the tip where it is."""
        if self.controller is not None:
            self.controller.stop(self.scene.seen(), why)
            self._finish()

    def _finish(self) -> None:
        assert self.controller is not None and self.controller.outcome is not None
        outcome, taken = self.controller.outcome, self.controller.planner.body.words
        self.controller = None
        told = outcome.to_json() | {"object": taken}
        self._publish(True, outcome.why, {"result": json.dumps(told)})
        self.action.end(
            outcome.reached,
            outcome.why,
            told,
            position_error=outcome.error_m,
            yaw_error=outcome.error_rad,
            pushes=outcome.pushes,
            duration=outcome.duration_s,
        )

    def _tell(self) -> None:
        """Say what is being done."""
        if time.monotonic() - self._heard > SILENT:
            self._halt(f"no {PUSHER_POSE} for {SILENT:g} s")
        if self.controller is not None:
            values = self.controller.progress(self.scene.seen())
            values["object"] = self.controller.planner.body.words
            self._publish(None, self.controller.phase, values)
            left = self.controller.planner.left(self.scene.seen().pose)
            self._farthest = max(self._farthest, left)
            text = f"{1e3 * values['error_m']:.1f} mm to go, push {values['pushes']}"
            self.action.tell(self.controller.phase, 1.0 - left / self._farthest, text)

    def _publish(self, finished: bool | None, text: str, values: dict[str, object]) -> None:
        state = {True: "finished", False: "refused", None: "pushing"}[finished]
        level = DiagnosticStatus.WARN if finished is False else DiagnosticStatus.OK
        status = status_message("push_controller", {"state": state, **values}, level, text)
        self._progress.publish(status)


def main() -> int:
    """Run the node."""
    return run_node(PushControllerNode)
