"""`tactile-dynamics estimate`: inertia of the held object, and parameters of effects."""

from __future__ import annotations

import json
import sys
from argparse import Namespace, _SubParsersAction
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    read_effects,
    read_recording,
)


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser(
        "estimate", help="mass, centre of mass and inertia from a recording, with uncertainty"
    )
    add_recording_arguments(parser)
    parser.add_argument("--out", metavar="DIR", help="also write DIR/report.html with figures")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Estimate and print; the exit code is 3 where the numbers are no answer."""
    from tactile_dynamics_ros.api.verbs import estimate

    found = estimate(read_recording(args), read_effects(args))
    print(json.dumps(found.to_json()) if args.json else found)
    if args.out:
        print(f"report: {found.report(Path(args.out))}", file=sys.stderr)
    found.require_answer()
    return 0
