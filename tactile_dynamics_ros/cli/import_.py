"""`tactile-dynamics import`: measurements in other forms to a recording."""

from __future__ import annotations

import json
from argparse import SUPPRESS, Namespace, _SubParsersAction
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.recording.importers import IMPORTERS, Importer


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb with one word per importer."""
    parser = verbs.add_parser("import", help="turn CSV tables or a known data set into a recording")
    forms = parser.add_subparsers(dest="form", metavar="FORM", required=True)
    for importer in IMPORTERS:
        form = forms.add_parser(importer.name, help=importer.summary, description=importer.summary)
        form.add_argument("source", metavar="SOURCE", help=importer.source_help)
        form.add_argument("out", metavar="OUT", help="new .mcap file or rosbag2 directory")
        form.add_argument(
            "--json",
            action="store_true",
            default=SUPPRESS,
            help="print only JSON on stdout",
        )
        importer.add_arguments(form)
        form.set_defaults(run=run, importer=importer)


def run(args: Namespace) -> int:
    """Read the source, write the recording and tell what is in it."""
    importer: Importer = args.importer
    recording = importer.read(Path(args.source), args)
    path = recording.to_bag(args.out)
    streams = recording.streams
    summary = {
        "recording": str(path),
        "duration_s": recording.duration,
        "poses": 0 if streams.pose is None else len(streams.pose.time),
        "imu_samples": 0 if streams.imu is None else len(streams.imu.time),
        "contacts": {name: len(contact.time) for name, contact in streams.contacts.items()},
        "problems": recording.problems,
    }
    print(json.dumps(summary) if args.json else _describe(summary, recording.problem_lines()))
    return 0


def _describe(summary: dict[str, Any], problems: list[str]) -> str:
    """Return the summary for people."""
    contacts = ", ".join(f"{name} ({count})" for name, count in summary["contacts"].items())
    lines = [
        f"{summary['recording']}: {summary['duration_s']:.2f} s, {summary['poses']} poses, "
        f"{summary['imu_samples']} IMU samples, contacts: {contacts or 'none'}"
    ]
    return "\n".join([*lines, *(f"note: {line}" for line in problems)])
