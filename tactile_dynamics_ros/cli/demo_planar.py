"""`tactile-dynamics demo --planar`: look at an object, explore it, push it, notice a change."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import require_effect_of_table, write_parameters
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.explore import describe
from tactile_dynamics_ros.cli.push_goal import ask
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command, verb_command
from tactile_dynamics_ros.cli.topics import short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.planar.actions.candidate import MANNERS
from tactile_dynamics_ros.ros.status_reader import Statuses, to_number
from tactile_dynamics_ros.share import share_file

if TYPE_CHECKING:
    from rclpy.node import Node

CONFIG = "config/planar_pusher.yaml"
"""Nodes and camera of the table; which of them the story starts, `nodes` says."""
GOAL = (0.5, 0.1, 0.0)
"""m, m, deg: where the object is pushed, the goal of Dutta et al."""
BUDGET = 5
"""Pushes and pulls that explore, known or not: with a fit after each the story ends within five
minutes, and changes are told by a reference that they make: one of three pushes is replaced by
the next fits, which may already contain a change."""
TRIES = 3
"""Calls of the explorer, each after one that was stopped for safety: a third says that it is not
chance."""
START = 120.0
"""Real seconds within which all nodes must be heard: the slowest machines import for a minute."""
CHECKING: dict[str, object] = {"model": "pushed", "period": 600.0, "diagnosis_window": 60.0}
"""model_check diagnoses on request; comparisons meanwhile would take time from the fits."""
PATIENCE = 600.0
"""Real seconds for exploring, on a machine that does other things too."""
ANSWERED = 10.0
"""Real seconds that the simulation waits for the next target of a pushing arm before it goes on
without: plans of the controller take some of them on a machine that does ten other things."""
TRACKED = 30.0
"""Hz of the tracker of markers, as depth cameras give images."""


def play(args: Namespace, out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Play the story; afterwards everything is stopped. Return what is told as JSON.

    Args:
        args: of the verb.
        out: folder of recording, logs and report.
        say: prints a line for people.
    """
    started = time.monotonic()
    table = table_parameters(args)
    with private_domain() as domain, Supervisor(out / "logs") as supervisor:
        say(f"nodes run on ROS domain {domain} of this host; look in with")
        say(f"  ROS_DOMAIN_ID={domain} tactile-dynamics echo /property_estimator/status")
        supervisor.start("recorder", verb_command("record", str(out / "recording")))
        files = write_parameters(share_file(CONFIG), out / "parameters")
        for name, parameters in nodes(table, args.seed).items():
            supervisor.start(name, node_command(name, files.get(name), parameters))
        supervisor.start("shape_estimator", looking_command(files["shape_estimator"]))
        with short_lived_node() as node:
            told = _story(node, supervisor, say, args.hidden != "none")
        supervisor.stop(["recorder"])
    (out / "truth.json").write_text(json.dumps(told["truth"], indent=1) + "\n")
    say(f"recorded {out / 'recording'}; all processes are stopped")
    _reveal(told["truth"]["hidden_effect"], say)
    from tactile_dynamics_ros.report.exploration import compare_properties, write_exploration

    told["compared"] = compare_properties(told["explored"]["properties"], told["truth"])
    for row in told["compared"]:
        name = f"{row['part']} {row['name']}".strip()
        say(f"  {name}: {row['value']:.4g} +- {row['std']:.2g}, truth {row['truth']:.4g}")
    told["report"] = str(write_exploration(told, out))
    told["wall_time_s"] = round(time.monotonic() - started, 1)
    say(f"done in {told['wall_time_s']:.0f} s; open {told['report']}")
    return told


def _reveal(hidden: dict[str, Any], say: Callable[[str], None]) -> None:
    """Say what was hidden."""
    if hidden["begins"] is None:
        return
    told = ", ".join(
        f"{name} {entry['value']} {entry['unit']}".rstrip()
        for name, entry in hidden["parameters"].items()
    )
    say(f"the truth: {hidden['name']} from {hidden['begins']:.1f} s on: {told}")


def table_parameters(args: Namespace) -> dict[str, object]:
    """Return the parameters of the simulated table that the arguments describe.

    Raises:
        BadInputError: an object is no number, or there is no such hidden effect.
    """
    require_effect_of_table(args.hidden)
    number = "0" if args.object in (None, "random") else str(args.object)
    number = "121" if number == "box_0" else number  # what the demo of the hand takes by default
    if not number.isdigit():
        raise BadInputError(
            f"--object {args.object}: expected a number of config/planar_objects.yaml, or random"
        )
    return {
        "scene": "table",
        "object_number": int(number),
        "vision_rate_hz": TRACKED,
        "command_timeout": ANSWERED,
        "seed": args.seed,
        "hidden_effect": args.hidden,
        "hidden_magnitude": float(args.magnitude),
        "hidden_waits": args.hidden != "none",
        "real_time_factor": float(args.real_time_factor),
    }


