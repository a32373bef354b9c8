"""The shape as prior: volumes, densities, what data decide, and bodies that fit inside."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from benchmarks.support.live_replay import replay_streams
from benchmarks.tools.bodies import filled, judge, mesh_of
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.inertia.live import IncrementalInertialEstimator
from tactile_dynamics_ros.core.inertia.live.live_estimate import Level, judge_estimate
from tactile_dynamics_ros.core.inertia.shape_prior import (
    ShapePrior,
    coordinates,
    point_masses,
)
from tactile_dynamics_ros.core.inertia.shape_weighing import (
    Seen,
    nearest_density,
    weigh,
    with_shape,
)
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    dynamic_parameters_from_log_cholesky,
    is_feasible,
    log_cholesky,
)
from tactile_dynamics_ros.core.rigid_body.rotation import pose_of
from tactile_dynamics_ros.core.shape.object_shape import BoxSurface, MeshSurface, ObjectShape
from tactile_dynamics_ros.core.shape.solid import Solid
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.shape_files import read_solid
from tactile_dynamics_ros.synthetic.objects import HeldObject
from tactile_dynamics_ros.synthetic.recordings import generate, write_bag
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions

SIZE = np.array([0.06, 0.08, 0.12])
BOX = HeldObject("box", SIZE, 0.4, np.zeros(3), np.eye(3))


@pytest.fixture(scope="module")
def prior() -> ShapePrior:
    return ShapePrior(Solid.of_shape(ObjectShape([MeshSurface(mesh_of(BOX))]), "box"))


def as_seen(kind: str, std: float, shift: np.ndarray | None = None) -> tuple[Seen, np.ndarray]:
    """Data that know each parameter of a filled box to a share of those of the even one."""
    body = filled(BOX, kind, np.random.default_rng(1))
    truth = InertialParameters(body.mass, body.com, body.inertia_com).dynamic_parameters
    units = body.mass * np.concatenate([[1.0], np.full(3, 0.04), np.full(6, 0.04**2)])
    shift = np.zeros(10) if shift is None else shift
    return Seen(truth + std * units * shift, np.diag(1.0 / (std * units)), np.zeros(10)), truth


def test_a_volume_has_the_moments_of_its_box(prior):
    mean = InertialParameters.from_dynamic_parameters(prior.fields[0].masses.mean(axis=0))
    even = (SIZE @ SIZE - SIZE**2) / 12.0
    assert_allclose(mean.com, 0.0, atol=0.01 * SIZE.max())
    assert_allclose(mean.inertia_com, np.diag(even), atol=0.015 * even.max())


def test_a_cloud_is_read_as_near_tetrahedra_and_as_hull():
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.box((0.02, 0.02, 0.2)),
            trimesh.creation.box(
                (0.1, 0.02, 0.02), trimesh.transformations.translation_matrix([0.06, 0, 0.09])
            ),
        ]
    )
    cloud = np.asarray(trimesh.sample.sample_surface(mesh, 3000, seed=1)[0])
    solid = Solid.of_cloud(cloud)
    gap = [
        np.mean((volume.points[:, 0] > 0.03) & (volume.points[:, 2] < 0.05))
        for volume in solid.volumes
    ]
    assert gap[0] < 0.02 < 0.1 < gap[-1]


@pytest.mark.parametrize(
    ("points", "reason"),
    [(np.zeros((50, 3)), "do not span"), (np.eye(3)[:2], "do not span")],
)
def test_points_without_volume_are_refused(points, reason):
    with pytest.raises(BadInputError, match=reason):
        Solid.of_cloud(points)


def test_a_sheet_encloses_nothing():
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0]], [[0, 1, 2]])
    with pytest.raises(BadInputError, match="encloses no volume"):
        Solid.of_shape(ObjectShape([MeshSurface(sheet)]))


def test_a_moved_solid_moves_its_moments(prior):
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    pose[:3, 3] = [0.1, 0.0, -0.05]
    moved = ShapePrior(prior.solid.moved(pose)).fields[0].masses.mean(axis=0)
    start = pose @ np.append(prior.solid.volumes[0].points.mean(axis=0), 1.0)
    assert_allclose(moved[1:4], start[:3], atol=1e-12)


def test_coordinates_are_those_of_log_cholesky():
    rng = np.random.default_rng(3)
    phi = point_masses(rng.normal(size=(20, 3))).sum(axis=0)
    xi = log_cholesky(InertialParameters.from_dynamic_parameters(phi).pseudo_inertia)
    assert_allclose(coordinates(np.array([phi, 2.0 * phi])), [xi[1:], xi[1:]], atol=1e-12)


def test_drawn_bodies_scatter_as_the_spread_says(prior):
    field = prior.fields[0]
    little, much = (field.bodies(spread, 0.0).std(axis=0) for spread in (0.05, 0.2))
    assert_allclose(much / little, 4.0, rtol=0.15)
    assert field.bodies(0.0, 1.0)[:, 6:].std(axis=0).max() < 0.003
    assert np.all(field.bodies(0.0, 1.0)[:, :3].std(axis=0) > 0.1)


def test_without_data_the_prior_remains_and_with_them_they_count(prior):
    vague, truth = as_seen("even", 1e3)
    known, _ = as_seen("even", 1e-4)
    loose, tight = weigh(vague, prior), weigh(known, prior)
    assert np.ptp(loose.weights) < 0.2
    assert_allclose(tight.phi, truth, atol=1e-3 * np.abs(truth).max())
    assert_allclose(np.sqrt(np.diag(tight.covariance)), 1.0 / np.diag(known.root), rtol=0.1)
    assert tight.spread < 0.3 < loose.spread


def test_even_bodies_do_not_contradict_their_shape(prior):
    rng = np.random.default_rng(5)
    flagged = [weigh(as_seen("even", 0.05, rng.normal(size=10))[0], prior) for _ in range(20)]
    assert not any(one.contradicts for one in flagged)


@pytest.mark.parametrize(("kind", "where"), [("ballast", "mm"), ("hollow", "hollow")])
def test_bodies_that_contradict_say_where_they_are_denser(prior, kind, where):
    seen, truth = as_seen(kind, 0.02)
    found = weigh(seen, prior)
    assert found.contradicts
    assert where in found.where
    assert f"denser at {found.where}" in found.line
    apart = np.abs(found.body.dynamic_parameters - truth)
    assert np.all(apart < 4.0 * np.sqrt(np.diag(found.covariance)) + 1e-9)
    if kind == "ballast":
        place = np.array(found.where.strip("() m").replace(") m", "").split(","), dtype=float)
        com = truth[1:4] / truth[0]
        assert place @ com > 0.7 * np.linalg.norm(place) * np.linalg.norm(com)


def test_data_that_are_noise_leave_a_body_inside_its_hull(prior):
    seen, truth = as_seen("even", 0.3, np.array([0, 4, 0, 0, -5, 0, -5, 0, 0, -5.0]))
    assert not is_feasible(seen.phi)
    body = weigh(seen, prior).body
    assert is_feasible(body.dynamic_parameters)
    assert np.all(np.abs(body.com) < 0.5 * SIZE)


def test_the_nearest_density_keeps_what_fits_and_moves_what_does_not(prior):
    masses = point_masses(prior.solid.surface)
    even = 0.4 * prior.fields[0].masses.mean(axis=0)
    covariance = np.diag(np.concatenate([[1e-2], np.full(3, 1e-2), np.full(6, 1e-3)]) ** 2)
    assert_allclose(nearest_density(even, covariance, masses), even, atol=1e-4 * even.max())
    outside = InertialParameters(0.4, np.array([0.2, 0.0, 0.0]), 1e-4 * np.eye(3))
    moved = nearest_density(outside.dynamic_parameters, covariance, masses)
    body = InertialParameters.from_dynamic_parameters(moved)
    assert is_feasible(moved)
    assert 0.02 < body.com[0] <= 0.0301


def test_where_motion_is_little_the_shape_narrows_inertia_and_the_truth_is_inside():
    found = judge("even", 301)
    assert np.median(found.narrower[4:]) < 0.6
    assert np.abs(found.shaped).max() < 3.5
    assert np.abs(found.moments).max() < 0.15


def test_a_shape_of_the_command_shape_is_read_in_the_axes_of_its_first_part(tmp_path):
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 0.1, 0.06]
    part = {"semi_axes_m": (0.5 * SIZE).tolist(), "exponents": [0.1, 0.1], "taper": [0.0, 0.0]}
    beside = np.array(pose)
    beside[2, 3] += 0.1
    parts = [part | {"pose": pose.tolist()}, part | {"pose": beside.tolist()}]
    file = tmp_path / "shape.json"
    file.write_text(json.dumps({"parts": parts}))
    volume = ShapePrior(read_solid(file)).solid.volumes[0]
    assert_allclose(volume.points.mean(axis=0), [0.0, 0.0, 0.05], atol=3e-3)
    assert set(volume.part) == {0, 1}
    file.write_text(json.dumps({"parts": [{"semi_axes_m": [1, 2]}]}))
    with pytest.raises(BadInputError, match="expected `parts`"):
        ShapePrior(read_solid(file))


def test_each_kind_of_file_gives_the_same_box(tmp_path):
    mesh = mesh_of(BOX)
    mesh.export(tmp_path / "closed.stl")
    inward = mesh.copy()
    inward.invert()
    inward.export(tmp_path / "inward.stl")
    opened = trimesh.Trimesh(mesh.vertices, mesh.faces[1:])
    opened.export(tmp_path / "open.stl")
    cloud = np.asarray(trimesh.sample.sample_surface(mesh, 3000, seed=2)[0])
    np.savetxt(tmp_path / "cloud.xyz", cloud)
    trimesh.PointCloud(cloud).export(tmp_path / "cloud.ply")
    (tmp_path / "box.yaml").write_text("shapes: [{box: [0.06, 0.08, 0.12]}]\n")
    even = ShapePrior(Solid.of_shape(ObjectShape([BoxSurface(0.5 * SIZE, np.eye(4))])))
    for name in ("closed.stl", "inward.stl", "open.stl", "cloud.xyz", "cloud.ply", "box.yaml"):
        field = ShapePrior(read_solid(tmp_path / name)).fields[-1]
        assert_allclose(field.even[:3], even.fields[0].even[:3], atol=0.04, err_msg=name)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shaped")
    options = ScenarioOptions(duration=6.0, angle_peak_deg=(8.0, 20.0), band_hz=(0.2, 1.0))
    made = generate(7, scenario=options)
    write_bag(made.streams, folder / "run.mcap")
    mesh_of(made.scenario.body).export(folder / "body.stl")
    return folder, made.scenario.body


def test_live_and_offline_learn_the_same_of_a_shape(recorded):
    """A round has ended by the end; without the shape the estimate is as before."""
    folder, _ = recorded
    shape = ShapePrior(read_solid(folder / "body.stl"))
    streams = Recording.from_bag(folder / "run.mcap").streams
    watched = IncrementalInertialEstimator()
    watched.set_shape(shape)
    live = list(replay_streams(streams, watched, 10))[-1]
    offline, weighed = with_shape(estimate(streams, shape=shape), shape)
    assert live.shape and live.shape_doubtful is weighed.contradicts
    alike = np.abs(np.log(live.parameter_std / offline.parameter_std))
    assert np.median(alike) < np.log(1.2) and alike.max() < np.log(2.0)
    apart = live.inertia.dynamic_parameters - offline.inertia.dynamic_parameters
    assert np.all(np.abs(apart) < 2.0 * np.sqrt(np.diag(offline.covariance)))
    watched.set_shape(None)
    plain = watched.update()
    assert plain.shape == "" and np.median((live.parameter_std / plain.parameter_std)[4:]) < 0.9


def test_a_live_shape_that_lies_elsewhere_is_said_and_does_not_count(recorded):
    folder, body = recorded
    far = read_solid(folder / "body.stl", pose_of([0.3, 0.0, 0.0], [0.0, 0.0, 0.0]))
    watched = IncrementalInertialEstimator()
    watched.set_shape(ShapePrior(far))
    streams = Recording.from_bag(folder / "run.mcap").streams
    live = list(replay_streams(streams, watched, 10))[-1]
    verdict = judge_estimate(live, (), "model_check/diagnose")
    assert "no body inside it moves as measured" in verdict.text
    assert verdict.level is Level.WARN
    assert_allclose(live.inertia.com, body.com, atol=2e-3)


def test_the_command_prints_what_the_shape_adds(recorded, capsys):
    folder, body = recorded
    bag, mesh = str(folder / "run.mcap"), str(folder / "body.stl")
    assert main(["estimate", bag, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert main(["estimate", bag, "--shape", mesh, "--json"]) == 0
    output = capsys.readouterr()
    shaped = json.loads(output.out)
    assert shaped["shape"]["source"] == "body.stl"
    assert shaped["shape"]["contradicts"] is ("shape contradicts" in output.err)
    assert 0.0 < shaped["shape"]["density_spread"] < 2.0
    narrower = np.array(shaped["inertia_com"]["std"]) / np.array(plain["inertia_com"]["std"])
    assert np.median(narrower) < 0.9
    away = np.array(shaped["com"]["value"]) - body.com
    assert np.all(np.abs(away) < 4.0 * np.array(shaped["com"]["std"]))


def test_a_shape_that_lies_elsewhere_is_refused_until_its_pose_is_given(recorded, capsys):
    folder, body = recorded
    far = mesh_of(body).apply_translation([0.3, 0.0, 0.0])
    far.export(folder / "far.stl")
    asked = ["estimate", str(folder / "run.mcap"), "--shape", str(folder / "far.stl")]
    assert main(asked) == 2
    assert "no body inside it moves as measured" in capsys.readouterr().err
    assert main([*asked, "--shape-pose", "-0.3", "0", "0", "0", "0", "0", "--json"]) == 0
    com = np.array(json.loads(capsys.readouterr().out)["com"]["value"])
    assert_allclose(com, body.com, atol=2e-3)


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--shape", "body.stl", "--prior", "known.yaml"], "leave out tool, prior and wrist"),
        (["--shape", "none.stl"], "none.stl"),
        (["--shape-pose", "0", "0", "0", "0", "0", "0"], "name its file too"),
        (["--shape", "body.stl", "--save", "known.yaml"], "leave out the shape"),
    ],
)
def test_shapes_that_cannot_count_are_refused_in_one_line(
    recorded, capsys, monkeypatch, more, reason
):
    folder, _ = recorded
    monkeypatch.chdir(folder)
    assert main(["estimate", "run.mcap", *more]) == 2
    assert reason in capsys.readouterr().err.splitlines()[-1]
    assert not (folder / "known.yaml").exists()


def test_drawn_densities_make_bodies_that_can_exist(prior):
    for spread in (0.4, 1.6):
        xi = np.insert(prior.fields[0].bodies(spread, 1.0), 0, 0.0, axis=1)
        assert all(is_feasible(dynamic_parameters_from_log_cholesky(one)) for one in xi[::40])
