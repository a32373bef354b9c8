"""Surfaces of objects: distances, samples, symmetries, files."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import rpy_to_matrix
from tactile_dynamics_ros.core.shape.object_shape import (
    BoxSurface,
    CylinderSurface,
    ObjectShape,
    SphereSurface,
    load_shape,
)
from tactile_dynamics_ros.share import object_file

POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = rpy_to_matrix(np.array([0.4, -0.3, 1.0])), [0.02, -0.01, 0.03]
SURFACES = {
    "box": BoxSurface(np.array([0.03, 0.02, 0.05]), POSE),
    "cylinder": CylinderSurface(0.03, 0.05, POSE),
    "sphere": SphereSurface(0.04, POSE[:3, 3]),
}


@pytest.mark.parametrize("kind", SURFACES)
def test_distance_is_that_of_the_mesh_and_gradient_its_slope(kind):
    surface = SURFACES[kind]
    points = np.random.default_rng(2).uniform(-0.1, 0.12, (200, 3))
    distance, gradient = surface.distance(points)
    samples, _ = trimesh.sample.sample_surface(surface.mesh(), 200_000, seed=0)
    expected, _ = cKDTree(samples).query(points)
    assert_allclose(np.abs(distance), expected, atol=8e-4)
    mesh = surface.mesh()  # convex: a point is inside if it is behind all faces
    height = (points[:, None] - mesh.triangles_center) * mesh.face_normals
    inside = (height.sum(axis=2) < 0.0).all(axis=1)
    assert np.all((distance < 0.0)[np.abs(distance) > 3e-4] == inside[np.abs(distance) > 3e-4])
    assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-9)
    step = 1e-6 * gradient
    assert_allclose((surface.distance(points + step)[0] - distance) / 1e-6, 1.0, atol=1e-3)


def test_samples_of_a_union_lie_on_its_outside():
    shape = ObjectShape([SURFACES["box"], SURFACES["sphere"]])
    distance, gradient = shape.distance(shape.points)
    assert np.abs(distance).max() < 2e-4
    outside, _ = shape.distance(shape.points + 2e-3 * shape.normals)
    assert np.median(outside) == pytest.approx(2e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "count", "axes"), [("gelatin_box", 4, 0), ("rubiks_cube", 24, 0), ("soup_can", 144, 1)]
)
def test_symmetries_are_those_of_the_solid(name, count, axes):
    shape = load_shape(object_file(name))
    distinct = {tuple(np.round(turn, 6).ravel() + 0.0) for turn in shape.symmetries}
    assert len(distinct) == count
    assert len(shape.symmetry_axes) == axes


def test_a_mesh_file_is_as_good_as_its_shape(tmp_path):
    path = tmp_path / "thing.stl"
    SURFACES["box"].mesh().export(path)
    shape, exact = load_shape(path), ObjectShape([SURFACES["box"]])
    points = exact.points[:500] + 3e-3 * exact.normals[:500]
    assert np.median(np.abs(shape.distance(points)[0] - 3e-3)) < 1e-4
    assert shape.radius == pytest.approx(exact.radius)
    assert_allclose(shape.centre, exact.centre, atol=1e-9)


def test_files_that_are_no_shape_are_refused_with_the_reason(tmp_path):
    with pytest.raises(BadInputError, match="no such file"):
        load_shape(tmp_path / "absent.stl")
    (tmp_path / "empty.yaml").write_text("name: nothing\n")
    with pytest.raises(BadInputError, match="shapes"):
        load_shape(tmp_path / "empty.yaml")
    (tmp_path / "notes.txt").write_text("x")
    with pytest.raises(BadInputError, match="expected a yaml file"):
        load_shape(tmp_path / "notes.txt")
    (tmp_path / "broken.stl").write_text("solid\n")
    with pytest.raises(BadInputError, match="broken.stl"):
        load_shape(tmp_path / "broken.stl")
    trimesh.creation.box((60.0, 40.0, 100.0)).export(tmp_path / "in_mm.stl")
    with pytest.raises(BadInputError, match="metre"):
        load_shape(tmp_path / "in_mm.stl")
