"""The page of an exploration: pushes with their expected gain, estimates, the way to the goal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_dynamics_ros.report.page import Page, Picture, Section, write_page
from tactile_dynamics_ros.report.pushes import closed
from tactile_dynamics_ros.report.style import BLUE, GREEN, ORANGE, house_style, new_figure

COMPARED = ("friction_force_n", "mass", "friction", "com_x", "com_y")
UNITS = {"friction_force_n": "N", "mass": "kg", "friction": "", "com_x": "m", "com_y": "m"}
TITLES = {
    "friction_force_n": "friction force",
    "mass": "mass",
    "friction": "friction",
    "com_x": "centre of mass x",
    "com_y": "centre of mass y",
}
"""Quantities as charts and tables name them."""
REMARKS = ("chosen_because", "stopped", "jerked", "missed", "late")
"""Entries of a push that say why it was chosen, and what went wrong with it."""
COLOURS = (BLUE, GREEN)
"""Of the parts of an object."""
ARROW, GAP = 0.04, 0.008
"""Length of an arrow of a push, and from its end to the middle of its number, m: an object is 6 to
28 cm long."""


def compare_properties(properties: dict[str, Any], truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return estimates beside the truth of each link, with what is undetermined.

    Args:
        properties: links and undetermined, as `explore` tells them.
        truth: as robot_sim reveals it.
    """
    several = len(properties["links"]) > 1
    rows = []
    for k, (link, known) in enumerate(zip(properties["links"], truth["links"], strict=False), 1):
        part = f"link_{k}" * several
        rows += _compared(part, _flat(link), known, properties["undetermined"])
    return rows


def _compared(
    part: str, found: dict[str, tuple[float, float]], known: dict[str, Any], unknown: list[str]
) -> list[dict[str, Any]]:
    """Rows of one part; its name is empty where there is only one."""
    known = {**known, "com_x": known["com"][0], "com_y": known["com"][1]}
    rows = []
    for name in (name for name in COMPARED if name in found):
        value, std = found[name]
        stem = "com" if name.startswith("com") else name
        rows.append(
            {
                "name": name,
                "part": part,
                "value": value,
                "std": std,
                "truth": known[name],
                "off_by_std": abs(value - known[name]) / std,
                "undetermined": bool({name, stem, f"{part}.{stem}"} & set(unknown)),
            }
        )
    return rows


