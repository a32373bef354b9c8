"""Verbs that start nodes: run, sim, up."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import Any, NoReturn

from tactile_dynamics_ros.cli.bringup import (
    node_names,
    read_names,
    read_namespace,
    read_switch,
    require_hidden_effect,
    require_simulator,
    write_parameters,
)
from tactile_dynamics_ros.cli.domain import stay_on_this_host
from tactile_dynamics_ros.cli.supervisor import Supervisor, node_command
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError, nearest
from tactile_dynamics_ros.core.options import SEED, Number, folder_to_write
from tactile_dynamics_ros.ros.executable import start
from tactile_dynamics_ros.share import share_file
from tactile_dynamics_ros.stopping import StopRequest

DEFAULT_CONFIG = "config/allegro_iiwa.yaml"
DEFAULT_OBJECT, DEFAULT_NUMBER = "box_0", 121
MAGNITUDE, PACE = Number(0.0, 100.0), Number(0.05, 20.0)
"""Ranges of robot_sim's parameters `hidden_magnitude` and `real_time_factor`, so that a command
refuses at once what the node would refuse after it has started (a test compares them)."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verbs."""
    run = verbs.add_parser("run")
    run.add_argument("node", metavar="NODE", help=f"one of {', '.join(node_names())}")
    run.add_argument("arguments", nargs=argparse.REMAINDER, help="--ros-args ...")
    run.set_defaults(run=run_node)

    sim = verbs.add_parser("sim")
    sim.add_argument(
        "--scene",
        default="hand",
        metavar="hand|table",
        help="hand: an object is held; table: an arm pushes (--object is then a number)",
    )
    add_simulation_arguments(sim)
    sim.set_defaults(run=run_simulation, object=None)

    up = verbs.add_parser("up")
    up.add_argument("--config", default=DEFAULT_CONFIG, metavar="YAML", help="nodes, parameters")
    up.add_argument(
        "--simulate",
        nargs="?",
        const="true",
        default="false",
        metavar="true|false",
        help="with the simulated robot, and what CONFIG.simulated.yaml adds (a real one)",
    )
    up.add_argument("--without", default="", metavar="A,B", help="nodes that are not started")
    up.add_argument("--namespace", default="", metavar="NS", help="of all nodes: one per hand")
    up.add_argument(
        "--logs",
        type=folder_to_write,
        metavar="DIR",
        help="one log per node instead of the terminal",
    )
    up.set_defaults(run=run_all)


def add_simulation_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what describes a simulated run."""
    parser.add_argument("--object", default="box_0", metavar="NAME", help="file in config/objects")
    parser.add_argument("--seed", type=SEED, default=0, help="of placement, noise and effect")
    parser.add_argument("--hidden", default="none", metavar="NAME|random", help="hidden effect")
    parser.add_argument(
        "--magnitude",
        type=MAGNITUDE,
        default=1.0,
        help="of the hidden effect, times its usual size",
    )
    parser.add_argument(
        "--real-time-factor", type=PACE, default=1.0, help="simulated over real time"
    )


def simulation_parameters(args: Namespace) -> dict[str, object]:
    """Return the parameters of robot_sim that the arguments describe."""
    return {
        **_object_parameters(args),
        "seed": args.seed,
        "hidden_effect": args.hidden,
        "hidden_magnitude": float(args.magnitude),
        "real_time_factor": float(args.real_time_factor),
    }


def _object_parameters(args: Namespace) -> dict[str, object]:
    """Return which scene, and which object stands in it.

    Raises:
        BadInputError: there is no such scene, or an object of the table is not a number.
    """
    scene = getattr(args, "scene", "hand")
    if scene == "hand":
        return {"world.object_name": args.object or DEFAULT_OBJECT}
    if scene != "table":
        raise BadInputError(f"--scene {scene}: expected hand or table")
    number = args.object or DEFAULT_NUMBER
    if not str(number).isdigit():
        raise BadInputError(
            f"--object {number}: expected a number of config/planar_objects.yaml on the table"
        )
    return {"scene": scene, "object_number": int(number), "vision_rate_hz": 100.0}


def run_node(args: Namespace) -> NoReturn:
    """Run one node in this process, which ends with it."""
    if args.node not in node_names():
        known = node_names()
        raise BadInputError(
            f"node '{args.node}': expected one of {', '.join(known)}{nearest(args.node, known)}"
        )
    stay_on_this_host()
    sys.argv = [args.node, *args.arguments]
    start(args.node)


def run_simulation(args: Namespace) -> NoReturn:
    """Run robot_sim with the given object, seed and hidden effect."""
    require_simulator()
    require_hidden_effect(args.hidden, args.scene)
    words = node_command("robot_sim", None, simulation_parameters(args))
    ros_arguments = words[words.index("--ros-args") :]
    run_node(Namespace(node="robot_sim", arguments=ros_arguments))


def run_all(args: Namespace) -> int:
    """Start the nodes of a configuration; start again what dies; Ctrl-C stops all."""
    stay_on_this_host()
    simulate, namespace = read_switch("--simulate", args.simulate), read_namespace(args.namespace)
    without = read_names(args.without)
    with (
        StopRequest() as stop,
        tempfile.TemporaryDirectory() as scratch,
        Supervisor(Path(args.logs) if args.logs else None) as supervisor,
    ):
        files = write_parameters(share_file(args.config), Path(scratch), simulate, without)
        if "robot_sim" in files:
            require_simulator()
        for name, file in files.items():
            supervisor.start(name, node_command(name, file, namespace=namespace))
        print(json.dumps({"nodes": list(files)}) if args.json else f"started {', '.join(files)}")
        sys.stdout.flush()
        while not stop.requested and not supervisor.abandoned:
            for member in supervisor.watch():
                print(member.epitaph, file=sys.stderr)
            time.sleep(0.1)
        if not stop.requested:
            raise TactileDynamicsError("no node is left")
    return 0
