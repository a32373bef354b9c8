"""Files of interrupted benchmarks: made once, and read only where nobody else could write them."""

import pytest

from benchmarks.kept import kept
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
