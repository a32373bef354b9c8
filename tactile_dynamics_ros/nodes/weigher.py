"""Node: an arm weighs what its wrist sensor carries, and hands it to the controller when asked."""

from __future__ import annotations

import json
import time
from collections.abc import Generator
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.task import Future as RosFuture
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
)
from tactile_dynamics_ros.core.weighing.arm import SerialArm
from tactile_dynamics_ros.core.weighing.excitation import (
    WeighingConfig,
    WeighingMotion,
    plan_weighing,
)
from tactile_dynamics_ros.recording.yaml_files import read_body
from tactile_dynamics_ros.ros.actions import CANCELED, Action, interface
from tactile_dynamics_ros.ros.arm_motion import (
    ArmMotion,
    ArmMotionConfig,
    trajectory_message,
    way_markers,
)
from tactile_dynamics_ros.ros.background import Background
from tactile_dynamics_ros.ros.conversions import header
from tactile_dynamics_ros.ros.diagnostics import status_message
from tactile_dynamics_ros.ros.emergency import EmergencyStop
from tactile_dynamics_ros.ros.handover import (
    Handover,
    HandoverConfig,
    Weighed,
    advise,
    ask,
    keep,
    new_folder,
    save,
)
from tactile_dynamics_ros.ros.listening import REQUESTS
from tactile_dynamics_ros.ros.names import (
    ROBOT_DESCRIPTION,
    WEIGH,
    WEIGH_MARKERS,
    WEIGH_MOTION,
    WEIGH_PLAN,
    WEIGH_PROCEED,
    WEIGH_PROGRESS,
    WEIGH_STOP,
)
from tactile_dynamics_ros.ros.parameters import declare_config
from tactile_dynamics_ros.ros.shell import LATCHED, Shell, run_node
from tactile_dynamics_ros.ros.typed_messages import body_message

STEP = 0.02
"""Real time between looks at a motion, s: an arm of 0.5 rad/s turns by 0.6 deg meanwhile."""
FEEDBACK_STEP = 0.1
"""Step of the share done at which a goal's client gets feedback, beside each new phase: ten lines
for a person to read; programs follow weigher/progress."""
DISCOVERY = 5.0
"""Real time for joints, sensor, controller and URDF to be found, s: a node that was just started
needs some of it."""


@dataclass(frozen=True)
class WeigherConfig:
    """What is weighed, in which order, and frames of the arm."""

    tool: str = parameter(
        "measure", "measure: first without the load; none: no tool; or its file (estimate --save)"
    )
    order: str = parameter(
        "AB", "A without the load, B with it: AB, or ABBA where the sensor drifts"
    )
    apply: bool = parameter(False, "hand the payload to the controller, if nothing is in doubt")
    base: str = parameter("", "link that stands still, z up; empty: the root of the URDF")
    sensor: str = parameter("", "link of the sensor; empty: the frame of its messages")
    of_sensor_on_load: bool = parameter(
        False, "whether it reads what it applies on the load, not what the load applies on it"
    )
    folder: str = parameter("weighed", "where recordings and numbers are kept")
    wait_for_load: float = parameter(600.0, "time for the load to be attached", "s", 1.0, 86400.0)

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.order not in ("AB", "ABBA"):
            raise BadInputError(f"order '{self.order}': expected AB or ABBA")


class Wanted(NamedTuple):
    """What is asked for.

    Attributes:
        apply: hand the payload over. dry_run: plan and show only. speed_share: of the joints'.
        tool: measure, none or a file.
    """

    apply: bool
    dry_run: bool
    speed_share: float
    tool: str


Story = Generator[None, None, None]


