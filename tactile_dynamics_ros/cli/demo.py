"""`tactile-dynamics demo`: the whole story on the simulated robot, from grasp to report."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from argparse import Namespace, _SubParsersAction
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.bringup import (
    read_configuration,
    require_hidden_effect,
    require_simulated_robot,
    require_simulator,
    require_table_object,
    write_parameters,
)
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.live import (
    DEFAULT_CONFIG,
    StopRequest,
    add_simulation_arguments,
    simulation_parameters,
)
from tactile_dynamics_ros.cli.supervisor import (
    Supervisor,
    node_command,
    start_view,
    verb_command,
)
from tactile_dynamics_ros.cli.view import require_viser
from tactile_dynamics_ros.core.errors import (
    BadInputError,
    NotIdentifiableError,
    TactileDynamicsError,
    refuse_existing,
)
from tactile_dynamics_ros.core.options import FREE_PORT, Number, folder_to_write
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT
from tactile_dynamics_ros.share import object_file, share_file

if TYPE_CHECKING:
    from tactile_dynamics_ros.cli.demo_monitor import Monitor
    from tactile_dynamics_ros.cli.demo_story import Story

AROUND_MOTION = 60.0
"""Simulated seconds of grasping, lifting and putting down around the excitation."""
PATIENCE = 30.0
"""Real seconds per simulated one after which even a slow machine must have finished."""
CHANGE, CHANGED_BY = "support_tilt", 2.0
"""What changes in the last act on a table, and by how much of its usual size: a lean of 4 deg."""
DURATION = Number(1.0, 600.0)
"""Range of the motion's length, s, as grasp_controller's parameter `excitation.duration` has it."""
STILL = 90.0
"""Real seconds without simulated time after which the simulation has failed."""
STARTING = 400.0
"""Real seconds until simulated time must have begun: 90 are too few on two cores that six other
programs use, and a slow start is no fault."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("demo")
    add_simulation_arguments(parser)
    parser.set_defaults(hidden=None, magnitude=None)
    parser.add_argument(
        "--config", default=DEFAULT_CONFIG, metavar="YAML", help="nodes, parameters: which robot"
    )
    parser.add_argument(
        "--duration",
        type=DURATION,
        metavar="S",
        help="of the motion (30; with --hidden 60; with --weigh 20)",
    )
    parser.add_argument(
        "--planar",
        action="store_true",
        help="push an object on a table instead: explore it, bring it to a goal, and notice what "
        "changes (--hidden, a table that leans by default; none for nothing)",
    )
    parser.add_argument(
        "--weigh",
        action="store_true",
        help="an arm without a hand weighs its tool and a load, and sets its controller's payload",
    )
    parser.add_argument(
        "--joints",
        action="store_true",
        help="an arm without a wrist sensor instead, by its joint torques: which effect of its "
        "joints is missing (--hidden), and what it carries",
    )
    parser.add_argument(
        "--out",
        type=folder_to_write,
        metavar="DIR",
        help="recording, report and logs; new directory",
    )
    parser.add_argument(
        "--view",
        type=FREE_PORT,
        nargs="?",
        const=8080,
        metavar="PORT",
        help="live page in the browser",
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Play the story; afterwards everything is stopped."""
    started = time.monotonic()
    if args.joints:
        return _run_joints(args)
    require_simulator()
    if args.view:
        require_viser()
    if args.weigh:
        return _run_weigh(args)
    args.hidden = args.hidden or (CHANGE if args.planar else "none")
    if args.magnitude is None:
        args.magnitude = CHANGED_BY if args.planar else 1.0
    if args.planar:
        return _run_planar(args)
    require_hidden_effect(args.hidden, "hand")
    object_file(args.object)
    require_simulated_robot(share_file(args.config))
    args.duration = args.duration or (30.0 if args.hidden == "none" else 60.0)
    out = _new_folder(args)
    say = _Speaker(quiet=args.json)
    with private_domain() as domain, StopRequest() as stop:
        from tactile_dynamics_ros.cli.demo_monitor import Monitor
        from tactile_dynamics_ros.cli.demo_story import Story

        say(f"nodes run on ROS domain {domain} of this host; look in with")
        say(f"  ROS_DOMAIN_ID={domain} tactile-dynamics echo /inertial_estimator/status")
        with Supervisor(out / "logs", respawn=False) as supervisor:
            monitor = Monitor(say, share_file(args.config))
            hides = args.hidden != "none"
            story = Story(monitor.node, say, args.duration) if hides else None
            try:
                start_processes(supervisor, args, out, say)
                _play(supervisor, monitor, stop, args, story)
                if story is not None:
                    story.close()
                truth = monitor.reveal()
            finally:
                monitor.close()
                supervisor.stop(["recorder"])
    (out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    say(f"recorded {out / 'recording'}; all processes are stopped; estimating from the recording")
    from tactile_dynamics_ros.cli.demo_result import Findings, summarise_demo

    found = None
    if story is not None:
        live = Findings(story.diagnosis, story.seconds, None)
        found = replace(live, offline=_explain(out, live.effects, say))
    result = summarise_demo(out, monitor.history(), truth, _command(args), say, found)
    if story and found:
        result |= story.document() | {"explanation": found.offline}
    result["wall_time_s"] = round(time.monotonic() - started, 1)
    if args.json:
        print(json.dumps(result))
    say(f"done in {result['wall_time_s']:.0f} s; open {result['report']}")
    return 0


def _command(args: Namespace) -> str:
    """Return the command that plays the same story again."""
    words = f"tactile-dynamics demo --object {args.object} --seed {args.seed}"
    if args.hidden != "none":
        words += f" --hidden {args.hidden} --magnitude {args.magnitude:g}"
    return f"{words} --duration {args.duration:g}"


def _new_folder(args: Namespace) -> Path:
    """Return the folder of a run, made, with nothing recorded in it yet."""
    out = Path(args.out or f"out/demo-{datetime.now():%Y%m%d-%H%M%S}").absolute()
    refuse_existing(out / "recording")
    out.mkdir(parents=True, exist_ok=True)
    return out


def _run_joints(args: Namespace) -> int:
    """Play the story of an arm without a wrist sensor."""
    from tactile_dynamics_ros.cli.demo_joints import HIDDEN, play

    size = 1.0 if args.magnitude is None else args.magnitude
    out, say = _new_folder(args), _Speaker(quiet=args.json)
    told = play(args.hidden or HIDDEN, size, args.seed, out, say)
    if args.json:
        print(json.dumps(told))
    return 0


def _run_planar(args: Namespace) -> int:
    """Play the story of an object on a table; 0 if it came to its end."""
    from tactile_dynamics_ros.cli.demo_planar import play, table_parameters

    require_table_object(int(str(table_parameters(args)["object_number"])))
    outcome = play(args, _new_folder(args), _Speaker(quiet=args.json))
    if args.json:
        hidden = ("parts", "history", "goal_from", "goal_to")
        print(json.dumps({key: value for key, value in outcome.items() if key not in hidden}))
    return 0


def _run_weigh(args: Namespace) -> int:
    """Play the story of an arm that weighs what it carries.

    Raises:
        BadInputError: something else is asked for as well.
    """
    if args.planar or args.hidden:
        raise BadInputError("demo --weigh: goes without --planar and --hidden")
    from tactile_dynamics_ros.cli.demo_weigh import play

    outcome = play(args, _new_folder(args), _Speaker(quiet=args.json))
    if args.json:
        print(json.dumps(outcome))
    return 0


def _explain(
    out: Path, effects: Sequence[str], say: Callable[[str], None]
) -> dict[str, Any] | None:
    """Explain the recording with effects as a user would; the page goes to OUT/explain."""
    say("explaining the whole recording: which effects are missing? ...")
    words = ["explain", str(out / "recording"), "--out", str(out / "explain"), "--json"]
    words += ["--effects", ",".join(effects)] if effects else []
    done = subprocess.run(verb_command(*words), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        say(f"no explanation: {last_line(done.stderr)}")
        return None
    from tactile_dynamics_ros.cli.demo_result import doubts

    document: dict[str, Any] = json.loads(done.stdout)
    for step in document["steps"]:
        say(f"  {step['added'] or 'rigid body alone'}: error {step['error']:.2f}")
    say(document["sentence"])
    for sentence in doubts(document):
        say(sentence)
    say(f"see {out / 'explain' / 'report.html'}")
    return document


def last_line(text: str) -> str:
    """Return the last line of what a process wrote, which says why it ended."""
    lines = text.strip().splitlines()
    return lines[-1] if lines else "it ended without a word"


class _Speaker:
    """Prints lines for people, or nothing."""

    def __init__(self, quiet: bool) -> None:
        self.quiet = quiet

    def __call__(self, text: str) -> None:
        if not self.quiet:
            print(text, flush=True)


def _design_motion(args: Namespace, out: Path, say: Callable[[str], None]) -> Path | None:
    """Design the motion for the object's grasp site as a user would; None means sums of sines."""
    path = out / "motion.json"
    nodes = read_configuration(share_file(args.config))
    robot = nodes["robot_sim"].get("robot", DEFAULT_ROBOT)
    words = [
        "excite",
        "--robot",
        robot,
        "--object",
        args.object,
        "--duration",
        f"{args.duration:g}",
    ]
    words += ["--seed", str(args.seed), "--out", str(path), "--json"]
    done = subprocess.run(verb_command(*words), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        say(f"no designed motion, sums of sines instead: {last_line(done.stderr)}")
        return None
    plan: dict[str, Any] = json.loads(done.stdout)
    say(
        f"designed {args.duration:g} s of motion for the grasp: {plan['grip_usage']:.0%} of the "
        f"friction cones, expected distance to the truth {plan['expected_distance']['after']:.2f}"
    )
    return path


def start_processes(
    supervisor: Supervisor, args: Namespace, out: Path, say: Callable[[str], None]
) -> None:
    """Design the motion and start recorder and nodes.

    Args:
        supervisor: that starts them.
        args: of the verb: object, configuration, duration of the motion (s) and so on.
        out: folder of recording and motion.
        say: prints a line for people.
    """
    files = write_parameters(share_file(args.config), out / "parameters")
    motion = _design_motion(args, out, say)
    extra: dict[str, dict[str, object]] = {
        "robot_sim": simulation_parameters(args),
        "vision_tracker": {"object": args.object},
        "friction_probe": {"object": args.object},
        "model_check": {"laws": str(out / "laws")},
        "grasp_controller": {
            "object": args.object,
            "excitation.duration": float(args.duration),
            "excitation.seed": args.seed,
        },
    }
    if motion is not None:
        extra["grasp_controller"]["motion"] = motion
    supervisor.start("recorder", verb_command("record", str(out / "recording")))
    start_view(supervisor, getattr(args, "view", None), say)
    for name, file in files.items():
        supervisor.start(name, node_command(name, file, extra.get(name)))


def _play(
    supervisor: Supervisor,
    monitor: Monitor,
    stop: StopRequest,
    args: Namespace,
    story: Story | None,
) -> None:
    """Wait until the object has been put down, showing what comes.

    Raises:
        TactileDynamicsError: a process died, or the story does not end.
        NotIdentifiableError: the hand did not get or keep the object.
    """
    limit = PATIENCE * (AROUND_MOTION + args.duration) / min(args.real_time_factor, 1.0)
    started = time.monotonic()
    while not monitor.finished or (story is not None and story.waiting):
        monitor.spin_once()
        if story is not None:
            story.advance(monitor.seconds_of_data, held=not monitor.finished)
        if stop.requested:
            raise KeyboardInterrupt
        for member in supervisor.watch():
            print(member.last_words(), file=sys.stderr)
            raise TactileDynamicsError(f"{member.name} ended with {member.exit_codes[-1]}")
        _require_progress(monitor, time.monotonic() - started, limit)
    if monitor.failure:
        raise NotIdentifiableError(f"the hand has no object to estimate: {monitor.failure}")


def _require_progress(monitor: Monitor, waited: float, limit: float) -> None:
    """Check that simulated time goes on, and that the story may still end in time.

    Args:
        monitor: that hears the simulation.
        waited: real time since the nodes were started, s.
        limit: of `waited`, s.

    Raises:
        TactileDynamicsError: it does not.
    """
    still = monitor.standing_still
    if still is None and waited > STARTING:
        raise TactileDynamicsError(f"no simulated time within {waited:.0f} s; see the logs")
    if still is not None and still > STILL:
        raise TactileDynamicsError(f"the simulation stands still for {still:.0f} s; see the logs")
    if waited > limit:
        reason = f" ({monitor.not_started})" if monitor.not_started else ""
        raise TactileDynamicsError(f"not finished after {limit:.0f} s{reason}; see the logs")
