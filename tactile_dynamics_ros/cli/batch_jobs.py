"""One recording of many: asked in a process of its own, its answer kept in a file."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.core.files import written_whole

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
    """

    recording: str
    folder: str
    verb: str
    options: tuple[str, ...]
    timeout: float

    def identity(self) -> list[Any]:
        """What an answer depends on: the question, and size and age of the recording."""
        files = [Path(self.recording), *sorted(Path(self.recording).rglob("*"))]
        seen = [[file.name, file.stat().st_size, file.stat().st_mtime_ns] for file in files]
        return [self.verb, list(self.options), seen]

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
    """Ask about one recording in a process of its own, and keep the answer; never raises for it."""
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
    command += [*job.options, "--json", "--out", job.folder]
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
