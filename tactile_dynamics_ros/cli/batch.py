"""`tactile-dynamics batch VERB 'GLOB'`: many recordings, one table, one page of reports."""

from __future__ import annotations

import csv
import glob
import json
import os
import sys
from argparse import Namespace, _SubParsersAction
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tactile_dynamics_ros.cli.batch_table import (
    TEXTS,
    Answer,
    Job,
    ask,
    columns,
    robots,
    row,
    short_names,
    write_index,
)
from tactile_dynamics_ros.cli.recordings import add_recording_arguments
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError, require_extra
from tactile_dynamics_ros.core.files import written_whole
from tactile_dynamics_ros.core.options import COUNT, POSITIVE, folder_to_write

VERBS = ("estimate", "compare", "diagnose", "explain")
"""Verbs that ask about one recording."""

_TIMEOUT = 1800.0
"""Time for one recording, s, after which it is given up: far above the longest answer that was
measured (38 s for half an hour of data). A shorter one gives up on recordings of many hours."""

_WIDEST = 50
"""Letters of a cell that are printed, so that lines stay readable; the CSV has all."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("batch")
    parser.add_argument("question", choices=VERBS, metavar="VERB", help=", ".join(VERBS))
    add_recording_arguments(parser)
    parser.add_argument(
        "--out",
        type=folder_to_write,
        required=True,
        metavar="DIR",
        help="where table and reports go",
    )
    parser.add_argument(
        "--workers",
        type=COUNT,
        default=os.cpu_count() or 1,
        metavar="N",
        help="recordings at a time on this machine (default: one per core)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask cluster that sees the same files, as tcp://host:8786 (extra `fleet`)",
    )
    parser.add_argument(
        "--no-reports", action="store_true", help="only the tables: half the time, little storage"
    )
    parser.add_argument(
        "--timeout", type=POSITIVE, default=_TIMEOUT, metavar="S", help="per recording"
    )
    parser.add_argument("--again", action="store_true", help="ask again what is answered already")
    parser.set_defaults(run=run)


def run(args: Namespace) -> int:
    """Ask about all recordings; what is answered already is not asked again.

    Raises:
        BadInputError: no recording is there, or the cluster cannot be reached.
        NotIdentifiableError: some recordings have no answer.
    """
    out, jobs = Path(args.out), make_jobs(args)
    if args.again:
        for job in jobs:
            job.forget()
    kept = {job: answer for job in jobs if (answer := job.kept())}
    fresh = [job for job in jobs if job not in kept]
    if kept:
        print(f"note: {len(kept)} of {len(jobs)} are answered already", file=sys.stderr)
    asked = {}
    if fresh:
        with _executor(args.scheduler, min(args.workers, len(fresh))) as executor:
            asked = _ask_all(executor, fresh)
    answers = [kept.get(job) or asked[job] for job in jobs]
    header = columns(args.question)
    pairs = zip(answers, robots(answers), strict=True)
    rows = [row(args.question, answer, robot) for answer, robot in pairs]
    tables = list(_write_tables(out, header, rows))
    page = write_index(args.question, answers, rows, out)
    _show(args, answers, header, rows)
    print(f"table: {' '.join(map(str, tables))}\nreports: {page}", file=sys.stderr)
    without = sum(not answer.document for answer in answers)
    if without:
        raise NotIdentifiableError(
            f"{without} of {len(answers)} recordings have no answer; the table says why"
        )
    return 0


def make_jobs(args: Namespace) -> list[Job]:
    """Return a job for each recording that the patterns match.

    Raises:
        BadInputError: nothing matches.
    """
    found = [path for pattern in args.bag for path in sorted(glob.glob(pattern, recursive=True))]
    recordings = list(dict.fromkeys(Path(path).resolve() for path in found))
    if not recordings:
        raise BadInputError(f"no recording matches {' '.join(args.bag)}")
    root = Path(os.path.commonpath([recording.parent for recording in recordings]))
    out = Path(args.out).resolve()
    options = tuple(_forwarded(args))
    return [
        Job(
            str(recording),
            str(out / "reports" / recording.relative_to(root)),
            args.question,
            options,
            args.timeout,
            not args.no_reports,
        )
        for recording in recordings
    ]


def _forwarded(args: Namespace) -> Iterator[str]:
    """Yield the options of the verb itself, as they are typed."""
    if args.between:
        yield from ("--between", ",".join(map(repr, args.between)))
    for name in ("effects", "world_frame", "namespace", "stamps", "urdf"):
        if value := getattr(args, name):
            yield from (f"--{name.replace('_', '-')}", value)
    for name in ("effect_file", "remap", "assume"):
        for value in getattr(args, name):
            yield from (f"--{name.replace('_', '-')}", value)


@contextmanager
def _executor(scheduler: str | None, workers: int) -> Iterator[Executor]:
    """A Dask cluster, of this machine if no other is named; threads for one worker or without Dask.

    Either waits for a process per recording. Dask starts a killed worker anew and asks again.

    Raises:
        BadInputError: the cluster cannot be reached, or its library is missing.
    """
    if scheduler is None and (workers == 1 or find_spec("distributed") is None):
        with ThreadPoolExecutor(workers) as threads:
            yield threads
        return
    require_extra("distributed", "fleet", "--scheduler")
    from distributed import Client, LocalCluster

    with ExitStack() as stack:
        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
        try:
            at = scheduler or stack.enter_context(LocalCluster(**options)).scheduler_address
            client = stack.enter_context(Client(at, timeout="10s"))
        except (OSError, ValueError, RuntimeError) as error:
            where = f"--scheduler {scheduler}" if scheduler else f"--workers {workers}"
            raise BadInputError(f"{where}: no Dask scheduler answers ({error})") from error
        yield stack.enter_context(client.get_executor(pure=False))


def _ask_all(executor: Executor, jobs: Sequence[Job]) -> dict[Job, Answer]:
    """Ask about all recordings and print on stderr how far it is."""
    futures = {executor.submit(ask, job): job for job in jobs}
    answers: dict[Job, Answer] = {}
    try:
        for future in as_completed(futures):
            job = futures[future]
            try:
                answers[job] = future.result()
            except Exception as error:  # not of `ask`: the worker or the cluster is gone
                said = f"its worker was lost: {error}"
                answers[job] = Answer(job.recording, job.folder, "crashed", 0.0, {}, said)
            _tell(len(answers), len(jobs), answers[job])
    finally:
        for future in futures:
            future.cancel()
    return answers


def _tell(count: int, total: int, answer: Answer) -> None:
    """Print one line about a recording that is done."""
    said = answer.message if not answer.document else answer.document.get("verdict", "")
    line = f"{count}/{total} {answer.recording}: {answer.status} {said} ({answer.seconds:.0f} s)"
    print(" ".join(line.split()), file=sys.stderr, flush=True)


def _write_tables(
    folder: Path, header: Sequence[str], rows: Sequence[Sequence[str]]
) -> Iterator[Path]:
    """Write the table as CSV and, where its library is installed, as Parquet; yield the files."""
    with (
        written_whole(folder / "table.csv") as part,
        part.open("w", newline="", encoding="utf-8") as stream,
    ):
        csv.writer(stream).writerows([header, *rows])
    yield folder / "table.csv"
    if find_spec("pyarrow") is None:
        return
    import pyarrow
    from pyarrow import parquet

    arrays = {}
    for name, cells in zip(header, zip(*rows, strict=True), strict=True):
        if name in TEXTS:
            arrays[name] = pyarrow.array(cells, pyarrow.string())
        else:
            numbers = [float(cell) if cell else None for cell in cells]
            arrays[name] = pyarrow.array(numbers, pyarrow.float64())
    with written_whole(folder / "table.parquet") as part:
        parquet.write_table(pyarrow.table(arrays), part)
    yield folder / "table.parquet"


def _show(
    args: Namespace,
    answers: Sequence[Answer],
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
) -> None:
    """Print the table, or all documents as JSON."""
    if args.json:
        documents = [
            {
                "recording": answer.recording,
                "status": answer.status,
                "seconds": answer.seconds,
                "message": answer.message,
                args.question: answer.document or None,
            }
            for answer in answers
        ]
        print(json.dumps(documents))
        return
    from tactile_dynamics_ros.api.result import align_rows

    cells = [[name, *others] for name, (_, *others) in zip(short_names(answers), rows, strict=True)]
    print(align_rows([header, *[[cell[:_WIDEST] for cell in line] for line in cells]], indent=0))
