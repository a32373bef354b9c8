"""`tactile-dynamics demo --weigh`: an arm without a hand weighs its tool and a load."""

from __future__ import annotations

import json
import subprocess
import time
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.api.result import align_rows
from tactile_dynamics_ros.cli import weigh
from tactile_dynamics_ros.cli.domain import private_domain
from tactile_dynamics_ros.cli.supervisor import (
    Supervisor,
    node_command,
    start_view,
    verb_command,
)
from tactile_dynamics_ros.cli.topics import call_trigger, short_lived_node, spin_until
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError
from tactile_dynamics_ros.ros.names import ATTACH, REVEAL, WEIGH

if TYPE_CHECKING:
    from rclpy.node import Node

START = 120.0
"""Real seconds within which all nodes must be heard: the slowest machines import for a minute."""
SETTLED = 1.5
"""Real seconds until an arm that sags has come to rest: ten time constants of its controller."""
ANSWER = 10.0
"""Real seconds for the simulator's answers, which it only has to look up."""
MOTION = 20.0
"""Length of a motion, s, as of the node: mass to 0.1 %, moments of inertia to 3 %."""
MOST = 6.0
"""Payload that the simulated arm may carry, kg; tool and load of the demo weigh 3 at most."""


@dataclass
class _Sag:
    """How far the flange hangs below where the controller wants it, m.

    Attributes:
        tool: with the tool, of which the controller does not know.
        load: with tool and load, unknown. known: when it knows both.
    """

    tool: float = np.nan
    load: float = np.nan
    known: float = np.nan


class _Gripper:
    """Attaches the load when the arm waits for it, and has the sag measured meanwhile.

    Args:
        node: to talk with.
        sag: to be filled in.
        say: prints a line for people.
    """

    def __init__(self, node: Node, sag: _Sag, say: Callable[[str], None]) -> None:
        from std_srvs.srv import Trigger

        self._node, self._sag, self._say, self._kind = node, sag, say, Trigger
        self._take, self._look = (node.create_client(Trigger, name) for name in (ATTACH, REVEAL))

    def attach(self, phase: str, go_on: Callable[[], None]) -> None:
        """Attach the load, look when the arm has come to rest, and let it go on."""
        self._say("the gripper takes the load")
        self._take.call_async(self._kind.Request())

        def look() -> None:
            timer.cancel()
            asked = self._look.call_async(self._kind.Request())
            asked.add_done_callback(note)

        def note(done: Any) -> None:
            self._sag.load = json.loads(done.result().message)["sag_m"]
            go_on()

        timer = self._node.create_timer(SETTLED, look)


