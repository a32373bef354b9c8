"""Every section of the inertial benchmark runs, and says what its tables and aims need."""

from __future__ import annotations

from benchmarks.inertia import cost, gain, honesty
from benchmarks.inertia.accuracy import _published
from benchmarks.inertia.mujoco_peer import mujoco_is_there
from benchmarks.inertia.peers import PEERS
from benchmarks.inertia.scenarios import table_one
from benchmarks.inertia.tables import render
from benchmarks.inertia.verdicts import judge
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES


def quiet(_: str) -> None:
    """Say nothing."""


def test_everything_published_can_exist_whatever_happens():
    result = honesty.run_feasibility(1, quiet, duration=1.5)
    rows = result["situations"]
    assert {"standing still", "no contacts", "one dead finger"} <= set(rows)
    assert rows["no contacts"]["published"] == 0 < rows["standing still"]["published"]
    assert all(row["published"] == row["feasible"] for row in rows.values())
    assert judge({"feasibility": result})[0][3]


def test_coverage_counts_every_parameter_and_intervals_grow_under_misfit():
    result = honesty.run_coverage(2, 1, 2, 3.0, quiet)
    assert set(result["batch"]) == set(result["live"]) == set(PARAMETER_NAMES)
    assert result["misfit"]["interval_growth_median"]["mass"] > 1.0
    assert "growth under misfit" in render({"coverage": result})


def test_live_cost_is_compared_with_the_alternatives():
    result = cost.run_live(250, 100, quiet)
    assert result["all_feasible"] and result["memory_mib"]["peak"] > 0.0
    assert result["alternatives"]["plain_isam2"]["ms_at_step"]["100"] > 0.0
    text = render({"live": result})
    assert "plain iSAM2" in text and "last over first decile" in text


def test_designed_motion_is_graded_beside_the_fixed_one():
    result = gain.run_excitation(1, 4.0, quiet)
    assert result["expected_distance"]["free"] < result["expected_distance"]["fixed"]
    assert result["gain"]["free"] > 0.0
    assert "| free |" in render({"excitation": result})


def test_the_paper_s_graph_finds_its_own_object_without_noise():
    score = _published(table_one(0.0, 0, duration=4.0), "C, No G")
    assert score.feasible and score.trace_error < 1.0


def test_mujoco_is_a_peer_exactly_where_it_is_installed():
    assert ("MuJoCo sysid" in PEERS) == mujoco_is_there()


def test_missed_aims_are_told():
    result = {
        "cpu_s": {"median": 3.5, "max": 4.0},
        "wall_s": {"median": 3.5, "max": 4.0},
        "recordings": 1,
    }
    assert judge({"batch_time": result})[0][2:] == ("3.5 s", False)
    assert "**no**" in render({"batch_time": result})
    assert judge({}) == []
