"""Files of interrupted benchmarks: made once, and read only where nobody else could write them."""

from operator import itemgetter

import pytest

from benchmarks.kept import continued, kept, read_rows
from tactile_dynamics_ros.core.errors import BadInputError


def test_a_result_is_made_once(tmp_path):
    made = []
    path = tmp_path / "new" / "result.pickle"
    for _ in range(2):
        assert kept(path, lambda: made.append(1) or [3.0]) == [3.0]
    assert len(made) == 1
    assert path.stat().st_mode & 0o077 == 0


def test_a_file_that_others_could_have_written_is_refused(tmp_path):
    path = tmp_path / "result.pickle"
    kept(path, lambda: 1)
    path.chmod(0o666)
    with pytest.raises(BadInputError, match="others could have written"):
        kept(path, lambda: 2)


def test_a_run_that_was_cut_off_asks_only_for_what_is_missing(tmp_path):
    path = tmp_path / "rows.jsonl"
    path.write_text('{"key": "b", "value": 1}\n{"key": "c", "val')
    asked = []

    def answer(missing):
        for k in missing:
            asked.append(k)
            yield {"key": "abc"[k], "value": 10 + k}

    path.write_text(path.read_text() + "\n")
    found = continued(path, list("abc"), itemgetter("key"), answer)
    assert asked == [0, 2]
    assert [row["value"] for row in found] == [10, 1, 12]
    assert [row["key"] for row in read_rows(path)] == ["b", "a", "c"]
