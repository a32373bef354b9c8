"""Processes that read mutated files one after the other, watched for time and memory."""

from __future__ import annotations

import multiprocessing
import resource
import shutil
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

import numpy as np

from benchmarks.fuzz.mutations import mutated
from tactile_dynamics_ros.core.errors import TactileDynamicsError

LONGEST = 10.0
"""Processor time in which a file is answered, s: other programs run on the machine too."""
_PATIENCE = 60.0
"""Real time after which a process that does not answer is ended, s: it waits, or has a sixth of a
processor at most."""
_STARTS, _READY = 300.0, "ready"
"""Real time in which a process has to have loaded its libraries, s, and what it says then."""
MOST_MEMORY = 1 << 30
"""Bytes of memory that a case may take beyond what the process holds before it."""
_LIMIT = 3 << 30
"""Bytes of address space beyond that of the loaded libraries: a bomb ends here, not the machine."""

Case = tuple[str, int]
"""Kind of file and number of the case."""


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        kind: of the file. number: of the case.
        end: "read", "refused", "traceback", "hang" or "memory".
        words: the message, or the end of the traceback.
        seconds: of processor time. memory: bytes beyond what the process held before.
    """

    kind: str
    number: int
    end: str
    words: str
    seconds: float
    memory: int


@dataclass
class _Worker:
    process: multiprocessing.process.BaseProcess
    pipe: Connection
    case: Case | None = None
    begun: float = 0.0


def run_cases(cases: Sequence[Case], folder: Path, seed: int, workers: int) -> Iterator[Outcome]:
    """Yield what becomes of each case, in the order in which they end.

    Args:
        cases: to run.
        folder: of the good files, one folder for each kind.
        seed: of the mutations.
        workers: processes at the same time.
    """
    waiting = list(reversed(cases))
    pool = [_start(folder, seed) for _ in range(min(workers, len(cases)))]
    while waiting or any(worker.case for worker in pool):
        for k, worker in enumerate(pool):
            if worker.case is None and waiting:
                worker.case, worker.begun = waiting.pop(), time.monotonic()
                worker.pipe.send(worker.case)
            elif worker.case is not None and (ended := _overdue(worker)):
                yield ended
                pool[k] = _start(folder, seed)
        for pipe in wait([worker.pipe for worker in pool if worker.case], timeout=0.2):
            k = next(k for k, worker in enumerate(pool) if worker.pipe is pipe)
            outcome = _received(pool[k])
            if outcome.end == "memory":
                pool[k] = _start(folder, seed)
            yield outcome
    for worker in pool:
        _end(worker)


def _received(worker: _Worker) -> Outcome:
    assert worker.case is not None
    try:
        outcome: Outcome = worker.pipe.recv()
    except EOFError:
        _end(worker)
        code = worker.process.exitcode
        return Outcome(*worker.case, "memory", f"process ended with {code}", 0.0, _LIMIT)
    worker.case = None
    return outcome


def _overdue(worker: _Worker) -> Outcome | None:
    """End a worker that does not answer; return what is to be said of its case."""
    assert worker.case is not None
    taken = time.monotonic() - worker.begun
    if taken < _PATIENCE:
        return None
    _end(worker)
    return Outcome(*worker.case, "hang", f"no answer within {_PATIENCE:g} s", taken, 0)


def _start(folder: Path, seed: int) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, folder, seed), daemon=True)
    process.start()
    theirs.close()
    worker = _Worker(process, ours)
    if not ours.poll(_STARTS) or ours.recv() != _READY:
        raise RuntimeError("a worker does not start")
    return worker


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    worker.process.kill()
    worker.process.join()


def _serve(pipe: Connection, folder: Path, seed: int) -> None:
    """Run cases until the pipe is closed."""
    from benchmarks.fuzz import kinds  # noqa: F401 - loads all libraries before memory is limited

    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + _LIMIT, held + _LIMIT))
    pipe.send(_READY)
    while True:
        try:
            kind, number = pipe.recv()
        except EOFError:
            return
        pipe.send(run_case(kind, number, folder, seed))


def run_case(kind: str, number: int, folder: Path, seed: int) -> Outcome:
    """Mutate a file and read it.

    Args:
        kind: of the file.
        number: of the case; with the seed it says which file and which mutations.
        folder: of the good files.
        seed: of the mutations.
    """
    from benchmarks.fuzz.kinds import KINDS

    rng = np.random.default_rng([seed, list(KINDS).index(kind), number])
    with tempfile.TemporaryDirectory() as scratch:
        path = put_mutated(folder / kind, Path(scratch) / kind, KINDS[kind].is_text, rng)
        before, began = _peak_anew(), time.process_time()
        end, words = "read", ""
        try:
            KINDS[kind].read(path)
        except TactileDynamicsError as error:
            end, words = "refused", str(error)
        except BaseException:
            end, words = "traceback", traceback.format_exc()
        seconds, memory = time.process_time() - began, _peak() - before
    if memory > MOST_MEMORY:
        end = "memory"
    elif seconds > LONGEST:
        end = "hang"
    return Outcome(kind, number, end, words, seconds, memory)


def put_mutated(good: Path, folder: Path, is_text: bool, rng: np.random.Generator) -> Path:
    """Copy good files and mutate one of them; return it, or the recording that it belongs to.

    Args:
        good: folder of good files.
        folder: new one.
        is_text: whether words and values may be changed too.
        rng: draws the file and the mutations.
    """
    shutil.copytree(good, folder)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    file = files[rng.integers(len(files))]
    file.write_bytes(mutated(file, is_text, rng))
    return file if file.parent == folder or rng.random() < 0.3 else file.parent


def _peak_anew() -> int:
    """Forget the largest memory until now; return what is held, bytes."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _peak() -> int:
    """Return the largest memory that this process held, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
