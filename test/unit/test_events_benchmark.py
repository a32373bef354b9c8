"""Benchmark of events: what counts as right, and its table."""

from benchmarks.events import Outcome, table


def test_an_event_is_right_by_name_and_time_and_others_by_none():
    found = [
        Outcome("grasp_shift", 1, "grasp_shift", "grasp_shift", "grasp_shift", 0.02, 1.5),
        Outcome("grasp_shift", 2, "grasp_shift", "grasp_shift", "grasp_shift", 0.3, 1.5),
        Outcome("grasp_shift", 3, "grasp_shift", "hanging_cable", "", 0.0),
        Outcome("clean", 1, "", "adequate", ""),
        Outcome("clean", 2, "", "sensor_zeroed", "sensor_zeroed"),
    ]
    assert [o.right for o in found] == [True, False, False, True, False]
    rows = [line.split(" | ") for line in table(found)[2:]]
    assert rows[0][1:3] == ["3", "1"]
    assert rows[0][3] == "grasp_shift, hanging_cable"
    assert rows[1][1:4] == ["2", "1", "sensor_zeroed"]
