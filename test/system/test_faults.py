"""Faults of topics, clocks, sensors, calls and arguments, one at a time, on real processes."""

import os

import pytest

from benchmarks.replay.faults import CLEAN, NAMES, run_clean, run_fault
from benchmarks.replay.player import NODES, replay
from benchmarks.replay.rig import Rig

SPEED = float(os.environ.get("REPLAY_SPEED", "4"))
"""The replay waits for nodes that do not keep up."""
SECONDS, LEAD, RECOVERY = 1.5, 5.0, 4.0
"""Of each fault, of clean data where a fault before left something behind, and after each, s."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Nodes that go on from fault to fault; what is spoilt is made good before the next one."""
    with replay(NODES, logs=tmp_path_factory.mktemp("logs")) as player:
        yield Rig(player, SPEED, LEAD, SECONDS, fresh=False, recovery=RECOVERY)


def test_clean_data_are_estimated_without_a_word_of_fault(rig):
    row = run_clean(rig)
    assert not row.failures, row


@pytest.mark.parametrize("name", [name for name in NAMES if name != CLEAN])
def test_fault_is_survived_said_and_overcome(rig, name):
    row = run_fault(rig, name)
    assert not row.failures, row
