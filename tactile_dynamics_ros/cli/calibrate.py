"""`tactile-dynamics calibrate`: what is particular to the fingertips of one hand.

The drift of their electrodes with temperature comes from a recording of free fingertips that warm
up, the gain of each from presses against a known force, recorded with `gains` at one: what is
fitted replaces them.
"""

from __future__ import annotations

import json
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.cli.recordings import add_namespace
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.robot.robot_file import DEFAULT_ROBOT, load_robot

if TYPE_CHECKING:
    from tactile_dynamics_ros.recording.cdr import MessageTable

GAP_NS = 50_000_000
"""Largest pause of the reference over which it is interpolated."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("calibrate")
    parser.add_argument("bag", metavar="BAG", help="rosbag2 directory, .mcap or .db3 file")
    parser.add_argument(
        "--drift",
        action="store_true",
        help="drift of all electrodes with temperature: /biotac/raw for ten minutes from switching "
        "on, nothing touched",
    )
    parser.add_argument("--finger", help="gain: of which finger")
    parser.add_argument(
        "--robot",
        metavar="NAME",
        default=DEFAULT_ROBOT,
        help=f"file in config/robots, or path of a yaml file ({DEFAULT_ROBOT})",
    )
    parser.add_argument(
        "--reference",
        metavar="TOPIC",
        help="gain: WrenchStamped of the known force, on the object, in the frame of the finger's "
        "sensor",
    )
    add_namespace(parser, default="")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Fit the gain or the drift and print it."""
    if args.drift:
        return _print_drift(args)
    if args.finger is None or args.reference is None:
        raise BadInputError("calibrate: expected --finger with --reference TOPIC, or --drift")
    return _print_gain(args)


def _print_drift(args: Namespace) -> int:
    from tactile_dynamics_ros.core.tactile.calibration import fit_thermal_drift
    from tactile_dynamics_ros.recording.probe_slips import read_fingertip_frames

    frames = read_fingertip_frames(Path(args.bag), args.namespace)
    fingers = load_robot(args.robot).fingers
    if frames.shape[1] != len(fingers):
        raise BadInputError(
            f"{args.bag}: images of {frames.shape[1]} fingertips, expected {len(fingers)} "
            f"({', '.join(fingers)} of robot '{args.robot}')"
        )
    drifts = {finger: fit_thermal_drift(frames[:, k]) for k, finger in enumerate(fingers)}
    if args.json:
        result = {
            finger: {
                "drift": drift.slope.tolist(),
                "std": drift.std.tolist(),
                "kelvin": drift.span,
                "samples": drift.frames,
            }
            for finger, drift in drifts.items()
        }
        print(json.dumps(result))
        return 0
    for finger, drift in drifts.items():
        print(
            f"{finger}: counts per kelvin of E1 to E19, ± {drift.std.mean():.2f} "
            f"({drift.span:.1f} K, {drift.frames} frames)"
        )
        print("  " + ", ".join(f"{value:.2f}" for value in drift.slope))
    print("the rows one after the other are biotac_force's parameter `drift`")
    return 0


def _print_gain(args: Namespace) -> int:
    from tactile_dynamics_ros.core.tactile.analytic_force import fit_unit_gain
    from tactile_dynamics_ros.recording.bag_files import read_tables
    from tactile_dynamics_ros.recording.namespaces import absolute_namespace

    robot = load_robot(args.robot)
    place = robot.finger_index(args.finger) + 1
    topic = f"{absolute_namespace(args.namespace)}/biotac/{args.finger}/force"
    bag = read_tables(Path(args.bag), lambda name: name in (topic, args.reference))
    tables = [_table(bag.tables, args.bag, name) for name in (topic, args.reference)]
    frames = [
        _frame(table, name) for table, name in zip(tables, (topic, args.reference), strict=True)
    ]
    if frames[0] != frames[1]:
        raise BadInputError(
            f"{args.reference}: frame '{frames[1]}', expected '{frames[0]}' as on {topic}; "
            "turn the reference into the sensor's frame"
        )
    gain = fit_unit_gain(*_match(*tables))
    result = {
        "finger": args.finger,
        "gain": gain.scale,
        "std": gain.std,
        "matrix": gain.matrix.tolist(),
        "matrix_std": gain.matrix_std.tolist(),
        "samples": gain.samples,
    }
    if args.json:
        print(json.dumps(result))
        return 0
    print(f"gain of {args.finger}: {gain.scale:.3f} ± {gain.std:.3f} ({gain.samples} frames)")
    print("its matrix, which turns the force too:")
    print("\n".join("  ".join(f"{value:8.4f}" for value in row) for row in gain.matrix))
    print(
        f"number {place} of biotac_force's parameter `gains` ({', '.join(robot.fingers)}) is this "
        "gain, or nine numbers for each finger, the matrices by rows"
    )
    return 0


def _table(tables: dict[str, MessageTable], bag: str, topic: str) -> MessageTable:
    table = tables.get(topic)
    if table is None or not len(table):
        raise BadInputError(
            f"{bag}: no WrenchStamped messages on {topic}; record it with the presses"
        )
    return table


def _frame(table: MessageTable, topic: str) -> str:
    frames = np.unique(table.frame_id)
    if len(frames) != 1:
        raise BadInputError(f"{topic}: {len(frames)} different frames, expected one")
    return bytes(frames[0]).rstrip(b"\0").decode()


def _match(estimated: MessageTable, reference: MessageTable) -> tuple[Any, Any]:
    """Return estimated and known forces (N, 3) at the times of the estimates."""
    order = np.argsort(reference.stamp_ns, kind="stable")
    stamps, known = reference.stamp_ns[order], reference.values[order, :3]
    after = np.clip(np.searchsorted(stamps, estimated.stamp_ns), 1, max(len(stamps) - 1, 1))
    inside = (estimated.stamp_ns >= stamps[0]) & (estimated.stamp_ns <= stamps[-1])
    inside &= stamps[np.minimum(after, len(stamps) - 1)] - stamps[after - 1] <= GAP_NS
    base = stamps[0]
    when = (estimated.stamp_ns - base)[inside].astype(float)
    columns = [np.interp(when, (stamps - base).astype(float), column) for column in known.T]
    return estimated.values[inside, :3], np.column_stack(columns)
