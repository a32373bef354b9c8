"""Write a recording with hidden effects and, beside it, the truth."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.hidden.bag import write_bag
from benchmarks.hidden.effects import CATALOGUE, OUTSIDE
from benchmarks.hidden.recordings import HiddenRecording, generate, generate_at_whitened_rms
from benchmarks.hidden.scenario import ScenarioOptions
from benchmarks.hidden.sensors import SensorOptions


def main(arguments: list[str] | None = None) -> int:
    """Write the bag and, beside it, the truth as `<OUT>.truth.json`."""
    options = _parse(arguments)
    if options.list:
        print("catalogue:", *CATALOGUE, "\noutside the catalogue:", *OUTSIDE)
        return 0
    if options.out is None:
        print("missing OUT, the directory of the recording", file=sys.stderr)
        return 2
    recording = _generate(options)
    try:
        write_bag(recording.streams, options.out)
    except FileExistsError as error:
        print(error, file=sys.stderr)
        return 2
    truth = options.out.with_name(options.out.name + ".truth.json")
    truth.write_text(json.dumps(recording.truth(), indent=1))
    print(options.out)
    return 0


def _generate(options: argparse.Namespace) -> HiddenRecording:
    scenario = ScenarioOptions(
        duration=options.duration,
        finger_roll=options.frames == "finger",
        regrasp=options.regrasp,
        contact_breaks=options.contact_breaks,
    )
    sensors = SensorOptions(
        stagger=options.stagger,
        pose_gaps=options.pose_gaps,
        state_force_std=not options.no_force_std,
        frames=options.frames,
    )
    if options.magnitude is not None:
        sizes = dict.fromkeys(options.effect, options.magnitude)
        return generate(options.seed, sizes, scenario, sensors)
    targets = dict.fromkeys(options.effect, options.whitened_rms)
    return generate_at_whitened_rms(options.seed, targets, scenario, sensors)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hidden.write_bag", description=__doc__
    )
    parser.add_argument("out", nargs="?", type=Path, help="directory of the recording to create")
    parser.add_argument("--list", action="store_true", help="print the names of all hidden effects")
    parser.add_argument(
        "--effect",
        action="append",
        default=[],
        choices=[*CATALOGUE, *OUTSIDE],
        metavar="NAME",
        help="hidden effect; may be repeated; none gives a clean recording",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--magnitude", type=float, help="multiple of the effect's typical size")
    size.add_argument(
        "--whitened-rms",
        type=float,
        default=2.0,
        help="choose the size that raises the whitened error to about this (default 2)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--duration", type=float, default=30.0, help="s")
    parser.add_argument("--regrasp", action="store_true", help="three fingers move at half-time")
    parser.add_argument("--contact-breaks", type=int, default=0)
    parser.add_argument("--pose-gaps", type=int, default=0)
    parser.add_argument("--stagger", action="store_true", help="sensors sample at different phases")
    parser.add_argument(
        "--frames",
        choices=["finger", "normal"],
        default="finger",
        help="fingers roll and contact frames show it, or there is no roll and only a normal",
    )
    parser.add_argument(
        "--no-force-std", action="store_true", help="leave the force noise unstated"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
