"""Faults of topics, clocks, sensors, calls and arguments, one at a time, on real processes."""

import os

import pytest

from benchmarks.replay.faults import run_fault
from benchmarks.replay.player import NODES, replay
from benchmarks.replay.rig import Rig

SPEED = float(os.environ.get("REPLAY_SPEED", "1"))
"""The replay waits for nodes that do not keep up."""
SECONDS, LEAD, RECOVERY = 1.5, 5.0, 4.0
SHORT = ("force_1e10", "pose_1e8", "frame_ahead_1h", "finger_stuck", "invalid_utf8", "short_cdr")
"""Faults of streams that the suite injects; all of them are rows of `./dev bench faults`."""
COMMANDS = ("set_effects_5", "set_effects_twice", "100_resets", "sigterm_echo")
"""Of each fault, of clean data where a fault before left something behind, and after each, s."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Nodes that go on from fault to fault; what is spoilt is made good before the next one."""
    with replay(NODES, logs=tmp_path_factory.mktemp("logs")) as player:
        yield Rig(player, SPEED, LEAD, SECONDS, fresh=False, recovery=RECOVERY)


@pytest.mark.parametrize("name", [*SHORT, *COMMANDS])
def test_fault_is_survived_said_and_overcome(rig, name):
    row = run_fault(rig, name)
    assert not row.failures, row