def nodes(table: dict[str, object], seed: int) -> dict[str, dict[str, object]]:
    """Return the nodes of the story with their parameters."""
    clock: dict[str, object] = {"use_sim_time": True}
    manners = {"manners": list(MANNERS)}
    return {
        "robot_sim": table,
        "property_estimator": clock,
        "explorer": clock | {"budget": BUDGET, "least": BUDGET, "seed": seed, **manners},
        "push_controller": clock,
        "model_check": clock | CHECKING,
    }


def looking_command(parameters: Path) -> list[str]:
    """Return the command of a shape_estimator whose poses and outlines do not reach the others.

    Those come from the markers, in the frame of the markers.
    """
    from tactile_dynamics_ros.ros.names import link_topic

    words = ["--ros-args", "--params-file", str(parameters)]
    for topic in (link_topic(f"link_{k}", kind) for k in (1, 2) for kind in ("pose", "footprint")):
        words += ["-r", f"{topic}:=look/{topic}"]
    return verb_command("run", "shape_estimator", *words)


def _look(node: Node, supervisor: Supervisor, say: Callable[[str], None]) -> dict[str, Any]:
    """Let the camera go round until the shape is known."""
    from tactile_dynamics_ros.ros.names import SHAPE_START

    say("looking: the camera goes round ...")
    success, message = _call(node, supervisor, SHAPE_START)
    supervisor.stop(["shape_estimator"])
    if not success:
        say(f"its shape is not known: {message}")
        return {"parts": []}
    seen: dict[str, Any] = json.loads(message)
    for k, part in enumerate(seen["parts"], 1):
        size = " x ".join(f"{2e3 * a:.0f}" for a in part["semi_axes_m"])
        say(f"part {k}: {size} mm")
    return seen


def _story(
    node: Node, supervisor: Supervisor, say: Callable[[str], None], changes: bool
) -> dict[str, Any]:
    """Explore, push to the goal, notice a change, reveal."""
    from tactile_dynamics_ros.cli.demo_change import Act
    from tactile_dynamics_ros.ros.names import EXPLORE, REVEAL

    log = Log(node)
    _await(node, supervisor, lambda: log.ready)
    seen = _look(node, supervisor, say)
    if log.parted:  # it knows one part only, and its fits would take time from others
        supervisor.stop(["property_estimator"])
    say("exploring: which pushes tell most? ...")
    explored = _explore(lambda: _call(node, supervisor, EXPLORE), say)
    say(f"pushing it to {GOAL[0]:g} m, {GOAL[1]:g} m, {GOAL[2]:g} deg ...")
    log.goal_from = len(log.path)
    pushed = ask(node, GOAL)
    word = "reached" if pushed["reached"] else "not reached"
    say(
        f"{word}: {1e3 * pushed['error_m']:.1f} mm, {pushed['error_rad']:.3f} rad from the goal "
        f"after {pushed['pushes']} pushes ({pushed['stopped_because']})"
    )
    end, changed = len(log.path), None
    if changes and log.parted:
        say("no last act: changes are watched for on objects of one part only")
    elif changes:
        act = Act(node, lambda name: _call(node, supervisor, name), lambda g: ask(node, g), say)
        changed = act.play()
    _, revealed = _call(node, supervisor, REVEAL)
    return {
        "changed": changed,
        "goal_to": end,
        "seen": seen,
        "explored": explored,
        "goal": list(GOAL),
        "pushed": pushed,
        "truth": json.loads(revealed),
        "path": log.path,
        "goal_from": log.goal_from,
        "history": [] if log.parted else log.history,
        "footprint": log.footprint,
    }


def _explore(call: Callable[[], tuple[bool, str]], say: Callable[[str], None]) -> dict[str, Any]:
    """Explore; what stopped for safety is called again, as somebody who watches would.

    Raises:
        TactileDynamicsError: it was stopped too often, or could not begin.
    """
    actions: list[Any] = []
    for _ in range(TRIES):
        success, message = call()
        try:
            told: dict[str, Any] = json.loads(message)
        except ValueError:
            raise TactileDynamicsError(f"exploring did not begin: {message}") from None
        actions += told["actions"]
        say(describe(told))
        if success:
            return told | {"actions": actions}
    raise TactileDynamicsError(f"exploring was stopped {TRIES} times: {told['stopped_because']}")


