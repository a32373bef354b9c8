"""Answers about many recordings as a table and as a page that links their reports."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.cli.batch_jobs import Answer

Document = Mapping[str, Any]


def _number(value: Any) -> str:
    """A number in four digits; empty for none."""
    return "" if value is None else f"{value:#.4g}"


def _error(name: str) -> Callable[[Document], str]:
    return lambda document: _number(document["error"][name])


def _names(name: str) -> Callable[[Document], str]:
    return lambda document: " ".join(document[name])


def _body(document: Document) -> Document:
    """The held body, the pushed part, or, of two parts, what is known of both together."""
    if document.get("model") != "pushed":
        return document
    links = document["links"]
    whole: Document = document["whole"] if len(links) > 1 else links[0]
    return whole


def _value(name: str, key: str) -> Callable[[Document], str]:
    """Value or std of a number; empty where the recording does not tell it."""

    def cell(document: Document) -> str:
        unknown = name in document["undetermined"]
        return "" if unknown else _number(_body(document)[name][key])

    return cell


def _centre(axis: int) -> Callable[[Document], str]:
    """A coordinate of the centre of mass, likewise."""

    def cell(document: Document) -> str:
        unknown = {"com", f"com_{'xyz'[axis]}"} & set(document["undetermined"])
        values = _body(document)["com"]["value"]
        return _number(values[axis]) if axis < len(values) and not unknown else ""

    return cell


def _estimate_error(document: Document) -> str:
    error = document["error"]
    return _number(error if document.get("model") == "pushed" else error["whitened_rms"])


_COLUMNS: dict[str, dict[str, Callable[[Document], str]]] = {
    "estimate": {
        "mass_kg": _value("mass", "value"),
        "mass_std_kg": _value("mass", "std"),
        **{f"com_{axis}_m": _centre(k) for k, axis in enumerate("xyz")},
        "friction_force_n": _value("friction_force_n", "value"),
        "friction_force_std_n": _value("friction_force_n", "std"),
        "undetermined": _names("undetermined"),
        "error": _estimate_error,
    },
    "compare": {
        "adequate": lambda d: "yes" if d["adequate"] else "no",
        "error": _error("whitened_rms"),
        "p_value": lambda d: _number(d["p_value"]),
    },
    "diagnose": {
        "verdict": lambda d: d["verdict"],
        "effect": lambda d: d["effect"] or (d.get("convention") or {}).get("name") or "",
        "group": _names("group"),
        "error_before": _error("before"),
        "error_after": _error("after"),
        "noise_floor": _error("noise_floor"),
    },
    "explain": {
        "verdict": lambda d: d["verdict"],
        "effects": _names("effects"),
        "error_before": _error("before"),
        "error_after": _error("after"),
        "noise_floor": _error("noise_floor"),
    },
}
"""What the table tells of each verb's document."""


def columns(verb: str) -> list[str]:
    """Names of the columns of a verb's table."""
    return ["recording", "status", *_COLUMNS[verb], "seconds", "message"]


def row(verb: str, answer: Answer) -> list[str]:
    """One recording's cells; those of its document are empty without an answer."""
    said = [_told(cell, answer.document) for cell in _COLUMNS[verb].values()]
    return [answer.recording, answer.status, *said, f"{answer.seconds:.1f}", answer.message]


def _told(cell: Callable[[Document], str], document: Document) -> str:
    """A cell of a document; empty where the document is none, or of another model."""
    try:
        return cell(document)
    except (KeyError, TypeError):
        return ""


def write_index(verb: str, answers: Sequence[Answer], folder: Path) -> Path:
    """Write DIR/report.html: what was said how often, and a row with a link per recording."""
    from tactile_dynamics_ros.report.page import Link, Page, Section, write_page

    counts = Counter(_kind(answer) for answer in answers)
    said = ", ".join(f"{kind}: {count}" for kind, count in counts.most_common())
    rows: list[list[str | Link]] = []
    for name, answer in zip(short_names(answers), answers, strict=True):
        page = answer.report
        target = os.path.relpath(page, folder.resolve()) if page else ""
        rows.append([Link(name, target) if page else name, *row(verb, answer)[1:]])
    page = Page(
        title=f"{verb} of {len(answers)} recordings",
        verdict=said,
        good=all(answer.document for answer in answers),
        source=_root(answers),
        command=f"tactile-dynamics batch {verb} ...",
        sections=[Section("Recordings", header=columns(verb), rows=rows)],
    )
    return write_page(page, folder)


def short_names(answers: Sequence[Answer]) -> list[str]:
    """Paths of the recordings below the folder that holds them all."""
    root = _root(answers)
    return [os.path.relpath(answer.recording, root) for answer in answers]


def _root(answers: Sequence[Answer]) -> str:
    return os.path.commonpath([os.path.dirname(answer.recording) for answer in answers])


def _kind(answer: Answer) -> str:
    """In a word, what was said: the effect where one is named, else the verdict or status."""
    document = answer.document
    named = document.get("effect") or " + ".join(document.get("effects") or []) if document else ""
    return str(named or document.get("verdict") or answer.status)
