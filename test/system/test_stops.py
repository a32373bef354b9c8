"""A node ends within 3 s of one signal in every state, with its file, and leaves no process."""

import pytest

from benchmarks.stops import STATES, run_state


@pytest.mark.timeout(280)
@pytest.mark.parametrize("state", STATES)
def test_a_node_ends_in_time_with_its_file_and_leaves_nothing(state, tmp_path):
    stops = run_state(state, 2 if state == "moving" else 1, tmp_path)
    assert [stop for stop in stops if not stop.ok] == []
