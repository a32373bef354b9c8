"""Records of simulations in files: what comes back, and what a stranger's file can do."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.files import read_records, write_records


@dataclass(frozen=True)
class Inner:
    values: np.ndarray
    name: str
    on: bool


@dataclass(frozen=True)
class Outer:
    parts: tuple
    many: list
    number: float
    none: None = None


RECORD = Outer((Inner(np.arange(6.0).reshape(2, 3), "a", True), 3), [np.zeros((0, 3))], 0.1)


def test_records_come_back_as_they_were(tmp_path):
    write_records([RECORD, RECORD], tmp_path / "kept.npz")
    first, again = read_records(tmp_path / "kept.npz", (Outer, Inner))
    assert first.number == again.number == 0.1 and first.none is None
    inner, number = first.parts
    np.testing.assert_array_equal(inner.values, RECORD.parts[0].values)
    assert (inner.name, inner.on, number) == ("a", True, 3)
    assert first.many[0].shape == (0, 3)


def test_nothing_in_a_file_is_run_and_no_other_kind_is_made(tmp_path):
    ran = []

    class Planted:
        def __reduce__(self):
            return (ran.append, (1,))

    (tmp_path / "old.npz").write_bytes(pickle.dumps([Planted()]))
    with pytest.raises(BadInputError, match="expected records of a simulation"):
        read_records(tmp_path / "old.npz", (Outer, Inner))
    np.savez(tmp_path / "objects.npz", tree=np.array([Planted()], dtype=object))
    with pytest.raises(BadInputError, match="allow_pickle=False"):
        read_records(tmp_path / "objects.npz", (Outer, Inner))
    write_records([RECORD], tmp_path / "kept.npz")
    with pytest.raises(BadInputError, match="Inner"):
        read_records(tmp_path / "kept.npz", (Outer,))
    assert ran == []