def _await(node: Node, supervisor: Supervisor, condition: Callable[[], bool]) -> None:
    """Wait until all is there.

    Raises:
        TactileDynamicsError: a process died, or it takes too long.
    """
    if not _spin(node, supervisor, condition, START):
        raise TactileDynamicsError(f"not all nodes are heard after {START:.0f} s")


def _call(node: Node, supervisor: Supervisor, service: str) -> tuple[bool, str]:
    """Call a service; nodes that die meanwhile are started again.

    Raises:
        TactileDynamicsError: no answer in time, or the robot or the node that answers died.
    """
    from std_srvs.srv import Trigger

    client = node.create_client(Trigger, f"/{service}")
    if not _spin(node, supervisor, client.service_is_ready, START):
        raise TactileDynamicsError(f"service {service} is not offered")
    future = client.call_async(Trigger.Request())
    if not _spin(node, supervisor, future.done, PATIENCE, service.partition("/")[0]):
        raise TactileDynamicsError(f"service {service}: no answer within {PATIENCE:.0f} s")
    answer = future.result()
    return bool(answer.success), str(answer.message)


def _spin(
    node: Node,
    supervisor: Supervisor,
    condition: Callable[[], bool],
    timeout: float,
    needed: str = "robot_sim",
) -> bool:
    """Let the node work until the condition holds; return whether it does.

    Raises:
        TactileDynamicsError: the robot died, the node that is needed, or one too often.
    """
    end = time.monotonic() + timeout
    while not spin_until(node, condition, 0.5):
        for member in supervisor.watch():
            print(f"{member.last_words()}\n{member.epitaph}", file=sys.stderr)
            if member.name in ("robot_sim", needed) or member.due is None:
                raise TactileDynamicsError(f"{member.name} ended with {member.exit_codes[-1]}")
        if time.monotonic() > end:
            return False
    return True


class Log:
    """What is seen while the story goes on.

    Args:
        node: that listens.

    Attributes:
        path: of the object, x, y, yaw, time. footprint: its outline. goal_from: index into the
            path. history: estimates by name, each with time, value and std.
        parted: whether a second part is tracked.
    """

    def __init__(self, node: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
        from geometry_msgs.msg import PolygonStamped, PoseStamped, PoseWithCovarianceStamped

        from tactile_dynamics_ros.ros import names
        from tactile_dynamics_ros.ros.shell import LATCHED, STREAM

        self.path: list[list[float]] = []
        self.footprint: list[list[float]] = []
        self.history: list[dict[str, Any]] = []
        self.goal_from = 0
        self._node, self._pusher, self.parted = node, False, False
        node.create_subscription(
            PoseWithCovarianceStamped, names.OBJECT_POSE, self._on_pose, STREAM
        )
        node.create_subscription(PoseStamped, names.PUSHER_POSE, self._on_pusher, STREAM)
        outline = names.link_topic("link_1", "footprint")
        node.create_subscription(PolygonStamped, outline, self._on_outline, LATCHED)
        second = names.link_topic("link_2", "footprint")
        node.create_subscription(PolygonStamped, second, self._on_second, LATCHED)
        node.create_subscription(
            DiagnosticArray, names.PROPERTY_STATUS, self._on_properties, LATCHED
        )
        progress = node.create_subscription(
            DiagnosticStatus, names.EXPLORE_PROGRESS, lambda _: None, LATCHED
        )
        self._progress = progress

    @property
    def ready(self) -> bool:
        """Whether robot, object and all nodes are heard."""
        wanted = {
            "shape_estimator",
            "property_estimator",
            "explorer",
            "push_controller",
            "model_check",
        }
        heard = bool(self.path) and bool(self.footprint) and self._pusher
        return heard and wanted <= set(self._node.get_node_names())

    def _on_pose(self, message: Any) -> None:
        from math import atan2

        pose, stamp = message.pose.pose, message.header.stamp
        turn = 2.0 * atan2(pose.orientation.z, pose.orientation.w)
        row = [pose.position.x, pose.position.y, turn, stamp.sec + 1e-9 * stamp.nanosec]
        self.path.append(row)

    def _on_pusher(self, _: Any) -> None:
        self._pusher = True

    def _on_outline(self, message: Any) -> None:
        self.footprint = [[p.x, p.y] for p in message.polygon.points]

    def _on_second(self, _: Any) -> None:
        self.parted = True

    def _on_properties(self, message: Any) -> None:
        stamp = message.header.stamp
        link = Statuses(message.status).values("link_1")
        if "com_x" in link:
            row = {key: to_number(text) for key, text in link.items() if key != "undetermined"}
            self.history.append({"time": stamp.sec + 1e-9 * stamp.nanosec, **row})