class WeigherNode(Shell):
    """Plans, moves, estimates, and hands over; nothing moves unless it is called."""

    gather = 0.002

    def __init__(self) -> None:
        super().__init__("weigher")
        self.config = declare_config(self, WeigherConfig)
        self.limits = declare_config(self, WeighingConfig, "motion.")
        self.arm_motion = ArmMotion(self, declare_config(self, ArmMotionConfig))
        self.handover = Handover(self, declare_config(self, HandoverConfig))
        self._background = Background()
        self._urdf = ""
        self._story: Story | None = None
        self._answer = RosFuture()
        self._proceed = False
        self._state, self._fed_back = ("idle", 0.0, ""), 0.0
        self._progress = self.latched(DiagnosticStatus, WEIGH_PROGRESS)
        self._shown = self.latched(JointTrajectory, WEIGH_MOTION)
        self._markers = self.latched(MarkerArray, WEIGH_MARKERS)
        self.emergency = EmergencyStop(self, self.halt)
        self.listen(String, ROBOT_DESCRIPTION, self._on_urdf, LATCHED)
        self.create_service(Trigger, WEIGH, self._weigh, qos_profile=REQUESTS)
        self.create_service(Trigger, WEIGH_PLAN, self._plan, qos_profile=REQUESTS)
        self.serve(WEIGH_PROCEED, self._on_proceed)
        self.serve(WEIGH_STOP, self._on_stop)
        self.action = Action(self, "Weigh", WEIGH, self._on_goal, lambda: self.halt(CANCELED))
        self.every(STEP, self._advance)
        self.every(0.5, self._tell)

    def destroy_node(self) -> None:
        """Bring the arm to rest, and stop the background work too."""
        self.halt("the node ends")
        self._background.close()
        self.action.close()
        super().destroy_node()

    def halt(self, why: str) -> None:
        """Stop the arm and whatever is being done."""
        self.arm_motion.stop(why)
        if self._story is not None:
            self._end(False, why, {})

    def _on_urdf(self, message: String) -> None:
        self._urdf = message.data

    def _on_proceed(self) -> str:
        if self._state[0] not in ("attach", "detach"):
            raise NotIdentifiableError(f"nothing waits for you; now: {self._state[0]}")
        self._proceed = True
        return "going on"

    def _on_stop(self) -> str:
        self.halt("stopped by a call")
        return "the arm stands"

    def _on_goal(self, goal: Any) -> None:
        tool = goal.tool or self.config.tool
        self._begin(Wanted(goal.apply, goal.dry_run, goal.speed_share, tool))

    async def _weigh(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._call(Wanted(self.config.apply, False, 0.0, self.config.tool), response)

    async def _plan(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return await self._call(Wanted(False, True, 0.0, self.config.tool), response)

    async def _call(self, wanted: Wanted, response: Trigger.Response) -> Trigger.Response:
        try:
            self.action.require_free()
            self._begin(wanted)
        except TactileDynamicsError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = await self._answer
        return response

    def _begin(self, wanted: Wanted) -> None:
        """Begin to weigh, or say why not."""
        if self._story is not None:
            raise NotIdentifiableError(f"it is weighing already; {WEIGH_STOP} ends that")
        self.emergency.require_released()
        if wanted.apply:
            self.handover.require_controller()
        self._answer = RosFuture()
        self._story = self._tell_story(wanted)

    def _advance(self) -> None:
        """Go on with what is being done."""
        if self._story is None:
            return
        try:
            next(self._story)
        except StopIteration:
            self._story = None
        except TactileDynamicsError as error:
            self._end(False, str(error), {})

    def _tell_story(self, wanted: Wanted) -> Story:
        """Plan, then move and estimate, tool first; yields while it waits."""
        arm = yield from self._await_arm()
        measured: dict[str, list[Path]] = {"A": [], "B": []}
        letters = (
            self.config.order if wanted.tool == "measure" else "B" * (len(self.config.order) // 2)
        )
        folder = None if wanted.dry_run else new_folder(self.config.folder)
        carried = ""
        for number, letter in enumerate(letters):
            if carried and letter != carried:
                yield from self._await_person("attach" if letter == "B" else "detach")
            carried = letter
            share = number / len(letters)
            self._note("plan", share, "designing a motion")
            motion = yield from self._design(arm, wanted)
            if wanted.dry_run or folder is None:
                self._end(True, "planned; nothing was moved", motion.to_json())
                return
            yield from self._move(motion, number, len(letters))
            sign = 1.0 if self.config.of_sensor_on_load else -1.0
            name = {"A": "tool", "B": "load"}[letter]
            path = folder / f"{name}_{len(measured[letter]) + 1}.mcap"
            measured[letter].append(keep(self.arm_motion.taken.after_lead(), arm, sign, path))
        yield from self._estimate(measured, folder, wanted)

    def _await_arm(self) -> Generator[None, None, SerialArm]:
        """Return the arm when joints, sensor, controller and URDF are there."""
        deadline = time.monotonic() + DISCOVERY
        while True:
            try:
                self.arm_motion.require_ready()
                return self._arm()
            except NotIdentifiableError:
                if time.monotonic() > deadline:
                    raise
            yield

    def _arm(self) -> SerialArm:
        """Return the arm from its URDF and the frame of the sensor."""
        if not self._urdf:
            raise NotIdentifiableError(f"no URDF on {ROBOT_DESCRIPTION} yet")
        tip = self.config.sensor or self.arm_motion.frame
        if not tip:
            raise NotIdentifiableError("the sensor's messages name no frame; set parameter sensor")
        return SerialArm.of_urdf(self._urdf, self.config.base, tip, what=ROBOT_DESCRIPTION)

    def _design(self, arm: SerialArm, wanted: Wanted) -> Generator[None, None, WeighingMotion]:
        start = self.arm_motion.position_of(arm.names)
        share = wanted.speed_share or self.limits.speed_share
        limits = replace(self.limits, speed_share=share)
        motion: WeighingMotion = yield from self._wait(
            self._background.submit(plan_weighing, arm, start, limits)
        )
        self._show(arm, motion)
        return motion

    def _show(self, arm: SerialArm, motion: WeighingMotion) -> None:
        """Publish the motion, and the way of the sensor for RViz."""
        times, positions, velocities = motion.table(10.0)
        self._shown.publish(trajectory_message(motion.names, times, positions, velocities))
        self._markers.publish(way_markers(arm.tip_poses(positions)[:, :3, 3], arm.base))

    def _move(self, motion: WeighingMotion, number: int, count: int) -> Story:
        self.emergency.require_released()
        self.arm_motion.begin(motion)
        while not self.arm_motion.watch():
            share = (number + self.arm_motion.share) / count
            text = f"motion {number + 1} of {count}"
            self._note("move", 0.8 * share, text)
            yield
        if self.arm_motion.stopped:
            raise NotIdentifiableError(f"stopped: {self.arm_motion.stopped}")

    def _await_person(self, what: str) -> Story:
        """Wait until somebody has changed what is carried."""
        text = {"attach": "attach the load", "detach": "take the load off"}[what]
        self._proceed, begun = False, time.monotonic()
        while not self._proceed:
            self._note(what, self._state[1], f"{text}, then call {WEIGH_PROCEED}")
            if time.monotonic() - begun > self.config.wait_for_load:
                raise NotIdentifiableError(f"nobody has called {WEIGH_PROCEED}: {text}")
            yield

    def _estimate(self, measured: dict[str, list[Path]], folder: Path, wanted: Wanted) -> Story:
        self._note("estimate", 0.85, "estimating")
        submit = self._background.submit
        tool_file = None if wanted.tool in ("measure", "none") else Path(wanted.tool)
        tool: Weighed | None = None
        if measured["A"]:
            tool = yield from self._wait(submit(ask, measured["A"], folder / "tool.yaml"))
            tool_file = tool.file
        load: Weighed = yield from self._wait(
            submit(ask, measured["B"], folder / "load.yaml", tool_file)
        )
        told: dict[str, Any] = load.document | {
            "tool": None if tool is None else tool.document,
            "load": load.document,
            "doubts": [*(() if tool is None else tool.doubts), *load.doubts],
            "advice": (yield from self._wait(submit(advise, measured["B"][0]))),
            "folder": str(folder),
            "handed_over": False,
        }
        text = f"{load.document['mass']['value']:.4f} kg"
        if wanted.apply:
            self._note("apply", 0.95, "handing the payload over")
            taken, said = yield from self._apply(measured["B"], folder, load, told["doubts"])
            told["handed_over"], text = taken, f"{text}; {said}"
        bodies = {"tool": tool, "load": load}
        self._end(True, text, told, **{
            name: self._message(body) for name, body in bodies.items() if body is not None
        })  # fmt: skip

    def _message(self, weighed: Weighed) -> Any:
        """Return the typed estimate of a body; None where its type is not installed."""
        if interface("msg.Estimate") is None:
            return None
        error = weighed.document["error"]["whitened_rms"]
        frame = self.config.sensor or self.arm_motion.frame
        head = header(self.arm_motion.taken.joint_time[-1], frame)
        return body_message(read_body(weighed.file), error, not weighed.doubts, head)

    def _apply(
        self, files: list[Path], folder: Path, load: Weighed, doubts: list[str]
    ) -> Generator[None, None, tuple[bool, str]]:
        """Hand over what the controller has to know: tool and load, or the load alone."""
        if doubts:
            return False, f"nothing handed over: {'; '.join(doubts)}"
        file = load.file
        if self.handover.takes_tool:
            file = folder / "payload.yaml"
            yield from self._wait(self._background.submit(save, files, file))
        assert self.executor is not None
        try:
            handed = self.executor.create_task(self.handover.give(read_body(file)))
            yield from self._wait(handed)
            result: tuple[bool, str] = handed.result()
        except NotIdentifiableError as error:
            return False, str(error)
        return result

    def _wait(self, work: Future[Any] | RosFuture) -> Generator[None, None, Any]:
        while not work.done():
            yield
        return work.result()

    def _note(self, phase: str, share: float, text: str) -> None:
        changed = phase != self._state[0]
        self._state = (phase, share, text)
        if changed:
            self._tell()
        if changed or abs(share - self._fed_back) >= FEEDBACK_STEP:
            self._fed_back = share
            self.action.tell(phase, share, text)

    def _tell(self) -> None:
        """Say what is being done."""
        phase, share, text = self._state
        values = {"phase": phase, "share_done": round(share, 3)}
        level = DiagnosticStatus.WARN if phase == "failed" else DiagnosticStatus.OK
        self._progress.publish(status_message("weigher", values, level, text))

    def _end(self, success: bool, text: str, document: dict[str, Any], **bodies: Any) -> None:
        """Answer whoever asked.

        Args:
            success: whether all was done.
            text: outcome in a sentence.
            document: what `weigh --json` prints.
            bodies: tool and load as messages, where they were weighed.
        """
        self._story = None
        self._note("done" if success else "failed", 1.0, text)
        if not self._answer.done():
            said = json.dumps(document) if success else text
            self._answer.set_result((success, said))
        handed = bool(document.get("handed_over", False))
        self.action.end(success, text, document or None, handed_over=handed, **bodies)


def main() -> int:
    """Run the node."""
    return run_node(WeigherNode)
