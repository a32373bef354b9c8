"""Answers of all verbs as documents, and how two of them differ."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import tactile_dynamics_ros as td
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.pushed import PushedRecording

VERBS = ("estimate", "check", "compare", "diagnose", "explain")
_LEFT_OUT = (
    *("covariance", "pseudo_inertia_eigenvalues", "streams", "dynamic_parameters"),
    "advice",
)
"""Entries that follow from the others, or from the recording alone."""
_SHOWN = 3
"""Candidates that are kept: those that are printed first. Of the others the order is chance."""
_DIGITS = 6
"""Digits that are kept of numbers."""
_SHARE, _OF_STD = 2e-3, 0.05
"""Differences that are none: of a number, over itself, and of a value, over its standard deviation.
Fits end when the next step is worth less; other processors round otherwise."""
_UNCERTAIN = ("p_value", "score")
"""Entries that rounding moves more than others: only their order of magnitude is compared."""
_NUMBER = re.compile(r"-?\d[\d.,]*(e[+-]?\d+)?")


def answer(
    recording: Recording | PushedRecording, verbs: tuple[str, ...] = VERBS
) -> dict[str, Any]:
    """Ask the verbs; what is refused answers with the sentence."""
    found: dict[str, Any] = {}
    for verb in verbs:
        try:
            found[verb] = _kept(getattr(td, verb)(recording).to_json())
        except TactileDynamicsError as error:
            found[verb] = {"refused": str(error)}
    return found


def differences(before: Any, after: Any, place: str = "") -> Iterator[str]:
    """Yield a line for every difference between two documents beyond what rounding makes."""
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before.keys() | after.keys():
            there = f"{place}.{name}"
            if name not in before or name not in after:
                yield f"{there}: {'new' if name in after else 'gone'}"
            elif name == "value" and "std" in before and "std" in after:
                yield from _moved(before[name], after[name], before["std"], there)
            else:
                yield from differences(before[name], after[name], there)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{place}: {len(before)} entries -> {len(after)}"
            return
        for k, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from differences(one, other, f"{place}[{k}]")
    elif not _same(before, after, place):
        yield f"{place}: {before!r} -> {after!r}"


def _moved(before: Any, after: Any, std: Any, place: str) -> Iterator[str]:
    """Differences of a value, or a list of them, beyond a share of its standard deviation."""
    if isinstance(before, list) and isinstance(after, list) and isinstance(std, list):
        for k, parts in enumerate(zip(before, after, std, strict=True)):
            yield from _moved(*parts, f"{place}[{k}]")
    elif not _same(before, after, place) and not (
        std is not None and abs(after - before) <= _OF_STD * std
    ):
        yield f"{place}: {before!r} -> {after!r}, std {std!r}"


def _same(before: Any, after: Any, place: str) -> bool:
    if isinstance(before, bool) or isinstance(after, bool):
        return before is after
    if isinstance(before, int | float) and isinstance(after, int | float):
        if place.endswith(_UNCERTAIN):
            return max(before, after) < 1e-3 or 0.5 < before / max(after, 1e-300) < 2.0
        return abs(after - before) <= _SHARE * max(abs(before), abs(after))
    if isinstance(before, str) and isinstance(after, str):
        return _NUMBER.sub("#", before) == _NUMBER.sub("#", after)
    return bool(before == after)


def _kept(document: Any, name: str = "") -> Any:
    """A document with few digits, without what follows from the rest."""
    if isinstance(document, dict):
        return {
            str(key): _kept(value, str(key))
            for key, value in document.items()
            if key not in _LEFT_OUT
        }
    if isinstance(document, list | tuple):
        shown = document[:_SHOWN] if name == "candidates" else document
        return [_kept(one) for one in shown]
    if isinstance(document, float):
        return float(f"{document:.{_DIGITS}g}")
    return document
