"""When a simulated robot waits: a run must not depend on how busy the machine is."""

import itertools

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Header

from tactile_dynamics_ros.ros import pacing
from tactile_dynamics_ros.ros.pacing import DelayLine, Pace, PaceConfig

PERIOD = 0.01
"""Simulated time of a step, s."""


class Machine:
    """Real time that passes only as the test says; stands for the module `time`."""

    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(pacing, "time", self)

    def monotonic(self):
        return self.now


def executed(monkeypatch, lags, stride=1, steps=60):
    """Delay of execution behind its stamp of each command of a controller that answers late.

    Args:
        monkeypatch: of the test.
        lags: real s that answers take, one after the other.
        stride: steps from one pose that is answered to the next.
        steps: answered by commands.
    """
    machine, config = Machine(monkeypatch), PaceConfig()
    pace, targets, answers = Pace(config), DelayLine(), DelayLine()
    lags, time, delays, free = itertools.cycle(lags), 0.0, [], 0.0
    while len(delays) < steps // stride:
        machine.now += 0.002
        for stamp in answers.take(machine.now):
            targets.add(stamp + config.command_latency, stamp)
            pace.note_command(stamp, time)
        if pace.must_wait(time):
            continue
        delays += [time - stamp for stamp in targets.take(time)]
        time += PERIOD
        if round(time / PERIOD) % stride == 0 and time < steps * PERIOD + 1e-6:
            free = max(free, machine.now) + next(lags)  # one after the other
            answers.add(free, time)
    return np.array(delays), pace


@pytest.mark.parametrize("stride", [1, 5])
@pytest.mark.parametrize("lags", [[0.001], [0.03, 0.002, 0.15], [0.06], [0.001, 0.4]])
def test_each_command_is_executed_at_its_time_however_late_a_busy_controller_answers(
    monkeypatch, lags, stride
):
    delays, pace = executed(monkeypatch, lags, stride)
    begun = 20 // stride  # nobody waits for a motion to begin
    np.testing.assert_allclose(delays[begun:], pace._config.command_latency, atol=1e-9)
    assert pace.late <= begun


def test_commands_that_are_waited_for_in_vain_are_counted(monkeypatch):
    assert executed(monkeypatch, [0.03])[1].late == 0
    lags = [0.03] * 20 + [1.5] + [0.03] * 60
    assert executed(monkeypatch, lags)[1].late > 0


def test_a_motion_that_has_ended_holds_the_simulation_up_once(monkeypatch):
    machine, config = Machine(monkeypatch), PaceConfig()
    pace = Pace(config)
    pace.must_wait(0.0)
    for stamp in (0.01, 0.02):
        pace.note_command(stamp, stamp)
    machine.now += 0.9
    assert pace.must_wait(0.06)
    machine.now += 0.2
    assert not pace.must_wait(0.06)
    assert not pace.must_wait(0.2)
    pace.note_command(3.0, 3.1)  # the next motion may begin when it likes
    assert pace.late == 0


def test_simulated_time_does_not_run_ahead_of_an_estimator_that_is_behind(monkeypatch):
    machine, pace, time, heard, lead = Machine(monkeypatch), Pace(PaceConfig()), 0.0, 0.0, []
    for _ in range(2000):  # an estimator that hears half of what happens in real time
        machine.now += PERIOD
        heard = min(heard + 0.5 * PERIOD, time)
        stamp = Time(sec=int(heard), nanosec=int(1e9 * (heard % 1.0)))
        pace.note_estimate(DiagnosticArray(header=Header(stamp=stamp)))
        time += 0.0 if pace.must_wait(time) else PERIOD
        lead.append(time - heard)
    assert pacing.BEHIND - 0.1 < max(lead) < pacing.BEHIND + 2.0 * PERIOD
    machine.now += pacing.GONE
    assert not pace.must_wait(time)  # it has ended


def test_an_estimator_that_repeats_its_status_because_nothing_is_measured_holds_nothing_up(
    monkeypatch,
):
    machine = Machine(monkeypatch)
    pace = Pace(PaceConfig())
    repeated, time = DiagnosticArray(header=Header(stamp=Time(sec=0))), 0.0
    for _ in range(1500):
        machine.now += PERIOD
        pace.note_estimate(repeated)
        time += 0.0 if pace.must_wait(time) else PERIOD
    assert time > 4.0 * pacing.BEHIND


def test_a_command_without_a_stamp_ends_a_motion_and_nothing_is_waited_for(monkeypatch):
    Machine(monkeypatch)
    pace = Pace(PaceConfig())
    pace.note_command(1.0, 1.02)
    assert pace.must_wait(1.2)
    pace.note_command(0.0, 1.2)
    assert not pace.must_wait(1.2)