def play(args: Namespace, out: Path, say: Callable[[str], None]) -> dict[str, Any]:
    """Play the story; afterwards everything is stopped. Return what is reported as JSON.

    Args:
        args: of the verb.
        out: folder of recordings, numbers and report.
        say: prints a line for people.

    Raises:
        BadInputError: the actions are not installed.
        TactileDynamicsError: a process died, or the arm was stopped.
    """
    from tactile_dynamics_ros.ros.actions import interface

    if interface("action.Weigh") is None:
        raise BadInputError(
            "demo --weigh needs the actions of tactile_dynamics_msgs, which a C++ compiler builds: "
            "python -m tactile_dynamics_ros.ros.interface_build"
        )
    started = time.monotonic()
    with private_domain() as domain, Supervisor(out / "logs", respawn=False) as supervisor:
        say(f"nodes run on ROS domain {domain} of this host; look in with")
        say(f"  ROS_DOMAIN_ID={domain} tactile-dynamics echo /weigher/progress")
        supervisor.start("robot_sim", node_command("robot_sim", None, _simulated(args)))
        supervisor.start("weigher", node_command("weigher", None, _weigher(args, out)))
        start_view(supervisor, getattr(args, "view", None), say)
        with short_lived_node() as node:
            found, truth, sag = _weigh(node, args, say)
    _report(found, truth, sag, say)
    (out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    report = _page(Path(found["folder"]) / "load_1.mcap", out)
    outcome = {
        "truth": truth,
        "weighed": {name: found[name] for name in ("tool", "load")},
        "doubts": found["doubts"],
        "handed_over": found["handed_over"],
        "sag_m": {"tool": sag.tool, "load": sag.load, "known": sag.known},
        "wall_time_s": round(time.monotonic() - started, 1),
        "report": str(report),
    }
    say(f"done in {outcome['wall_time_s']:.0f} s; open {report}")
    return outcome


def _simulated(args: Namespace) -> dict[str, object]:
    return {
        "scene": "arm",
        "seed": args.seed,
        "real_time_factor": float(args.real_time_factor),
    }


def _weigher(args: Namespace, out: Path) -> dict[str, object]:
    return {
        "motion.duration": float(args.duration or MOTION),
        "motion.seed": args.seed,
        "controller": "other",
        "maximum_mass": MOST,
        "folder": out / "weighed",
        "use_sim_time": True,
    }


def _weigh(
    node: Node, args: Namespace, say: Callable[[str], None]
) -> tuple[dict[str, Any], dict[str, Any], _Sag]:
    """Let the arm weigh; return its findings, the truth, and how far the arm sags."""
    sag = _Sag(tool=_truth(node)["sag_m"])
    weigh.on_change(node, "", _Gripper(node, sag, say).attach)
    span = args.duration or MOTION
    say(f"the arm weighs its tool, then the load: {span:g} s of motion each")
    wanted = Namespace(
        apply=True,
        dry_run=False,
        tool="measure",
        speed_share=None,
        timeout=600.0 / min(args.real_time_factor, 1.0),
        json=args.json,
    )
    found = weigh.ask(node, wanted)
    end = time.monotonic() + SETTLED
    spin_until(node, lambda: time.monotonic() > end, 2.0 * SETTLED)
    truth = _truth(node)
    sag.known = truth["sag_m"]
    return found, truth, sag


def _truth(node: Node) -> dict[str, Any]:
    """Return the simulator's truth, once all nodes are there."""
    from rclpy.action import get_action_names_and_types

    name = f"/{WEIGH}"
    if not spin_until(node, lambda: name in dict(get_action_names_and_types(node)), START):
        raise TactileDynamicsError(f"action {name} not heard within {START:g} s; see the logs")
    success, message = call_trigger(node, REVEAL, ANSWER)
    if not success:
        raise TactileDynamicsError(message)
    truth: dict[str, Any] = json.loads(message)
    return truth


def _report(
    found: dict[str, Any], truth: dict[str, Any], sag: _Sag, say: Callable[[str], None]
) -> None:
    """Say what was weighed beside the truth, and what the controller makes of it."""
    say(weigh.describe(found))
    rows = [("", "estimate", "truth", "off by, standard deviations")]
    for name in ("tool", "load"):
        rows += list(_compared(name, found[name], truth[name]))
    say(align_rows(rows))
    say(
        f"the flange sags by {1e3 * sag.tool:.1f} mm under the tool and {1e3 * sag.load:.1f} mm "
        f"under both while the controller knows of neither; with the payload handed over: "
        f"{1e3 * sag.known:.2f} mm"
    )


def _compared(name: str, body: dict[str, Any], truth: dict[str, Any]) -> Any:
    """Yield a row for the mass, the centre and the moments of inertia."""
    mass = body["mass"]
    off = (mass["value"] - truth["mass"]) / mass["std"]
    yield f"{name} mass, kg", f"{mass['value']:.4f}", f"{truth['mass']:.4f}", f"{off:+.1f}"
    com = body["com"]
    for k, axis in enumerate("xyz"):
        off = (com["value"][k] - truth["com"][k]) / com["std"][k]
        yield (
            f"{name} com_{axis}, mm",
            f"{1e3 * com['value'][k]:.2f}",
            f"{1e3 * truth['com'][k]:.2f}",
            f"{off:+.1f}",
        )
    inertia = body["inertia_com"]
    for k, axis in enumerate("xyz"):
        value, std = inertia["value"][k][k], inertia["std"][k][k]
        real = truth["inertia_com"][k][k]
        off = (value - real) / std
        yield (
            f"{name} I_{axis}{axis}, kg mm²",
            f"{1e6 * value:.0f}",
            f"{1e6 * real:.0f}",
            f"{off:+.1f}",
        )


def _page(recording: Path, out: Path) -> Path:
    """Write the report of tool and load together; return its path."""
    words = verb_command("estimate", str(recording), "--out", str(out / "report"))
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise TactileDynamicsError(f"no report: {done.stderr.strip().splitlines()[-1]}")
    return out / "report" / "report.html"
