"""Files of every kind, good and mutated: read or refused in one line, never a traceback."""

import numpy as np
import pytest

from benchmarks.fuzz.__main__ import describe, summary
from benchmarks.fuzz.kinds import KINDS
from benchmarks.fuzz.mutations import mutated
from benchmarks.fuzz.workers import Outcome, run_case

CASES = 4
"""Mutated files of each kind: a second of reading together; `./dev bench fuzz` tries thousands."""


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Good files, one folder for each kind."""
    folder = tmp_path_factory.mktemp("seeds")
    paths = {}
    for name, kind in KINDS.items():
        (folder / name).mkdir()
        paths[name] = kind.seeds(folder / name)
    return folder, paths


@pytest.mark.parametrize("kind", KINDS)
def test_mutated_files_are_read_or_refused(seeds, kind):
    found = [run_case(kind, number, seeds[0], 1) for number in range(CASES)]
    failed = [one for one in found if one.end not in ("read", "refused")]
    assert failed == [], "\n".join(one.words for one in failed)


@pytest.mark.parametrize("kind", KINDS)
def test_good_files_are_read(seeds, kind):
    """Else their mutations would all be refused for one reason."""
    for path in seeds[1][kind]:
        whole = path.parent if (path.parent / "metadata.yaml").exists() else path
        KINDS[kind].read(whole)


def test_a_case_is_the_same_each_time(seeds):
    path = seeds[1]["effects"][0]
    first, again = (mutated(path, True, np.random.default_rng([0, 3, 5])) for _ in range(2))
    assert first == again != path.read_bytes()


def test_what_fails_is_counted_and_can_be_run_again():
    outcomes = [
        Outcome("bags", 3, "traceback", "ValueError: x", 0.1, 10),
        Outcome("bags", 4, "read", "", 0.2, 20_000_000),
    ]
    found = summary(outcomes)
    assert (found["cases"], found["ends"]) == (2, {"traceback": 1, "read": 1})
    assert "--only bags:3  traceback: ValueError: x" in describe(found)
    assert "most memory 20 MB" in describe(found)
