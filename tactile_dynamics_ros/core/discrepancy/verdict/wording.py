"""Numbers with their uncertainty, and lists of names, in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

Table = Mapping[str, Mapping[str, Any]]

_AXES = ("x", "y", "z")
"""Endings of parameters that are reported as one vector, `force_x` to `force_z`; with others the
components would be reported one by one."""
_MOST_PARAMETERS = 3
"""Parameters that a sentence names at most: three (a vector counts as one) are still read at a
glance. More make sentences longer; the document and the report have all."""
_UNDETERMINED = 3.0
"""Standard deviation of a share, over that of the sum, from which only the sum is reported: the
data then say nine times more of the sum than of the share. At 1.5 shares of two fingers that are
known apart are not reported, at 6 shares that are nothing but the prior's may be."""

_LEAST_P_VALUE = 1e-16
"""Probability below which only this bound is written: tails of distributions are computed to double
precision, 1e-16, and no noise is known to be normal that far out."""


def write_parameters(parameters: Table) -> str:
    """``c = 0.41 ± 0.03 N s/m``; the three components of a vector together; a few at most.

    Where only the sum of several is known (entries that say `sum_of`), it stands for them.
    """
    sums = {name: entry for name, entry in parameters.items() if "sum_of" in entry}
    summed = any(_is_undetermined(entry, parameters) for entry in sums.values())
    parts = {part for entry in sums.values() for part in entry["sum_of"]}
    hidden = parts if summed else set(sums)
    shown = {name: entry for name, entry in parameters.items() if name not in hidden}
    texts = _texts(shown)
    text = ", ".join(texts[:_MOST_PARAMETERS]) + (", ..." if len(texts) > _MOST_PARAMETERS else "")
    if not summed:
        return text
    names = list(dict.fromkeys(_owner(part) for part in parameters if part in parts))
    return (
        f"{text} (only the sum is known: how {join_names(names, 'and')} share it is undetermined)"
    )


def _is_undetermined(entry: Mapping[str, Any], parameters: Table) -> bool:
    largest = max(float(parameters[part]["std"]) for part in entry["sum_of"])
    return not largest < _UNDETERMINED * float(entry["std"])


def _owner(parameter: str) -> str:
    """The finger of ``<finger>_<symbol>_<axis>``."""
    return parameter.rsplit("_", 2)[0]


def _texts(parameters: Table) -> list[str]:
    texts, done = [], set[str]()
    for name, entry in parameters.items():
        if name in done:
            continue
        stem, unit = name[:-2], str(entry["unit"])
        group = [f"{stem}_{axis}" for axis in _AXES]
        if name[-2:] == "_x" and all(member in parameters for member in group):
            values = ", ".join(_interval_of(parameters[member]) for member in group)
            texts.append(f"{stem.replace('sum_', 'sum of ')} = ({values}) {unit}".rstrip())
            done.update(group)
        else:
            texts.append(f"{name} = {write_value(entry)}")
    return texts


def write_value(entry: Mapping[str, Any]) -> str:
    """Value and standard deviation with the digits that count, and the unit."""
    return f"{_interval_of(entry)} {entry['unit']}".rstrip()


def _interval_of(entry: Mapping[str, Any]) -> str:
    return write_interval(float(entry["value"]), float(entry["std"]))


def write_interval(value: float, std: float) -> str:
    """``0.41 ± 0.03``: two digits of the standard deviation."""
    if not math.isfinite(std):
        return f"{value:.3g} ± any"
    if not std > 0.0:
        return f"{value:.3g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    if digits > 6 or abs(value) >= 1e5:
        return f"{value:.3g} ± {std:.1g}"
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def write_p_value(p_value: float) -> str:
    """``p = 0.012``; what is smaller than anybody can know is bounded, ``p < 1e-16``."""
    if p_value < _LEAST_P_VALUE:
        return f"p < {_LEAST_P_VALUE:.0e}"
    return f"p = {p_value:.2g}"


def write_fall(before: float, after: float) -> str:
    """What an error does, as a clause: ``falls from 3.10 to 1.02``, or that it does not fall."""
    old, new = f"{before:.2f}", f"{after:.2f}"
    if old == new:
        return f"does not fall: it stays at {old}"
    return f"falls from {old} to {new}" if after < before else f"rises from {old} to {new}"


def capitalise(text: str) -> str:
    """First letter upper case, the rest as it is."""
    return text[:1].upper() + text[1:]


def join_names(names: Sequence[str], word: str = "or") -> str:
    """``a``, ``a or b``, ``a, b or c``, or with another word."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {word} {names[-1]}"


def write_percent(share: float) -> str:
    """Percent without pretending to be exact."""
    return f"{min(99.9, 100.0 * share):.3g} %" if share > 0.99 else f"{100.0 * share:.0f} %"
