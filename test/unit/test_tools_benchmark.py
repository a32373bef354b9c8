"""The benchmark of tools: its reading of the data, and peers that do what they say."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.inertia.scores import Score
from benchmarks.peers.with_shape import Rows, entropic, homogeneous_parts, least_squares
from benchmarks.tools.__main__ import Outcome, main, outcomes, summarise
from benchmarks.tools.data import DATA, LEVELS, read_case
from tactile_dynamics_ros.core.inertia.shape_prior import point_masses
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    is_feasible,
)

needs_tools = pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not on this machine")


@pytest.fixture
def rows():
    rng = np.random.default_rng(4)
    points = rng.uniform([-0.02, -0.02, 0.0], [0.02, 0.02, 0.2], (400, 3))
    dense = points[:, 2] > 0.15
    weight = np.where(dense, 8.0, 1.0)
    phi = 0.5 * (weight @ point_masses(points)) / weight.sum()
    motion = tuple(rng.normal(size=(3, 500, 3)) * np.array([10.0, 2.0, 10.0])[:, None, None])
    exact = Rows.of(motion, np.zeros((500, 6)), (1e-3, 1e-2))
    return Rows(exact.root, exact.root @ phi), phi, points


def test_peers_find_a_body_of_which_the_data_tell_all(rows):
    given, phi, points = rows
    assert_allclose(least_squares(given), phi, rtol=1e-6, atol=1e-9)
    guess = 0.4 * point_masses(points).mean(axis=0)
    assert_allclose(entropic(given, guess, 1e-6), phi, atol=2e-3 * np.abs(phi).max())
    assert is_feasible(entropic(given, guess, 1.0))
    assert_allclose(homogeneous_parts(given, points)[:4], phi[:4], rtol=0.03, atol=1e-4)


def test_the_divergence_holds_what_the_data_do_not_tell(rows):
    given, phi, points = rows
    guess = phi[0] * point_masses(points).mean(axis=0)
    blind = Rows(given.root * np.append(1.0, np.full(9, 1e-9)), given.target * 0.0)
    blind.target[0] = blind.root[0] @ phi
    assert_allclose(entropic(blind, guess, 1.0), guess, rtol=0.05, atol=1e-6)


def test_a_summary_takes_the_best_weight_of_the_divergence():
    truth = InertialParameters(0.5, np.zeros(3), 1e-4 * np.eye(3))
    worse = InertialParameters(0.9, np.zeros(3), 3e-4 * np.eye(3))
    phi = {"GEO 1": worse, "GEO 10": truth, "with shape": truth}
    found = [
        Outcome("low", "file", 1, name, Score.of(truth, body.dynamic_parameters, 0.0))
        for name, body in phi.items()
    ]
    summary = {row["method"]: row for row in summarise(found)}
    assert set(summary) == {"GEO", "with shape"}
    assert summary["GEO"]["weight"] == 10.0
    assert summary["GEO"]["distance"] == pytest.approx(0.0, abs=1e-6)


@needs_tools
@pytest.mark.parametrize("name", ["Hammer", "C_Clamp"])
def test_their_wrench_is_that_of_the_truth_in_a_world_whose_z_is_down(name, monkeypatch):
    monkeypatch.setitem(LEVELS, "low", (1e-4, 1e-3, 1e-4, 1e-5))
    case = read_case(DATA, name, "low", 0)
    phi = least_squares(case.given)
    assert_allclose(phi[:4], case.truth.dynamic_parameters[:4], rtol=2e-3, atol=2e-4)
    low, high = case.points.min(axis=0), case.points.max(axis=0)
    assert np.all((low < case.truth.com) & (case.truth.com < high))


@needs_tools
def test_noise_of_poses_is_that_of_the_accelerations(monkeypatch):
    level = LEVELS["moderate"]
    quiet, noisy = (
        read_case(DATA, "Hammer", name, 3).recording.streams.pose for name in ("low", "moderate")
    )
    scale = np.std(noisy.position - quiet.position, axis=0)
    assert_allclose(scale, scale.mean(), rtol=0.15)
    times = np.arange(-12, 13) * 0.01
    gain = 2.0 * np.linalg.norm(np.linalg.pinv(np.vander(times, 5))[-3])
    # the same draw at half the size: the difference is half of the noise
    assert_allclose(2.0 * scale.mean() * gain, level[0], rtol=0.1)


@needs_tools
def test_a_tool_is_known_better_with_its_shape_than_by_any_peer():
    found = list(outcomes(DATA, ["Allen_Key"], ["moderate"], range(1)))
    summary = {row["method"]: row for row in summarise(found)}
    shaped = summary.pop("with shape")
    assert shaped["distance"] < min(row["distance"] for row in summary.values())
    assert shaped["worst_std"] < 4.0


def test_the_benchmark_prints_tables_without_the_data(tmp_path, capsys):
    page = tmp_path / "page.md"
    assert main(["--data", str(tmp_path), "--bodies", "1", "--write", str(page)]) == 0
    assert "no tools" in capsys.readouterr().err
    assert "| hollow | 1 |" in page.read_text()
