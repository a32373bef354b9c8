"""The benchmarks of changes: runs that were cut go on; delays of statistic, bound and peer."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.explore import detection, quiet


def test_a_run_that_was_cut_goes_on_where_it_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(quiet, "TOUCH", 0.5)
    options = SimpleNamespace(
        quick=False, quiet_hours=1.0 / 3600.0, quiet_spreads=[0.1], quiet_rows=tmp_path / "rows"
    )
    whole = quiet.measure(options)["rows"]
    lines = options.quiet_rows.read_text().splitlines()
    assert len(lines) == len(whole) == 2
    options.quiet_rows.write_text(lines[0] + "\n")
    assert quiet.measure(options)["rows"] == whole
    monkeypatch.setattr(quiet, "_row", None)  # nothing is left to be made
    assert "| 0.1 | 2 |" in quiet.table(quiet.measure(options))


def row():
    """Four clean pieces, then four on a table that pulls with 0.5 N across the pushes."""
    rng, noise = np.random.default_rng(3), 0.05
    pieces = [
        [0.3 * k, 3.0 * noise * rng.standard_normal(), pull, 3.0, 0.0]
        for k, pull in enumerate([0.0, 0.1, -0.1, 0.0, -0.5, -0.5, -0.5, -0.5], 1)
    ]
    told = [[0.3 * k, value] for k, value in enumerate([2.0, 3.0, 1.0, 2.0, 9.0, 30.0], 1)]
    logs = np.concatenate([np.full(120, -1.0), np.full(150, -1.5)])
    return {
        "clean_s": 1.2, "clean_told": 4, "clean_pieces": 4, "clean_logs": 120, "told": told,
        "pieces": pieces, "newtons": 3.0, "lean_n": [0.0, 0.5], "logs": logs.tolist(),
    }  # fmt: skip


def test_delays_are_counted_in_touch_since_the_change():
    case = row()
    assert detection.delay(case) == pytest.approx(0.6)
    noise = np.diag(np.square([0.05, 0.05]))
    # 0.5 N of 3 N are 3.3 standard deviations: 5.6 nats each, and ln of 18000 are 9.8
    assert detection.bound_delay(case, noise) == pytest.approx(0.6)
    assert detection.bound_delay(case, 100.0 * noise) is None
    least = detection.least_clean([case])
    assert least == pytest.approx(np.exp(-1.0))
    assert detection.peer_delay(case, 0.999 * least) == pytest.approx(0.01, abs=0.011)
    assert detection.peer_delay(case, 0.5 * least) is None
