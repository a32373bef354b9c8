"""`tactile-dynamics shape`: formats of clouds, tables, units, words and complaints."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.shape.superquadric.registration import registered
from tactile_dynamics_ros.core.shape.superquadric.scene import read_scene

KRYLON = Path(__file__).resolve().parents[3] / "shared/data/clouds_tabletop/gpd_krylon.pcd"


@pytest.fixture(scope="module")
def box_on_table():
    """Points of a box of 100 x 60 x 40 mm and of the table at z = 0.3 around it."""
    rng = np.random.default_rng(3)
    solid = trimesh.creation.box((0.1, 0.06, 0.04)).apply_translation([0.5, 0.0, 0.32])
    points, face = trimesh.sample.sample_surface(solid, 3000, seed=1)
    points = points[solid.face_normals[face][:, 2] > -0.5]
    table = np.column_stack([rng.uniform(0.3, 0.7, 4000), rng.uniform(-0.2, 0.2, 4000)])
    around = np.abs(table - [0.5, 0.0]) > [0.05, 0.03]
    table = np.column_stack([table, np.full(4000, 0.3)])[around.any(axis=1)]
    cloud = np.concatenate([points, table])
    return cloud + 0.0008 * rng.normal(size=cloud.shape)


def ask(capsys, *words):
    assert main(["shape", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def write(cloud, path):
    if path.suffix == ".ply":
        trimesh.PointCloud(cloud).export(path)
    elif path.suffix == ".pcd":
        from pypcd4 import PointCloud

        PointCloud.from_xyz_points(cloud.astype(np.float32)).save(path)
    elif path.suffix == ".npz":
        np.savez(path, points=cloud)
    elif path.suffix == ".csv":
        np.savetxt(path, cloud, delimiter=",", header="x,y,z", comments="")
    else:
        np.savetxt(path, np.column_stack([cloud, np.zeros((len(cloud), 3))]))
    return path


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".npz", ".csv", ".txt"])
def test_every_format_gives_the_box_and_finds_its_table(capsys, tmp_path, box_on_table, suffix):
    said = ask(capsys, write(box_on_table, tmp_path / f"cloud{suffix}"))
    (part,) = said["parts"]
    np.testing.assert_allclose(np.sort(part["semi_axes_m"]), [0.02, 0.03, 0.05], atol=7e-4)
    assert said["support_m"] == pytest.approx(0.3, abs=5e-4)
    assert part["words"].startswith("a box")
    assert len(part["footprint"]) > 8


def test_a_foot_that_was_cut_off_with_the_table_is_in_the_interval(capsys, tmp_path, box_on_table):
    above = box_on_table[box_on_table[:, 2] > 0.305]
    said = ask(capsys, write(above, tmp_path / "cut.txt"))
    (part,) = said["parts"]
    height, std = 2 * part["semi_axes_m"][2], 2 * part["std"]["az"]
    assert height < 0.036
    assert abs(height - 0.04) < 2.0 * std
    assert part["std"]["ax"] < 1e-3, "what was seen is as sure as before"
    assert "its height ±" in part["words"]
    assert any("--support" in remark for remark in said["remarks"])


def test_a_bottom_that_was_seen_is_sure_without_a_table(capsys, tmp_path):
    solid = trimesh.creation.box((0.1, 0.06, 0.04)).apply_translation([0.5, 0.0, 0.32])
    points = trimesh.sample.sample_surface(solid, 3000, seed=1)[0]
    points += 0.0008 * np.random.default_rng(4).normal(size=points.shape)
    said = ask(capsys, write(points, tmp_path / "all_around.txt"))
    assert said["parts"][0]["std"]["az"] < 1e-3
    assert not any("--support" in remark for remark in said["remarks"])


def test_millimetres_are_guessed_and_said(capsys, tmp_path, box_on_table):
    said = ask(capsys, write(1e3 * box_on_table, tmp_path / "cloud.txt"))
    np.testing.assert_allclose(
        np.sort(said["parts"][0]["semi_axes_m"]), [0.02, 0.03, 0.05], atol=7e-4
    )
    assert any("read as mm" in remark for remark in said["remarks"])


def test_a_depth_image_with_its_camera(capsys, tmp_path):
    pose = np.diag([1.0, -1.0, -1.0, 1.0])  # looks straight down from 0.6 m
    pose[2, 3] = 0.6
    camera = np.array([[300.0, 0, 80], [0, 300, 60], [0, 0, 1]])
    row, column = np.mgrid[:120, :160]
    depth = np.full((120, 160), 0.6)
    x, y = (column - 80) / 300 * 0.56, -(row - 60) / 300 * 0.56
    depth[(np.abs(x) < 0.05) & (np.abs(y) < 0.03)] = 0.56
    depth += 0.0005 * np.random.default_rng(0).normal(size=depth.shape)
    np.savez(tmp_path / "look.npz", depth=depth, intrinsics=camera, pose=pose)
    said = ask(capsys, tmp_path / "look.npz")
    np.testing.assert_allclose(
        np.sort(said["parts"][0]["semi_axes_m"]), [0.02, 0.03, 0.05], atol=2e-3
    )
    assert said["next_view"] is not None


def test_noise_that_grows_with_depth_is_weighed(capsys, tmp_path, box_on_table):
    rng = np.random.default_rng(2)
    box = box_on_table[box_on_table[:, 2] > 0.304]
    far = box + 0.004 * rng.normal(size=box.shape)  # as of a camera at twice the distance
    both, depth = np.concatenate([box, far]), np.repeat([0.5, 1.1], len(box))
    told = read_scene(both, 0.3, depth=depth).objects[0].parts[0]
    untold = read_scene(both, 0.3).objects[0].parts[0]
    scale = told.mixture.noise * np.unique(told.mixture.scale)
    assert scale[1] / scale[0] == pytest.approx((1.1 / 0.5) ** 2)
    assert scale[0] == pytest.approx(0.0009, rel=0.25)
    off = [
        np.abs(np.sort(part.shape.semi_axes) - [0.02, 0.03, 0.05]).max() for part in (told, untold)
    ]
    assert off[0] < 0.6 * off[1]


def test_looks_whose_camera_was_off_are_aligned(capsys, tmp_path, box_on_table):
    left = box_on_table[box_on_table[:, 0] < 0.53]
    right = box_on_table[box_on_table[:, 0] > 0.47]
    turn = np.deg2rad(0.5)
    motion = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    off = (right - [0.5, 0, 0.3]) @ motion.T + [0.503, 0.002, 0.302]
    above = right[:, 2] > 0.304
    first, second = registered([left[left[:, 2] > 0.304], off[above]])
    np.testing.assert_array_equal(first, left[left[:, 2] > 0.304])
    assert np.sqrt(np.mean((off - right)[above] ** 2)) > 0.002
    assert np.sqrt(np.mean((second - right[above]) ** 2)) < 5e-4
    paths = [write(left, tmp_path / "a.npz"), write(off, tmp_path / "b.npz")]
    np.testing.assert_allclose(
        np.sort(ask(capsys, *paths, "--align")["parts"][0]["semi_axes_m"]),
        [0.02, 0.03, 0.05],
        atol=1e-3,
    )
    far = right[above] + [0.3, 0.0, 0.0]  # nothing in common: left where it is
    np.testing.assert_array_equal(registered([first, far])[1], far)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("missing.txt", None, "no such file"),
        ("words.txt", "0 0 0\n1 a 2\n", "line 2 is no point"),
        ("short.txt", "0 0\n1 1\n", "line 1 has 2 columns"),
        ("few.txt", "0 0 0\n1 1 1\n", "at least 30"),
    ],
)
def test_bad_clouds_are_told_in_a_line(capsys, tmp_path, name, text, complaint):
    if text is not None:
        (tmp_path / name).write_text(text)
    assert main(["shape", str(tmp_path / name)]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert len(said.strip().splitlines()) == 1


def test_the_mesh_that_is_written_is_the_box(capsys, tmp_path, box_on_table):
    ask(capsys, write(box_on_table, tmp_path / "c.npz"), "--out", tmp_path / "box.stl")
    mesh = trimesh.load(tmp_path / "box.stl")
    assert mesh.bounds[0][2] == pytest.approx(0.3, abs=1e-3)
    np.testing.assert_allclose(np.sort(mesh.extents), [0.04, 0.06, 0.1], atol=8e-3)


@pytest.mark.skipif(not KRYLON.is_file(), reason="the spray can of the shared data is not here")
def test_a_real_spray_can(capsys):
    said = ask(capsys, KRYLON)
    (part,) = said["parts"]
    np.testing.assert_allclose(2 * np.sort(part["semi_axes_m"]), [0.054, 0.056, 0.102], atol=1.5e-3)
