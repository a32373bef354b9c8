"""What the benchmark of the live pipeline counts."""

import os
import time

import pytest

from benchmarks.live import Moment, processor_time, summarise


def test_processor_time_counts_work_and_not_sleep():
    before = processor_time(os.getpid())
    time.sleep(0.3)
    slept = processor_time(os.getpid()) - before
    end = time.process_time() + 0.5
    while time.process_time() < end:
        pass
    worked = processor_time(os.getpid()) - before - slept
    assert slept < 0.15
    assert worked == pytest.approx(0.5, abs=0.1)


def test_what_was_used_is_told_per_simulated_second():
    before = Moment(10.0, 100.0, {"robot_sim": 5.0, "recorder": 1.0})
    after = Moment(30.0, 125.0, {"robot_sim": 13.0, "recorder": 3.0})
    result = summarise(before, after, {"/joint_states": 100.0})
    assert result["real_time_factor"] == pytest.approx(0.8)
    assert result["processes"] == {"robot_sim": 0.4, "recorder": 0.1}
    assert result["processor_s_per_simulated_s"] == pytest.approx(0.5)
