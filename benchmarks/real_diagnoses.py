"""What the diagnosis says about measurements of others whose notes tell what disturbs them.

    python -m benchmarks.real_diagnoses ../shared/data --write docs/lab/real_data.md

Prints the section "Diagnosis of real measurements" as Markdown; right or wrong, all of it.
"""

from __future__ import annotations

import argparse
import sys
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.page_section import write_section_to
from tactile_dynamics_ros.core.discrepancy.documents import explanation_document
from tactile_dynamics_ros.core.discrepancy.explanation import explain
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.diagnosis.readings import fit_with_readings
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.recording.importers.biotac_slide import BiotacSlideImporter
from tactile_dynamics_ros.recording.importers.kuka_ft_imu import KukaFtImuImporter

BEGIN, END = "<!-- real diagnoses: begin -->", "<!-- real diagnoses: end -->"
COMMAND = "python -m benchmarks.real_diagnoses ../shared/data --write docs/lab/real_data.md"
PAYLOAD, SLIDES = "kuka_ft_imu", "biotac_slide_iiwa/slides_20mat_x4.tar.gz"
BIAS = "a bias of 9, -1, 10 N"
LATE = "IMU stamped 8.4 ms late"


@dataclass(frozen=True)
class Measurement:
    """A recording and what is known to disturb it."""

    name: str
    documented: str
    streams: Streams


def measurements(data: Path) -> Iterator[Measurement]:
    """Read what is there."""
    runs = {
        "1-baseline": "",
        "2-vibrations": "; hammer taps",
        "3-vibrations-contact": "; hammer taps, a hand pushes with up to 19 N",
    }
    for run, more in runs.items():
        yield _payload(data, run, f"{BIAS}; {LATE}{more}")
    for run in ("1-baseline", "2-vibrations"):
        yield _payload(data, run, f"{LATE}{runs[run]}", tare=True)
    for trial in ("mat3_1", "mat17_2"):
        streams = BiotacSlideImporter().read(data / SLIDES / trial, Namespace()).streams
        yield Measurement(
            f"slide {trial}", "sliding friction; bias that changes with place", streams
        )


def _payload(data: Path, run: str, documented: str, tare: bool = False) -> Measurement:
    options = Namespace(tare=tare, imu_delay=0.0)
    streams = KukaFtImuImporter().read(data / PAYLOAD / run, options).streams
    return Measurement(f"payload {run}{', tared' if tare else ''}", documented, streams)


def write_section(data: Path) -> str:
    """Explain every recording; return the Markdown."""
    lines = [
        BEGIN,
        "## Diagnosis of real measurements",
        "",
        "What `explain` says about recordings whose authors, or their data, tell what disturbs",
        "them. Nothing was tuned on them but the width of the windows that read an IMU.",
        "",
        f"```bash\n{COMMAND}\n```",
        "",
        "| recording | known to disturb it | error / noise floor, step by step | what it says |",
        "|---|---|---|---|",
        *[_row(measurement) for measurement in measurements(data)],
        END,
    ]
    return "\n".join(lines) + "\n"


def _row(measurement: Measurement) -> str:
    print(f"{measurement.name} ...", file=sys.stderr)
    model = HeldObjectModel.from_fit(fit_with_readings(measurement.streams, []))
    document = explanation_document(explain(model))
    floor = document["error"]["noise_floor"]
    steps = [
        f"{step['error'] / floor:.3g}" + (f" (`{step['added']}`)" if step["added"] else "")
        for step in document["steps"]
    ]
    return (
        f"| {measurement.name} | {measurement.documented} | {' → '.join(steps) or '-'} "
        f"| {document['sentence']} |"
    )


def main(arguments: list[str] | None = None) -> int:
    """Print the section; write it where asked."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.real_diagnoses", description=__doc__
    )
    parser.add_argument("data", type=Path, help=f"folder that holds {PAYLOAD}")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="Markdown page to write into")
    options = parser.parse_args(arguments)
    if not (options.data / PAYLOAD).exists():
        print(f"{options.data / PAYLOAD} is not on this machine", file=sys.stderr)
        return 2
    section = write_section(options.data)
    print(section)
    if options.write:
        write_section_to(options.write, section)
    return 0


if __name__ == "__main__":
    sys.exit(main())
