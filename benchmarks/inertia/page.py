"""The section of docs/lab/inertia.md on inertial estimation, and its figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.inertia.tables import render
from benchmarks.page_section import write_section_to
from tactile_dynamics_ros.report.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    house_style,
    new_figure,
    to_png,
)

BEGIN = "<!-- inertial estimation: begin -->"
END = "<!-- inertial estimation: end -->"
FIGURE = "../figures/inertia_benchmark.png"
COMMAND = "./dev bench inertia --write docs/lab/inertia.md"
RESULTS = Path(__file__).with_name("results.json")
"""The sections of the page as they were last measured."""

_INTRODUCTION = f"""## Inertial estimation

```bash
{COMMAND}
./dev bench inertia --quick        # a few minutes
./dev bench inertia --only live    # one section; --json prints the numbers only
./dev bench inertia --only live --write docs/lab/inertia.md   # the others as last measured
```

All data are generated with exact rigid-body dynamics by programs that share no code with the
estimators, or come from the simulated hand. The figures are medians over seeds. Times are processor
time of one thread on two cores that other programs used as well, so that they are upper limits.

**The bound.** The Cramer-Rao bound is computed from the exact motion and forces of each recording,
with only the white force noise left: no estimator of any kind can do better on average. The errors
that it allows are medians over draws from a normal distribution with the bound as its covariance.
Where poses are noisy, the parameters are asked for in a frame that only these poses show: its
place on the body is uncertain by their noise over the root of their number (0.5 mm / sqrt(3000) =
0.009 mm per axis), even if the motion were known exactly otherwise. The bound with this frame is
one that no estimator can beat either; both are given.

**Poses alone.** With 0.5 mm and 0.2 deg of noise in every pose the same forces tell less, chiefly
because the lever arms of the contacts are read from the poses. If nothing is presumed of the
motion but that a quartic describes each stretch of nine poses, the second bound holds, and
`fit_recording` comes within about a tenth of it. The contacts know more: a finger that neither
slides nor rolls stays at one point of the object, and the joints tell where that point is in the
world. `estimate` tests whether the contacts stay where they are (to what white noise
explains), and if three do, sharpens the poses by them (`residuals/rigid_grasp.py`); what the
unknown displacement of the body frame adds is part of the covariance. In these recordings contact
points are free of noise and stay; in the simulated hand they roll, the test says so, and the poses
are used as they are.

**Measures.** Eq. 34 is paper A's inertial error |4 - tr(P_gt^-1 P)|, which is zero for many wrong
bodies (its Baseline has the least Eq. 34 of its methods at variance 1.0, with the centre of mass
62 mm off); the
affine-invariant distance beside it is a distance.

**Peers** get the same smoothed motion (quartics over 25 poses) and the true force noise. MuJoCo's
toolbox (`mujoco[sysid]` 3.10, run where it is installed) fits rollouts under recorded controls by
design, and contact forces integrated over 30 s drift by metres; fed with `mj_inverse` instead, in
its own inertia coordinates and with its own optimiser, it finds weighted least squares to eight
digits. Drake has inverse dynamics and parameter gradients but no identification tool; the same fit
would be written by hand around it.
"""


def keep_results(results: dict[str, Any], file: Path = RESULTS) -> dict[str, Any]:
    """Add sections to those kept from earlier runs; return all."""
    kept = json.loads(file.read_text()) if file.exists() else {}
    kept |= {name: section for name, section in results.items() if name != "machine"}
    file.write_text(json.dumps(kept, indent=1) + "\n")
    return dict(kept)


def write_page(results: dict[str, Any], page: Path) -> None:
    """Put the section between its markers in a Markdown page, and the figure beside it."""
    body = "\n\n".join([_INTRODUCTION.strip(), f"![Errors and cost]({FIGURE})", render(results)])
    write_section_to(page, f"{BEGIN}\n{body}\n{END}\n")
    image = page.parent / FIGURE
    image.parent.mkdir(exist_ok=True)
    with house_style():
        image.write_bytes(to_png(draw(results)))


def draw(results: dict[str, Any]) -> Figure:
    """Table I errors over noise, coverage of the intervals, and cost of an update."""
    figure = new_figure(3.2)
    panels = figure.subplots(1, 3)
    for name, panel, paint in zip(
        ("table_one", "coverage", "live"),
        panels,
        (_draw_table_one, _draw_coverage, _draw_cost),
        strict=True,
    ):
        if name in results:
            paint(panel, results[name])
        else:
            panel.set_axis_off()
    return figure


def _draw_table_one(axes: Axes, result: dict[str, Any]) -> None:
    rows = {float(v): row for v, row in result["rows"].items() if float(v) > 0.0}
    series = {
        "ours (batch)": BLUE,
        "weighted least squares": GREEN,
        "paper A: Baseline": GREY,
        "paper A: C, No G": ORANGE,
    }
    for name, colour in series.items():
        values = [row["methods"][name]["trace_error"] for row in rows.values()]
        axes.plot(list(rows), values, "o-", color=colour, label=name, markersize=3)
    limit = [row["bound"]["trace_error"] for row in rows.values()]
    axes.plot(list(rows), limit, "--", color=RED, label="Cramer-Rao")
    axes.set(yscale="log", xlabel="force noise variance, N^2", title="Table I, Eq. 34")
    axes.legend(fontsize=7)


def _draw_coverage(axes: Axes, result: dict[str, Any]) -> None:
    names = list(result["batch"])
    places = range(len(names))
    axes.axhspan(85, 95, color=GREY, alpha=0.25, linewidth=0)
    kinds = [("clean", result["batch"], BLUE), ("misfit", result["misfit"]["coverage"], ORANGE)]
    for label, shares, colour in kinds:
        values = [100 * shares[name] for name in names]
        axes.plot(places, values, "o", color=colour, label=label, markersize=4)
    axes.set_xticks(list(places), [name.replace("inertia_", "I ") for name in names], rotation=90)
    axes.set(ylim=(0, 102), title="90 % intervals that hold, %")
    axes.legend(fontsize=7, loc="lower left")


def _draw_cost(axes: Axes, result: dict[str, Any]) -> None:
    other = result["alternatives"]
    for name, colour in (("plain_isam2", PURPLE), ("batch_resolved", ORANGE)):
        costs = other[name]["ms_at_step"]
        axes.plot(
            [int(k) for k in costs],
            list(costs.values()),
            "o-",
            color=colour,
            label=name.replace("_", " "),
            markersize=3,
        )
    ours = result["cpu_ms"]["p50"]
    axes.plot([100, result["updates"]], [ours, ours], "-", color=BLUE, label="ours")
    axes.set(xscale="log", yscale="log", xlabel="samples so far", title="one update, ms")
    axes.legend(fontsize=7)
