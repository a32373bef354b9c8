"""Why little is known of a pushed object, in plain words, and what to do about it."""

from __future__ import annotations

from typing import Any

from tactile_dynamics_ros.core.planar.properties.push_model import ASTRAY


def why_unknown(properties: dict[str, Any]) -> list[str]:
    """Return sentences on why numbers are missing; none where nothing is.

    Args:
        properties: links, undetermined and, where they are known, error, refused and structure, as
            `explore` tells them.
    """
    links, unknown, said = properties["links"], properties["undetermined"], []
    error, refused = properties.get("error"), properties.get("refused", "")
    if refused:
        said.append(f"there is no fit to all pushes: {refused}")
    elif not links:
        said.append("there is no estimate: no push was fitted; explore again")
    if error is not None and error > ASTRAY:
        said.append(
            f"the model does not fit these pushes (error {error:.2f} times the noise), so masses "
            "count as unknown: something is missing in it, or the arm jerked; ask `diagnose` of "
            "the recording what it is, or explore again"
        )
    shares = [name for name in unknown if name.endswith(".mass")]
    if shares and properties.get("structure") in ("rigid", "undecided"):
        said.append(
            "parts that move as one body tell what they weigh together, and not what each of them "
            "weighs: push them sideways where they meet, or one by one"
        )
    return said
