"""Manners of pushing and pulling: what each tells of product, mass and centre of mass."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate
from tactile_dynamics_ros.synthetic import pushed

_SLOW = pushed.ActionOptions(count=4, speed=(0.02, 0.025), hard_stop=False)
MANNERS = {
    "push 20 to 25 mm/s": _SLOW,
    "push 30 to 200 mm/s": pushed.ActionOptions(count=4, speed=(0.03, 0.2), hard_stop=False),
    "push 300 mm/s, hard stop": pushed.ActionOptions(count=4, speed=(0.3, 0.3)),
    "push 20 to 25 mm/s, known tilt of 5 deg": _SLOW,
    "pull 20 to 25 mm/s": replace(_SLOW, kind="pull"),
    "pull and shake 10 mm at 2 Hz": replace(_SLOW, kind="shake"),
}
"""Four actions each, as in a table of what can be known at all."""
_TILTED = "push 20 to 25 mm/s, known tilt of 5 deg"
_TILT = 2.5
"""Multiple of the typical lean of 2 degrees."""
_RATES = (15.0, 125.0)
"""Hz of poses and forces: those of paper B's camera and of fast fingertips."""
_FORCE, _POSE, _TURN = 0.05, 1e-3, 0.5
"""Noise of force, N, and pose, m and degrees, for which the limits were computed: those of a
cheap camera and of a pad."""
_VARIATION, _STICTION = 0.1, 0.1
"""Relative local variation of friction and gain at rest, likewise: what real tables have."""
_MASS_RANGE, _FRICTION_RANGE, _COM_SHARE = 1.25, 0.35, 0.6
"""Ranges from which objects are drawn: mass, kg, friction, and centre over half extents; errors
and std are told over them. Nothing known is 0.29."""
LIMITS = {
    "push 20 to 25 mm/s": ("0.114, 0.049", "0.006", "2.6"),
    "push 30 to 200 mm/s": ("0.076, 0.021", "0.006", "3 (at 100 mm/s)"),
    "push 300 mm/s, hard stop": ("0.035, 0.014", "0.008", "3.7"),
    _TILTED: ("0.029, 0.019", "0.009", "2.7"),
    "pull 20 to 25 mm/s": ("0.067, 0.037", "0.19", "2.9"),
    "pull and shake 10 mm at 2 Hz": ("0.007, 0.004", "0.040", "0.5"),
}
"""Posterior std over the range that an independent prototype computed: of the mass at 15 and at
125 Hz, of the worse coordinate of the centre, and of the product, %."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--manner-seeds", type=int, nargs="+", default=list(range(600, 606)))
    parser.add_argument("--manners", nargs="+", choices=sorted(MANNERS), default=list(MANNERS))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Errors and stated std of every manner and rate."""
    seeds = options.manner_seeds[: 1 if options.quick else None]
    return {
        f"{manner}, {rate:.0f} Hz": _rows(manner, rate, seeds)
        for manner in options.manners
        for rate in _RATES
    }


def _rows(manner: str, rate: float, seeds: Sequence[int]) -> list[dict[str, Any]]:
    sensors = pushed.SensorOptions(
        rate_hz=rate,
        force_rate_hz=rate,
        force_std=_FORCE,
        position_std=_POSE,
        rotation_std_deg=_TURN,
    )
    condition = pushed.PushOptions(
        actions=MANNERS[manner], sensors=sensors, variation=_VARIATION, stiction=_STICTION
    )
    hidden = {"support_tilt": _TILT} if manner == _TILTED else {}
    rows = []
    for made in pushed.generate(seeds, hidden, condition):
        rows.append(_row(made))
        print(f"{manner}, {rate:.0f} Hz: {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def _row(made: pushed.HiddenPush) -> dict[str, Any]:
    streams = replace(made.streams, gravity=made.scene.gravity)
    start = time.process_time()
    try:
        found = estimate(streams)
    except NotIdentifiableError as error:
        return {"refused": str(error), "cpu_s": time.process_time() - start}
    assert isinstance(found, PushedEstimate)
    truth = made.truth()["links"][0]
    half = 0.5 * np.ptp(made.scene.thing.links[0].corners, axis=0)
    reach = _COM_SHARE * half
    size = {
        "friction_force_n": truth["friction_force_n"],
        "mass": _MASS_RANGE,
        "friction": _FRICTION_RANGE,
        "com_x": reach[0],
        "com_y": reach[1],
    }
    known = {name: truth[name] for name in ("friction_force_n", "mass", "friction")}
    known |= {"com_x": truth["com"][0], "com_y": truth["com"][1]}
    return {
        "undetermined": list(found.undetermined),
        "std": {name: found.values[name][1] / size[name] for name in known},
        "error": {name: (found.values[name][0] - known[name]) / size[name] for name in known},
        "cpu_s": time.process_time() - start,
    }


def table(found: dict[str, Any]) -> str:
    """Medians of std and of errors over ranges, beside the limits."""
    head = (
        "| manner | n | product %: std, error, limit | mass: std, error, limit (15, 125 Hz) "
        "| friction: std, error | CoM: std, error, limit | mass, CoM undetermined | largest z "
        "| refused | cpu s |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    return "\n".join(lines + [_line(name, rows) for name, rows in found.items()])


def _line(name: str, rows: list[dict[str, Any]]) -> str:
    told = [row for row in rows if "std" in row]
    mass, com, product = LIMITS[name.rsplit(", ", 1)[0]]

    def medians(*names: str, unit: float = 1.0) -> str:
        columns = [[abs(row[of][n]) for row in told for n in names] for of in ("std", "error")]
        return ", ".join(f"{unit * np.median(c):.2g}" for c in columns) if told else "-"

    def unknown(what: str) -> int:
        return sum(what in row["undetermined"] for row in told)

    z = [abs(row["error"][n] / row["std"][n]) for row in told for n in row["std"]]
    cells = [
        name,
        len(rows),
        f"{medians('friction_force_n', unit=100.0)}, {product}",
        f"{medians('mass')}, {mass}",
        medians("friction"),
        f"{medians('com_x', 'com_y')}, {com}",
        f"{unknown('mass')}, {unknown('com')}",
        f"{max(z, default=float('nan')):.1f}",
        len(rows) - len(told),
        f"{np.median([row['cpu_s'] for row in rows]):.0f}",
    ]
    return "| " + " | ".join(map(str, cells)) + " |"
