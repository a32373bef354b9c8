"""Are other signs, units and axes of pushes named, and none where nothing is wrong?"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.misreading import misread
from tactile_dynamics_ros.core.planar.streams import PushedStreams
from tactile_dynamics_ros.synthetic import pushed

Mistake = Callable[[PushedStreams], PushedStreams]

_FLIP_Y, _FLIP_YZ = np.array([1.0, -1.0, 1.0]), np.array([1.0, -1.0, -1.0])
_HIDDEN = ("", *pushed.CATALOGUE)
"""What right recordings have besides, in turn: nothing, and every effect at 1.35."""
_MAGNITUDE = 1.35
"""Of hidden effects, as in the section of diagnoses."""


def with_contacts(streams: PushedStreams, **change: Callable[[Array], Array]) -> PushedStreams:
    """Return a recording with fields of its contacts changed."""
    made = {
        name: replace(contact, **{k: by(getattr(contact, k)) for k, by in change.items()})
        for name, contact in streams.contacts.items()
    }
    return replace(streams, contacts=made)


def with_poses(streams: PushedStreams, factor: Array | list[float]) -> PushedStreams:
    """Return a recording with x, y and yaw multiplied."""
    links = tuple(replace(link, pose=link.pose * np.array(factor)) for link in streams.links)
    return replace(streams, links=links)


def _flipped(streams: PushedStreams, flip: Array) -> PushedStreams:
    changed = dict.fromkeys(("force", "point", "normal"), lambda values: values * flip)
    return with_contacts(streams, **changed)


def _over(streams: PushedStreams) -> PushedStreams:
    turned = with_poses(_flipped(streams, _FLIP_YZ), _FLIP_YZ)
    return replace(turned, gravity=-streams.gravity)


def _thousandfold(values: Array) -> Array:
    return 1e3 * values


MISTAKES: dict[str, tuple[str, Mistake]] = {
    "forces on the tip": ("force_sign", lambda s: with_contacts(s, force=np.negative)),
    "forces in mN": ("force_unit", lambda s: with_contacts(s, force=_thousandfold)),
    "yaw in degrees": ("angle_unit", lambda s: with_poses(s, [1.0, 1.0, 180.0 / np.pi])),
    "yaw clockwise": ("inverse_rotation", lambda s: with_poses(s, [1.0, 1.0, -1.0])),
    "poses in mm": ("position_unit", lambda s: with_poses(s, [1e3, 1e3, 1.0])),
    "contact points in mm": ("position_unit", lambda s: with_contacts(s, point=_thousandfold)),
    "y of contacts the other way": ("mirrored_axes", lambda s: _flipped(s, _FLIP_Y)),
    "the table's normal downwards": ("gravity_direction", _over),
}
"""What people write instead of what the contract says, with the convention's name."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--convention-seeds", type=int, nargs=2, default=[1300, 1320])
    parser.add_argument("--right-seeds", type=int, nargs=2, default=[1300, 1360])


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Names that are found in wrong recordings, and in right ones."""
    wrong, right = (range(*span) for span in (options.convention_seeds, options.right_seeds))
    if options.quick:
        wrong, right = wrong[:1], right[:2]
    rows = []
    for seed in sorted({*wrong, *right}):
        if seed in wrong:
            made = pushed.generate([seed], {}, pushed.PushOptions(variation=0.05))[0].streams
            for mistake, (_, change) in MISTAKES.items():
                rows.append(_row(seed, mistake, _named(change(made))))
        if seed in right:
            hidden = _HIDDEN[seed % len(_HIDDEN)]
            effects = {hidden: _MAGNITUDE} if hidden else {}
            made = pushed.generate([seed], effects, pushed.PushOptions(variation=0.05))[0].streams
            rows.append(_row(seed, "", _named(made)) | {"effect": hidden})
    return {"rows": rows}


def _row(seed: int, mistake: str, named: str) -> dict[str, Any]:
    return {"seed": seed, "mistake": mistake, "named": named}


def _named(streams: PushedStreams) -> str:
    found = misread(streams)
    return found.name if found else ""


def table(found: dict[str, Any]) -> str:
    """Counts of every mistake as Markdown."""
    lines = ["| written | n | named rightly | otherwise |", "|---|---|---|---|"]
    for mistake, name in [*((k, name) for k, (name, _) in MISTAKES.items()), ("", "")]:
        said = [row["named"] for row in found["rows"] if row["mistake"] == mistake]
        other = sorted({one or "nothing" for one in said if one != name})
        lines.append(
            f"| {mistake or 'as it should be'} | {len(said)} | {said.count(name)} "
            f"| {', '.join(other)} |"
        )
    return "\n".join(lines)
