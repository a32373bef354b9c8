"""Answers about many recordings: each asked in a process, a table, a page of what stands out."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_dynamics_ros.core.files import written_whole

if TYPE_CHECKING:
    from tactile_dynamics_ros.report.fleet import Fleet
    from tactile_dynamics_ros.report.page import Link

ANSWER = "answer.json"
"""Name of the file that keeps the answer about a recording, beside its report."""

STATUSES = {0: "done", 2: "bad input", 3: "not identified"}
"""What the exit code of a verb means; all others are a crash."""


@dataclass(frozen=True)
class Job:
    """A question about one recording.

    Attributes:
        recording: path of the recording.
        folder: where answer and report go.
        verb: the question.
        options: further arguments of the verb.
        timeout: s after which the recording is given up.
        report: whether a page with figures is made of it too.
    """

    recording: str
    folder: str
    verb: str
    options: tuple[str, ...]
    timeout: float
    report: bool = True

    def identity(self) -> list[Any]:
        """What an answer depends on: the question, and size and age of the recording."""
        files = [Path(self.recording), *sorted(Path(self.recording).rglob("*"))]
        seen = [[file.name, file.stat().st_size, file.stat().st_mtime_ns] for file in files]
        return [self.verb, list(self.options), self.report, seen]

    def forget(self) -> None:
        """Remove the answer of an earlier run."""
        (Path(self.folder) / ANSWER).unlink(missing_ok=True)

    def kept(self) -> Answer | None:
        """The answer of an earlier run to this very question, unless that crashed."""
        try:
            document = json.loads((Path(self.folder) / ANSWER).read_text())
            answer = Answer(**document["answer"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        same = document["identity"] == self.identity() and answer.status in STATUSES.values()
        return answer if same else None


@dataclass(frozen=True)
class Answer:
    """What a verb said about a recording.

    Attributes:
        recording: path of the recording.
        folder: where the report is.
        status: one of `STATUSES`, "crashed" or "too slow".
        seconds: how long it took.
        document: JSON of the verb; empty without an answer.
        message: the last line on stderr where there is no answer.
    """

    recording: str
    folder: str
    status: str
    seconds: float
    document: dict[str, Any]
    message: str = ""

    @property
    def report(self) -> Path | None:
        """The page about the recording, if one was written."""
        page = Path(self.folder) / "report.html"
        return page if page.exists() else None


def ask(job: Job) -> Answer:
    """Ask about one recording in a process of its own, and keep the answer; never raises for it.

    Asked once more, as of a worker that was killed before it handed its answers over, the answer
    that is kept is returned.
    """
    if (answer := job.kept()) is not None:
        return answer
    folder = Path(job.folder)
    folder.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    status, document, message = _run(job)
    seconds = round(time.monotonic() - began, 1)
    answer = Answer(job.recording, job.folder, status, seconds, document, message)
    with written_whole(folder / ANSWER) as part:
        part.write_text(json.dumps({"identity": job.identity(), "answer": asdict(answer)}))
    return answer


def _run(job: Job) -> tuple[str, dict[str, Any], str]:
    """Return status, document and message of the verb."""
    command = [sys.executable, "-P", "-m", "tactile_dynamics_ros.cli.main", job.verb, job.recording]
    command += [*job.options, "--json", *(("--out", job.folder) if job.report else ())]
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=job.timeout,
            env=os.environ | threads,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "too slow", {}, f"no answer within {job.timeout:g} s"
    status = STATUSES.get(done.returncode, "crashed")
    lines = done.stderr.strip().splitlines()
    message = lines[-1].removeprefix("error: ") if lines and status != "done" else ""
    if status == "crashed" and not message:
        message = f"ended with code {done.returncode}"
    try:
        return status, json.loads(done.stdout), message
    except ValueError:
        return ("crashed" if status == "done" else status), {}, message


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
    """Value or std of a number; empty where the recording does not determine it."""

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
"""What the table has of each verb's document."""


TEXTS = ("recording", "robot", "status", "undetermined", "adequate", "verdict", "effect", "group")
TEXTS += ("effects", "message")
"""Columns of words; all others are numbers."""

_UNTESTED = ("mass_std_kg", "friction_force_std_n", "p_value", "noise_floor", "seconds")
"""Columns of numbers in which no drift is looked for: they follow the motion and the machine."""


def columns(verb: str) -> list[str]:
    """Names of the columns of a verb's table."""
    return ["recording", "robot", "status", *_COLUMNS[verb], "seconds", "message"]


def row(verb: str, answer: Answer, robot: str = "") -> list[str]:
    """One recording's cells; those of its document are empty without an answer."""
    said = [_told(cell, answer.document) for cell in _COLUMNS[verb].values()]
    return [answer.recording, robot, answer.status, *said, f"{answer.seconds:.1f}", answer.message]


def robots(answers: Sequence[Answer]) -> list[str]:
    """Whose each recording is: the name of the first folder below the one that holds them all."""
    root = Path(_root(answers))
    below = [Path(answer.recording).relative_to(root).parts for answer in answers]
    return [parts[0] if len(parts) > 1 else root.name for parts in below]


def _fleet(verb: str, rows: Sequence[Sequence[str]], links: Sequence[str | Link]) -> Fleet:
    """Each robot's numbers in the order of its recordings."""
    from tactile_dynamics_ros.report.fleet import Fleet, Track

    header, tracks = columns(verb), []
    for robot in dict.fromkeys(row[1] for row in rows):
        for k, name in enumerate(header):
            if name in TEXTS or name in _UNTESTED:
                continue
            own = [n for n, row in enumerate(rows) if row[1] == robot and row[k]]
            values = np.array([float(rows[n][k]) for n in own])
            if len(own):
                tracks.append(Track(robot, name, tuple(links[n] for n in own), values))
    return Fleet(tracks)


def _told(cell: Callable[[Document], str], document: Document) -> str:
    """A cell of a document; empty where the document is none, or of another model."""
    try:
        return cell(document)
    except (KeyError, TypeError):
        return ""


def write_index(
    verb: str, answers: Sequence[Answer], rows: Sequence[Sequence[str]], folder: Path
) -> Path:
    """Write DIR/report.html: what was said how often, what stands out, a row per recording."""
    from tactile_dynamics_ros.report.page import Link, Page, Section, write_page

    counts = Counter(_kind(answer) for answer in answers)
    said = ", ".join(f"{kind}: {count}" for kind, count in counts.most_common())
    links: list[str | Link] = []
    for name, answer in zip(short_names(answers), answers, strict=True):
        page = answer.report
        target = os.path.relpath(page, folder.resolve()) if page else ""
        links.append(Link(name, target) if page else name)
    listed = [[link, *cells[1:]] for link, cells in zip(links, rows, strict=True)]
    page = Page(
        title=f"{verb} of {len(answers)} recordings",
        verdict=said,
        good=all(answer.document for answer in answers),
        source=_root(answers),
        command=f"tactile-dynamics batch {verb} ...",
        sections=[
            *_fleet(verb, rows, links).sections(),
            Section("Recordings", header=columns(verb), rows=listed),
        ],
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
