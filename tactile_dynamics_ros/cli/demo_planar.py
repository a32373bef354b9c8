"""`tactile-dynamics demo --planar`: look at an object, explore it, push it, notice a change."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import require_hidden_effect, write_parameters
from tactile_dynamics_ros.cli.demo_monitor import Log
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.explore import describe, why_unknown
from tactile_dynamics_ros.cli.push_goal import ask
from tactile_dynamics_ros.cli.supervisor import (
    Supervisor,
    node_command,
    start_view,
    verb_command,
)
from tactile_dynamics_ros.cli.topics import short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.core.planar.actions.candidate import MANNERS
from tactile_dynamics_ros.ros.names import EXPLORE, REVEAL, SHAPE_START
from tactile_dynamics_ros.share import share_file

if TYPE_CHECKING:
    from rclpy.node import Node

CONFIG = "config/planar_pusher.yaml"
"""Nodes and camera of the table; which of them the story starts, `nodes` says."""
GOAL = (0.5, 0.1, 0.0)
"""m, m, deg: where the object is pushed, the goal of Dutta et al."""
BUDGET = 5
"""Pushes and pulls that explore, known or not: with a fit after each the story ends within five
minutes, and changes are identified by a reference that they make: one of three pushes is replaced
by the next fits, which may already contain a change."""
TRIES = 3
"""Calls of the explorer, each after one that was stopped for safety: a third says that it is not
chance."""
TWO_PARTS = (
    "two parts: they are pushed in turn and never gripped, since a grip would hold them together; "
    "what each of them weighs is known only if they move against each other, and changes are "
    "watched for on objects of one part alone"
)
"""What is different with an object of two parts, in words for people."""
LATE = (
    "this machine cannot keep up: {} times the next target of the arm was waited for in vain, so "
    "that pushes were not as planned and the result may be another one; run it with less beside it"
)
"""What is said where a controller was too late even for a simulation that waits."""
START = 120.0
"""Real seconds within which all nodes must be heard: the slowest machines import for a minute."""
FITTED = 240.0
"""Real seconds for the estimate of a push: fits take 15 of an idle core at most, and a machine with
eight busy programs beside them ten times as long. Without it the next push is chosen by less."""
CHECKING: dict[str, object] = {"model": "pushed", "period": 600.0, "diagnosis_window": 60.0}
"""model_check diagnoses on request; comparisons meanwhile would take time from the fits."""
PATIENCE = 1800.0
"""Real seconds for exploring, on a machine that does ten other things too: the explorer waits after
each push (`FITTED`), and ends by itself; with less the story would go on while it pushes."""
ANSWERED = 10.0
"""Real seconds that the simulation waits for the next target of a pushing arm before it goes on
without: plans of the controller take some of them on a machine that does ten other things."""
ANSWER = 30.0
"""Real seconds for the answer of a node that only has to look it up."""
HEARD = 30.0
"""Real seconds within which a node has to hear what is published: DDS took up to ten while all
nodes started and Python compiled them."""
TRACKED = 30.0
"""Hz of the tracker of markers, as depth cameras give images."""


def play(args: Namespace, out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Play the story; afterwards everything is stopped. Return what is reported as JSON.

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
        start_view(supervisor, args.view, say)
        files = write_parameters(share_file(CONFIG), out / "parameters")
        for name, parameters in nodes(table, args.seed).items():
            supervisor.start(name, node_command(name, files.get(name), parameters))
        supervisor.start("shape_estimator", looking_command(files["shape_estimator"]))
        with short_lived_node() as node:
            story = _story(node, supervisor, say, args.hidden != "none")
        supervisor.stop(["recorder"])
    say(f"recorded {out / 'recording'}; all processes are stopped")
    report(story, out, say)
    story["wall_time_s"] = round(time.monotonic() - started, 1)
    say(f"done in {story['wall_time_s']:.0f} s; open {story['report']}")
    if story["broken"]:
        raise TactileDynamicsError(f"{story['broken']}; what was found until then is in the report")
    return story


def report(story: dict[str, Any], out: Path, say: Callable[[str], None]) -> None:
    """Say what was found beside the truth, where that is known, and write the page.

    Args:
        story: the story; gets the comparison and the place of the page.
        out: folder of the page.
        say: prints a line for people.
    """
    from tactile_dynamics_ros.report.exploration import compare_properties, write_exploration

    story["compared"], story["why_unknown"] = [], why_unknown(story["explored"]["properties"])
    if story["truth"] is not None:
        (out / "truth.json").write_text(json.dumps(story["truth"], indent=1) + "\n")
        _reveal(story["truth"], say)
        story["compared"] = compare_properties(story["explored"]["properties"], story["truth"])
    for row in story["compared"]:
        name = f"{row['part']} {row['name']}".strip()
        say(f"  {name}: {row['value']:.4g} ± {row['std']:.2g}, truth {row['truth']:.4g}")
    story["report"] = str(write_exploration(story, out))


def _reveal(truth: dict[str, Any], say: Callable[[str], None]) -> None:
    """Say what was hidden, and whether the machine kept up."""
    if truth.get("late_commands"):
        say(LATE.format(truth["late_commands"]))
    hidden = truth["hidden_effect"]
    if hidden["begins"] is None:
        return
    story = ", ".join(
        f"{name} {entry['value']} {entry['unit']}".rstrip()
        for name, entry in hidden["parameters"].items()
    )
    say(f"the truth: {hidden['name']} from {hidden['begins']:.1f} s on: {story}")


def table_parameters(args: Namespace) -> dict[str, object]:
    """Return the parameters of the simulated table that the arguments describe.

    Raises:
        BadInputError: an object is no number, or there is no such hidden effect.
    """
    require_hidden_effect(args.hidden, "table")
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
    how = {"manners": list(MANNERS), "patience": FITTED}
    return {
        "robot_sim": table,
        "property_estimator": clock,
        "explorer": clock | {"budget": BUDGET, "least": BUDGET, "seed": seed, **how},
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


class BrokenError(TactileDynamicsError):
    """The story cannot go on: a node ended, or gives no answer while it may still be moving."""


def _story(
    node: Node, supervisor: Supervisor, say: Callable[[str], None], changes: bool
) -> dict[str, Any]:
    """Explore, push to the goal, notice a change, reveal; what is stopped is reported as well."""
    log = Log(node)
    _await(node, supervisor, lambda: log.ready)
    story: dict[str, Any] = {
        "seen": {"parts": []},
        "explored": {"actions": [], "properties": {"links": [], "undetermined": []}},
        "goal": list(GOAL),
        "pushed": None,
        "changed": None,
        "stopped": [],
        "broken": "",
        "goal_from": None,
        "goal_to": None,
        "truth": None,
    }
    try:
        _play_acts(story, log, node, supervisor, say, changes)
    except BrokenError as error:
        story["broken"] = str(error)
        say(f"the story ends here: {error}")
    try:
        story["truth"] = json.loads(_call(node, supervisor, REVEAL, ANSWER)[1])
    except (TactileDynamicsError, ValueError) as error:
        say(f"the truth is not revealed: {error}")
    return story | log.document()


def _play_acts(
    story: dict[str, Any],
    log: Log,
    node: Node,
    supervisor: Supervisor,
    say: Callable[[str], None],
    changes: bool,
) -> None:
    """Play act after act; one that is stopped is noted, and the next begins.

    Raises:
        BrokenError: nothing more can be played.
    """
    from tactile_dynamics_ros.cli.demo_change import Act

    def call(name: str) -> tuple[bool, str]:
        return _call(node, supervisor, name)

    def attempt(name: str, act: Callable[[], Any]) -> None:
        try:
            story[name] = act()
        except BrokenError:
            raise
        except TactileDynamicsError as error:
            story["stopped"].append(str(error))
            say(f"stopped: {error}")

    attempt("seen", lambda: _look(node, supervisor, say))
    if log.parted:
        say(TWO_PARTS)
        supervisor.stop(["property_estimator"])  # it knows one part only, and takes time from fits
    say("exploring: which pushes determine most? ...")
    attempt("explored", lambda: _explore(lambda: call(EXPLORE), say))
    story["goal_from"] = log.now
    say(f"pushing it to {GOAL[0]:g} m, {GOAL[1]:g} m, {GOAL[2]:g} deg ...")
    attempt("pushed", lambda: _push(node, say))
    story["goal_to"] = log.now
    if changes and log.parted:
        say("no last act: changes are watched for on objects of one part only")
    elif changes:
        attempt("changed", lambda: Act(node, call, lambda goal: ask(node, goal), say).play())


def _push(node: Node, say: Callable[[str], None]) -> dict[str, Any]:
    """Push the object to the goal, and say how near it came."""
    pushed = ask(node, GOAL)
    word = "reached" if pushed["reached"] else "not reached"
    say(
        f"{word}: {1e3 * pushed['error_m']:.1f} mm, {pushed['error_rad']:.3f} rad from the goal "
        f"after {pushed['pushes']} pushes ({pushed['stopped_because']})"
    )
    return pushed


def _explore(call: Callable[[], tuple[bool, str]], say: Callable[[str], None]) -> dict[str, Any]:
    """Explore; what stopped for safety is called again, as somebody who watches would.

    After too much force the explorer itself has tried again, and more gently: then nobody does.

    Raises:
        TactileDynamicsError: it could not begin.
    """
    actions: list[Any] = []
    for _ in range(TRIES):
        success, message = call()
        try:
            story: dict[str, Any] = json.loads(message)
        except ValueError:
            if actions:
                break
            raise TactileDynamicsError(f"exploring did not begin: {message}") from None
        actions += story["actions"]
        say(describe(story))
        if success or sum("stopped" in action for action in story["actions"]) > 1:
            break
    return story | {"actions": actions}


def _await(node: Node, supervisor: Supervisor, condition: Callable[[], bool]) -> None:
    """Wait until all is there.

    Raises:
        TactileDynamicsError: a process died, or it takes too long.
    """
    if not _spin(node, supervisor, condition, START):
        raise TactileDynamicsError(f"not all nodes are heard after {START:.0f} s")


def _call(
    node: Node, supervisor: Supervisor, service: str, patience: float = PATIENCE
) -> tuple[bool, str]:
    """Call a service; nodes that die meanwhile are started again.

    A node that refuses since it has not heard something yet is asked again for a while: it may run
    before DDS has told it of all publishers.

    Raises:
        TactileDynamicsError: nobody offers it.
        BrokenError: no answer in time, or the robot or the node that answers died.
    """
    from std_srvs.srv import Trigger

    client = node.create_client(Trigger, f"/{service}")
    if not _spin(node, supervisor, client.service_is_ready, START):
        raise TactileDynamicsError(f"service {service} is not offered")
    until = time.monotonic() + HEARD
    while True:
        future = client.call_async(Trigger.Request())
        if not _spin(node, supervisor, future.done, patience, service.partition("/")[0]):
            raise BrokenError(f"service {service}: no answer within {patience:.0f} s")
        answer = future.result()
        if answer.success or " yet:" not in answer.message or time.monotonic() > until:
            return bool(answer.success), str(answer.message)
        _spin(node, supervisor, lambda: False, 1.0)


def _spin(
    node: Node,
    supervisor: Supervisor,
    condition: Callable[[], bool],
    timeout: float,
    needed: str = "robot_sim",
) -> bool:
    """Let the node work until the condition holds; return whether it does.

    Raises:
        BrokenError: the robot died, the node that is needed, or one too often.
    """
    end = time.monotonic() + timeout
    while not spin_until(node, condition, 0.5):
        for member in supervisor.watch():
            print(f"{member.last_words()}\n{member.epitaph}", file=sys.stderr)
            if member.name in ("robot_sim", needed) or member.due is None:
                raise BrokenError(f"{member.name} ended with {member.exit_codes[-1]}")
        if time.monotonic() > end:
            return False
    return True
