"""Findings in one plain sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

_AXES = ("x", "y", "z")
_MOST_PARAMETERS = 3


def write_parameters(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """``c = 0.41 +- 0.03 N s/m``; the three components of a vector together; a few at most."""
    texts, done = [], set[str]()
    for name, entry in parameters.items():
        if name in done:
            continue
        stem = name[:-2]
        group = [f"{stem}_{axis}" for axis in _AXES]
        if name[-2:] == "_x" and all(member in parameters for member in group):
            values = ", ".join(_number(float(parameters[m]["value"])) for m in group)
            texts.append(f"{stem} = ({values}) {entry['unit']}".rstrip())
            done.update(group)
        else:
            texts.append(f"{name} = {write_value(entry)}")
    shown = ", ".join(texts[:_MOST_PARAMETERS])
    return shown + (", ..." if len(texts) > _MOST_PARAMETERS else "")


def write_value(entry: Mapping[str, Any]) -> str:
    """Value and standard deviation with the digits that count, and the unit."""
    value, std, unit = float(entry["value"]), float(entry["std"]), str(entry["unit"])
    if not (math.isfinite(std) and std > 0):
        return f"{value:.3g} {unit}".rstrip()
    digits = max(0, 1 - math.floor(math.log10(std)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{value:.3g} +- {std:.1g} {unit}".rstrip()
    return f"{value:.{digits}f} +- {std:.{digits}f} {unit}".rstrip()


def _number(value: float) -> str:
    return f"{value:.2g}" if abs(value) < 1 else f"{value:.3g}"


def capitalise(text: str) -> str:
    """First letter upper case, the rest as it is."""
    return text[:1].upper() + text[1:]


def join_names(names: Sequence[str], word: str = "or") -> str:
    """``a``, ``a or b``, ``a, b or c``, or with another word."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {word} {names[-1]}"


def group_clause(verdict: str, group: Sequence[str], motion: Mapping[str, Any] | None) -> str:
    """What else may be the cause and what would tell, as a clause; empty without a group.

    Where one effect is named, the others contain what it does, with more parameters; otherwise they
    are as plausible.

    Args:
        verdict: of the diagnosis.
        group: the effect that is named, then the others.
        motion: that would separate them, if any does.
    """
    if len(group) < 2:
        return ""
    if verdict == "ambiguous":
        text = f"this recording cannot tell {join_names(group, 'and')} apart"
    else:
        text = f"the same could be done here, with more parameters, by {join_names(group[1:])}"
    if not motion:
        return f"{text}, and no motion was found that separates them"
    told = motion.get("separates_from", group)
    left = [name for name in group[1:] if name not in told]
    remains = f"; that does not separate {group[0]} from {join_names(left)}" if left else ""
    return f"{text}: {motion['description']}{remains}"


def write_percent(share: float) -> str:
    """Percent without pretending to be exact."""
    return f"{min(99.9, 100.0 * share):.3g} %" if share > 0.99 else f"{100.0 * share:.0f} %"
