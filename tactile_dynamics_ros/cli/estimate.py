"""`tactile-dynamics estimate`: inertia of the held object, and parameters of effects."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    read_effects,
    read_recording,
)
from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.estimates import Estimate


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "estimate", help="mass, centre of mass and inertia from a recording, with uncertainty"
    )
    add_recording_arguments(parser)
    parser.add_argument("--out", metavar="DIR", help="also write DIR/report.html with figures")
    parser.add_argument(
        "--export",
        metavar="FORMAT",
        help="print the body as urdf, sdf, mjcf, ur (payload call) or franka (SetLoad request) "
        "instead; refused if the recording does not tell it",
    )
    parser.add_argument(
        "--tool",
        metavar="FILE",
        help="take this known part out of what is carried, such as a gripper: a URDF (FILE#LINK if "
        "it has several), or a file of --save",
    )
    parser.add_argument(
        "--prior", metavar="FILE", help="file of --save: the same object in earlier recordings"
    )
    parser.add_argument(
        "--save", metavar="FILE", help="write what is known of the body now, for --tool or --prior"
    )
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Estimate and print; the exit code is 3 where the numbers are no answer."""
    from tactile_dynamics_ros.api.verbs import estimate

    found = estimate(read_recording(args), read_effects(args), tool=args.tool, prior=args.prior)
    for note in found.notes:
        print(f"note: {note}", file=sys.stderr)
    if args.export:
        print(_export(args, found), end="")
    else:
        print(json.dumps(found.to_json()) if args.json else found)
    if args.out:
        print(f"report: {found.report(Path(args.out))}", file=sys.stderr)
    found.require_answer()
    if args.save:
        print(f"saved: {found.save(args.save)}", file=sys.stderr)
    return 0


def _export(args: Namespace, found: Estimate) -> str:
    """Return the block; say on stderr what is not in it.

    Raises:
        BadInputError: JSON is wanted as well.
        NotIdentifiableError: the recording does not tell what the format needs.
    """
    if args.json:
        raise BadInputError("--export prints the block alone; leave out --json")
    block = found.export(args.export)
    for line in block.left_out:
        print(f"note: left out: {line}", file=sys.stderr)
    return block.text