def _flat(link: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Values and stds by name, the centre of mass by coordinate."""
    flat = {name: (entry["value"], entry["std"]) for name, entry in link.items() if name != "com"}
    if "com" in link:
        for k, name in enumerate(("com_x", "com_y")):
            flat[name] = link["com"]["value"][k], link["com"]["std"][k]
    return flat


def write_exploration(story: dict[str, Any], folder: Path) -> Path:
    """Write report.html of an exploration and a push to a goal.

    Args:
        story: explored, pushed (None: not at all), goal, goal_from and goal_to (s), parts
            (footprint and path of each), history, compared, why_unknown (sentences), truth (None:
            not revealed), changed, and stopped and broken, which say what did not come to its end.
        folder: where it goes.
    """
    pushed = story["pushed"]
    stopped = [*story["stopped"], *filter(None, [story["broken"]])]
    with house_style():
        page = Page(
            title="What was pushed about",
            verdict=f"{_explored(story['explored'])}; {_brought(pushed)}.",
            good=pushed is not None and bool(pushed["reached"]) and not stopped,
            sentences=[f"Stopped: {why}." for why in stopped],
            source=str(folder / "recording"),
            command="tactile-dynamics demo --planar",
            sections=[_actions(story), _estimates(story), *_way(story), *_changes(story)],
        )
        return write_page(page, folder)


def _explored(explored: dict[str, Any]) -> str:
    why = explored.get("stopped_because", "exploring did not come to its end")
    return f"{len(explored['actions'])} pushes explored it ({why})"


def _brought(pushed: dict[str, Any] | None) -> str:
    if pushed is None:
        return "it was not pushed to the goal"
    near = f"{1e3 * pushed['error_m']:.1f} mm and {np.rad2deg(pushed['error_rad']):.1f} deg"
    return f"then {pushed['pushes']} pushes brought it within {near} of the goal"


def _actions(story: dict[str, Any]) -> Section:
    actions, several = story["explored"]["actions"], len(story["parts"]) > 1
    rows = [
        [
            str(k),
            *[f"link_{a.get('part', 1)}"] * several,
            f"{a['point'][0]:.3f}, {a['point'][1]:.3f}",
            f"{a['speed']:g}",
            "; ".join(a[key] for key in REMARKS if key in a),
        ]
        for k, a in enumerate(actions, 1)
    ]
    figure = _map(story, (-np.inf, story["goal_from"] or np.inf), actions)
    caption = "Arrows are pushes, numbered."
    if several:
        caption += " Blue: link_1 and pushes on it; green: link_2."
    return Section(
        "Pushes that were chosen",
        [f"{_explored(story['explored'])}."],
        [Picture("actions", figure, "outlines and pushes", caption)],
        ["push", *["on"] * several, "at, m", "m/s", "what it is to tell"],
        rows,
    )


def _estimates(story: dict[str, Any]) -> Section:
    rows = [
        [
            f"{row.get('part', '')} {TITLES[row['name']]}".strip(),
            f"{row['value']:.4g} ± {row['std']:.2g} {UNITS[row['name']]}",
            f"{row['truth']:.4g}",
            "undetermined" if row["undetermined"] else f"{row['off_by_std']:.1f}",
        ]
        for row in story["compared"]
    ]
    said = [*story["why_unknown"]]
    if story["truth"] is None:
        said.append("The truth was not revealed.")
    elif not story.get("changed"):
        hidden = story["truth"]["hidden_effect"]["name"]
        said.append(f"Hidden effect of this run, revealed at the end: {hidden}.")
    pictures = []
    if story["history"] and story["compared"]:
        figure = _history(story)
        caption = "Bands are ± one standard deviation, lines the truth."
        pictures = [Picture("estimates", figure, "estimates over time", caption)]
    return Section(
        "What was found",
        said,
        pictures,
        ["quantity", "estimate", "truth", "error, std"],
        rows,
    )


def _way(story: dict[str, Any]) -> list[Section]:
    """The way to the goal; nothing where none was gone."""
    pushed = story["pushed"]
    if pushed is None:
        return []
    figure = _map(story, (story["goal_from"], story["goal_to"] or np.inf), [])
    ended = f"{pushed['pushes']} pushes in {pushed['duration_s']:.0f} s; it ended because: "
    caption = "Blue and green: on the way; orange: the goal."
    return [
        Section(
            "The way to the goal",
            [f"{ended}{pushed['stopped_because']}."],
            [Picture("goal", figure, "path to the goal", caption)],
        )
    ]


def _changes(story: dict[str, Any]) -> list[Section]:
    """What changed in the end, what was said of it, and the truth; nothing if nothing was to."""
    changed = story.get("changed")
    if not changed:
        return []
    said = ["Nobody noticed a change."] if not changed["noticed"] else [changed["text"]]
    said += [changed["sentence"]] if "sentence" in changed else []
    if "fall" in changed:
        said.append(f"{changed['added']} was added while it ran; {changed['fall']}.")
    said += [f"No diagnosis: {changed['refused']}"] if "refused" in changed else []
    pairs = [
        ("held-out error, times the noise", changed.get("before"), changed.get("after")),
        ("error of the live model", changed.get("live_before"), changed.get("live_after")),
    ]
    rows = [[name, f"{a:.2f}", f"{b:.2f}"] for name, a, b in pairs if a and b]
    header = ["", "before", "with what was named"] if rows else []
    hidden = story["truth"] and story["truth"]["hidden_effect"]
    if hidden and hidden["begins"] is not None:
        truth = ", ".join(
            f"{name} {entry['value']} {entry['unit']}".rstrip()
            for name, entry in hidden["parameters"].items()
        )
        said.append(f"The truth: {hidden['name']} from {hidden['begins']:.1f} s on ({truth}).")
    return [Section("What changed then", said, [], header, rows)]


def _map(story: dict[str, Any], span: tuple[float, float], actions: list[dict[str, Any]]) -> Figure:
    """Draw outlines of all parts within a span of time (s), with pushes or the goal."""
    figure = new_figure(4.0, 5.0)
    axes = figure.add_subplot()
    for part, colour in zip(story["parts"], COLOURS, strict=False):
        outline, path = np.array(part["footprint"]), np.array(part["path"])
        within = path[(path[:, 3] >= span[0]) & (path[:, 3] <= span[1])]
        rows = within if len(within) else path[-1:]
        for k in np.linspace(0, len(rows) - 1, 8).astype(int):
            axes.plot(*closed(outline, rows[k]).T, color=colour, alpha=0.4, linewidth=0.8)
        axes.plot(rows[:, 0], rows[:, 1], color=colour, linewidth=0.8)
    for k, action in enumerate(actions, 1):
        _draw_push(axes, str(k), action)
    if not actions:
        goal = np.array(story["goal"]) * [1.0, 1.0, np.pi / 180.0]
        axes.plot(*closed(np.array(story["parts"][0]["footprint"]), goal).T, color=ORANGE)
    axes.margins(0.05)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    return figure


def _draw_push(axes: Axes, name: str, action: dict[str, Any]) -> None:
    """Draw a push as an arrow with its name behind it, in the colour of the part that it meets."""
    point, colour = np.array(action["point"]), COLOURS[action.get("part", 1) - 1]
    direction = np.array(action["direction"])
    start, label = point - ARROW * direction, point - (ARROW + GAP) * direction
    shape = {"arrowstyle": "->", "color": colour}
    axes.annotate("", point, start, arrowprops=shape)
    axes.text(*label, name, color=ORANGE, ha="center", va="center", clip_on=True)
    room = [-GAP, GAP]  # so that arrow and name lie inside the axes
    axes.update_datalim([*(label + np.array([[x, y] for x in room for y in room])), point])
    axes.autoscale_view()


def _history(story: dict[str, Any]) -> Figure:
    """Draw each quantity over time with its interval and the truth."""
    truth = {row["name"]: row["truth"] for row in story["compared"]}
    figure = new_figure(6.0, 5.5)
    time = np.array([row["time"] for row in story["history"]])
    for k, name in enumerate(truth):
        axes = figure.add_subplot(len(truth), 1, k + 1)
        value = np.array([row.get(name, np.nan) for row in story["history"]])
        std = np.array([row.get(f"{name}_std", np.nan) for row in story["history"]])
        axes.plot(time, value, color=BLUE)
        low, high = value - std, value + std
        axes.fill_between(time, low, high, color=BLUE, alpha=0.2)
        axes.axhline(truth[name], color=ORANGE)
        axes.set_ylabel(f"{TITLES[name]}, {UNITS[name]}".rstrip(", "), fontsize=7)
    axes.set_xlabel("time, s")
    return figure
