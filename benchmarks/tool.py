"""Is a load known as well when a gripper is carried with it and taken out as a tool?"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import tactile_dynamics_ros as td
from benchmarks.page_section import compose_section, section_parser, show
from benchmarks.support.layouts.wrist_log import INERTIA_PER_MASS, WristLog
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters, KnownBody
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.kuka_ft_imu import KukaFtImuImporter
from tactile_dynamics_ros.recording.yaml_files import read_body, write_body

FIRST_SEED = 26000
"""Seeds from here on were not used for tuning."""
GRIPPER = (0.9, np.array([0.0, 0.004, 0.05]))
"""Mass, kg, and centre, m, of the gripper."""
LOAD = (0.4, np.array([0.01, -0.006, 0.14]))
"""Mass, kg, and centre, m, of the load."""
SECONDS = 10.0
"""Length of the recordings with the load, s."""
WAYS = {"data sheet": 0.0, "empty, 10 s": 10.0, "empty, 40 s": 40.0}
"""How the gripper is known: seconds of recording without load; 0 exactly."""


@dataclass(frozen=True)
class Outcome:
    """One load with a gripper, against the same load without.

    Attributes:
        way: of WAYS. seed: of the recordings.
        ratio: (4,) std of mass and centre over those without a gripper.
        error: (4,) error in its own std.
    """

    way: str
    seed: int
    ratio: np.ndarray
    error: np.ndarray


def recording(seed: int, loads: list[tuple[float, np.ndarray]], seconds: float) -> Recording:
    """A wrist that carries loads."""
    log = WristLog.carrying(seed, loads, seconds)
    wrist = {
        "time": log.time,
        "force": log.force,
        "torque": log.torque,
        "force_std": 0.05,
        "position": np.zeros(3),
        "rotation": np.eye(3),
    }
    pose = {"time": log.time, "position": log.position, "quaternion": log.quaternion}
    return Recording.from_arrays({"wrist": wrist}, pose, contact_frame="object", source=f"{seed}")


def outcomes(start: int, count: int) -> Iterator[Outcome]:
    """Estimate loads with and without a gripper."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "gripper.yaml"
        for seed in range(start, start + count):
            plain = td.estimate(recording(seed, [LOAD], SECONDS), "force_bias").found
            both = td.estimate(recording(seed, [GRIPPER, LOAD], SECONDS), "force_bias")
            for way, seconds in WAYS.items():
                _know_gripper(file, seed, seconds)
                found = replace(both, tool=read_body(file)).found
                ratio = found.parameter_std[:4] / plain.parameter_std[:4]
                yield Outcome(way, seed, ratio, _error(found))


def _know_gripper(file: Path, seed: int, seconds: float) -> None:
    if seconds:
        td.estimate(recording(seed + 5000, [GRIPPER], seconds), "force_bias").save(file)
        return
    mass, com = GRIPPER
    write_body(KnownBody.exact(InertialParameters(mass, com, mass * INERTIA_PER_MASS), ""), file)


def _error(found: InertialEstimate) -> np.ndarray:
    mass, com = LOAD
    error = np.concatenate([[found.inertia.mass - mass], found.inertia.com - com])
    return np.asarray(error / found.parameter_std[:4])


def table(found: Sequence[Outcome]) -> list[str]:
    """Rows of the table, one for each way of knowing the gripper."""
    lines = [
        "| gripper known from | n | std of mass, of centre over those without it (median) | within "
        "two std (of 4 n) | RMS error in std |",
        "|---|---|---|---|---|",
    ]
    for way in WAYS:
        own = [one for one in found if one.way == way]
        ratio = np.array([one.ratio for one in own])
        error = np.array([one.error for one in own])
        lines.append(
            f"| {way} | {len(own)} | {np.median(ratio[:, 0]):.2f}, {np.median(ratio[:, 1:]):.2f} | "
            f"{np.mean(np.abs(error) < 2.0):.0%} | {np.sqrt(np.mean(error**2)):.2f} |"
        )
    return lines


def real_lines(data: Path) -> list[str]:
    """A known mass added to the file of a tool must leave the load without it.

    Of the real payload two thirds of its mass, at its centre, are taken as the tool: what is left
    must be a third, with the same centre.
    """
    folder = data / "kuka_ft_imu" / "1-baseline"
    if not folder.parent.exists():
        return [f"({folder.parent} is not on this machine)"]
    run = KukaFtImuImporter().read(folder, Namespace(tare=False, imu_delay=0.0084))
    whole = td.estimate(run, "force_bias").found
    mass, com = 2.0 / 3.0 * 0.9333, np.array([0.3e-3, 0.1e-3, 43.9e-3])
    part = InertialParameters(mass, com, mass * 1e-4 * np.eye(3))
    with TemporaryDirectory() as place:
        file = write_body(KnownBody.exact(part, "part"), Path(place) / "part.yaml")
        rest = td.estimate(run, "force_bias", tool=file).found
    std, centre = rest.parameter_std, ", ".join(f"{1e3 * one:.1f}" for one in rest.inertia.com)
    spread, before = ", ".join(f"{1e3 * one:.1f}" for one in std[1:4]), whole.parameter_std[0]
    return [
        f"`kuka_ft_imu`, 1-baseline: whole {whole.inertia.mass:.4f} ± {before:.4f} kg; with",
        "0.6222 kg at (0.3, 0.1, 43.9) mm taken as tool",
        f"{rest.inertia.mass:.4f} ± {std[0]:.4f} kg at ({centre}) ± ({spread}) mm; the documented",
        "payload is 0.9333 kg, so that 0.3111 kg are left.",
    ]


def section(found: Sequence[Outcome], real: Sequence[str], command: str) -> str:
    """The section of the page."""
    text = [
        "## Loads in a gripper, which is taken out as a tool",
        "",
        "A wrist sensor (0.05 N, 3 N mm, bias of newtons; effect `force_bias`) carries 0.4 kg",
        "in a gripper of 0.9 kg for 10 s at 100 Hz, and the same load alone. Wanted: standard",
        "deviations of at most 1.2 times those without.",
    ]
    return compose_section("tool", text, command, [*table(found), "", *real])


def main(arguments: Sequence[str] | None = None) -> int:
    """Estimate; print the table and write it."""
    parser = section_parser(__doc__, FIRST_SEED)
    parser.add_argument("--count", type=int, default=20, help="loads")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    options = parser.parse_args(arguments)
    real = real_lines(options.data)
    print("\n".join(real))
    command = f"./dev bench tool --start {options.start} --count {options.count}"
    found = outcomes(options.start, options.count)
    return show(found, table, lambda found: section(found, real, command), options.write)
