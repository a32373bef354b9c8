"""Superquadrics: surface, recovery from points, parts, next view."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.shape.superquadric.parts import find_objects
from tactile_dynamics_ros.core.shape.superquadric.recovery import recover
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric
from tactile_dynamics_ros.core.shape.superquadric.views import (
    SurfaceEntropy,
    ViewConfig,
    looking_at,
)

NOISE = 1e-3


def standing(yaw, x, y, z):
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.0, 0.0, yaw]))
    pose[:3, 3] = x, y, z
    return pose


SHAPES = [
    Superquadric(np.array([0.05, 0.03, 0.02]), np.array([0.3, 0.8]), np.array([0.3, 0.2])),
    Superquadric(np.array([0.05, 0.05, 0.08]), np.array([0.1, 1.0]), pose=standing(1.0, 0, 0, 0)),
    Superquadric(np.array([0.05, 0.03, 0.02]), np.array([0.05, 0.05])),
]


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_of_the_gauge_are_those_of_its_differences(shape):
    points = 0.04 * np.random.default_rng(0).normal(size=(40, 3))
    found, step = shape.differentiate(points), 1e-7

    def gauge(axes=0.0, exponents=0.0, taper=0.0, shift=0.0):
        other = Superquadric(
            shape.semi_axes + axes, shape.exponents + exponents, shape.taper + taper
        )
        return other.gauge(points + shift)

    def numeric(**of):
        (name, count), *_ = of.items()
        steps = step * np.eye(count)
        return np.stack(
            [(gauge(**{name: s}) - gauge(**{name: -s})) / (2 * step) for s in steps], axis=1
        )

    scale = np.abs(found.axes).max()
    np.testing.assert_allclose(found.point, numeric(shift=3), atol=1e-5 * scale)
    np.testing.assert_allclose(found.axes, numeric(axes=3), atol=1e-5 * scale)
    np.testing.assert_allclose(found.taper, numeric(taper=2), atol=1e-5)
    if shape.exponents.min() > 0.06:  # no step below the least exponent
        np.testing.assert_allclose(found.exponents, numeric(exponents=2), atol=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_distances_are_those_to_the_nearest_of_many_samples(shape):
    rng = np.random.default_rng(1)
    points = 0.08 * rng.normal(size=(200, 3))
    samples, normals = shape.sample(60_000)
    nearest = cKDTree(samples).query(points)[0]
    assert np.all(np.abs(shape.distance(points)) < nearest + 1e-4)
    assert np.median(np.abs(np.abs(shape.distance(points)) - nearest)) < 1e-4
    outside = samples + 0.01 * normals
    np.testing.assert_array_less(0.0, shape.distance(outside))


def test_area_and_footprint_of_a_box():
    box = SHAPES[2]
    x, y, z = 2 * box.semi_axes
    assert box.area == pytest.approx(2 * (x * y + y * z + x * z), rel=0.04)
    a, b = box.footprint(), np.roll(box.footprint(), -1, axis=0)
    signed = 0.5 * np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])  # positive anticlockwise
    assert signed == pytest.approx(x * y, rel=0.02)


def seen_points(solids, views, seed, noise=NOISE, strays=0.1):
    """Noisy points on the faces of solids that some of the views see, with strays."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for k, solid in enumerate(solids):
        p, face = trimesh.sample.sample_surface(solid, int(4e5 * solid.area), seed=seed + k)
        n = solid.face_normals[face]
        free = np.ones(len(p), dtype=bool)
        for other in solids[:k] + solids[k + 1 :]:
            planes = ConvexHull(other.vertices).equations
            free &= np.any((p + 1e-5 * n) @ planes[:, :3].T + planes[:, 3] > 0, axis=1)
        points.append(p[free])
        normals.append(n[free])
    p, n = np.concatenate(points), np.concatenate(normals)
    seen = np.zeros(len(p), dtype=bool)
    for angle in rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(views) / views:
        seen |= n @ [np.cos(angle), np.sin(angle), 0.8] > 0.1
    p = p[seen][rng.permutation(seen.sum())[:2000]]
    p = p @ standing(rng.uniform(0, 6), 0, 0, 0)[:3, :3].T + [0.4, 0.1, 0.0]
    p += noise * rng.normal(size=p.shape)
    count = int(strays * len(p))
    stray = rng.uniform(p.min(axis=0) - 0.02, p.max(axis=0) + 0.02, size=(count, 3))
    stray[:, 2] = np.abs(stray[:, 2])
    return np.concatenate([p, stray])


def block(x, y, z, at=(0.0, 0.0)):
    return trimesh.creation.box((x, y, z)).apply_translation([*at, z / 2])


def drum(radius, height, sections=48, at=(0.0, 0.0)):
    solid = trimesh.creation.cylinder(radius, height, sections=sections)
    return solid.apply_translation([*at, height / 2])


@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize(
    ("solid", "half"), [(block(0.1, 0.06, 0.04), (30, 50, 20)), (drum(0.03, 0.08), (30, 30, 40))]
)
def test_half_extents_are_right_from_few_views_although_a_tenth_are_strays(solid, half, views):
    found = recover(seen_points([solid], views, seed=5), support=0.0)
    np.testing.assert_allclose(np.sort(1e3 * found.shape.semi_axes), np.sort(half), atol=1.2)
    assert found.mixture.noise == pytest.approx(NOISE, rel=0.2)
    assert found.mixture.strays == pytest.approx(0.09, abs=0.03)


def test_the_answer_does_not_depend_on_place_turn_order_or_unit():
    points = seen_points([block(0.1, 0.06, 0.04)], 2, seed=6)
    shape = recover(points, support=0.0).shape
    rng = np.random.default_rng(0)
    moved = points @ standing(0.7, 0, 0, 0)[:3, :3].T + [3.0, -2.0, 0.5]
    others = {
        "moved": recover(moved, support=0.5).shape.semi_axes,
        "shuffled": recover(points[rng.permutation(len(points))], support=0.0).shape.semi_axes,
        "in mm": 1e-3 * recover(1e3 * points, support=0.0).shape.semi_axes,
    }
    for name, axes in others.items():
        np.testing.assert_allclose(np.sort(axes), np.sort(shape.semi_axes), rtol=2e-3, err_msg=name)


@pytest.mark.parametrize(
    ("solids", "parts"),
    [
        ([block(0.12, 0.04, 0.04), block(0.04, 0.08, 0.04, (0, 0.06))], 2),
        ([block(0.1, 0.06, 0.04), drum(0.03, 0.08, at=(0.08, 0))], 2),
        ([block(0.06, 0.06, 0.04), block(0.05, 0.06, 0.04, (0.055, 0))], 1),
        ([drum(0.04, 0.05, sections=6)], 1),
    ],
    ids=["T", "box and taller cylinder", "flush boxes are one", "hexagon is one"],
)
def test_parts_are_counted_where_outline_or_height_differ(solids, parts):
    found = find_objects(seen_points(solids, 3, seed=7), support=0.0)
    assert [len(thing.parts) for thing in found] == [parts]


def test_two_objects_that_stand_apart_are_two():
    solids = [block(0.06, 0.04, 0.05), drum(0.025, 0.06, at=(0.12, 0.03))]
    found = find_objects(seen_points(solids, 3, seed=8, strays=0.0), support=0.0)
    assert len(found) == 2


def test_too_little_to_fit_is_told():
    with pytest.raises(BadInputError, match="at least 30"):
        recover(np.zeros((5, 3)))
    with pytest.raises(BadInputError, match="on a line"):
        recover(np.linspace(0, 1, 50)[:, None] * [1.0, 2.0, 3.0])


def cuboid(x, y, z, pose):
    return Superquadric(np.array([x, y, z]), np.array([0.1, 0.1]), pose=pose)


def test_the_next_view_is_of_the_side_that_was_not_seen():
    box = cuboid(0.05, 0.03, 0.02, standing(0, 0, 0, 0.02))
    points, normals = box.sample(4000)
    front = points[(normals @ [0, 1, 0.8]) > 0.1]
    entropy = SurfaceEntropy.of_parts([box], front)
    view = entropy.next_view()
    assert view.pose[1, 3] < -0.1
    assert view.gain > 0.2
    behind = entropy.gain(looking_at(np.array([0.0, 0.5, 0.3]), np.zeros(3)))
    assert behind < 0.5 * view.gain
    assert SurfaceEntropy.of_parts([box], points).next_view(ViewConfig()) is None


def test_a_part_hides_what_is_behind_it():
    low = cuboid(0.02, 0.02, 0.02, standing(0, 0, -0.1, 0.02))
    wall = cuboid(0.1, 0.01, 0.1, standing(0, 0, 0, 0.1))
    nothing = np.full((1, 3), 9.0)
    camera = looking_at(np.array([0.0, 0.5, 0.1]), np.array([0.0, -0.1, 0.05]))
    beside = SurfaceEntropy.of_parts([low, wall], nothing)
    alone = SurfaceEntropy.of_parts([low], nothing)
    hidden = beside.gain(camera) * len(beside.entropy)
    wall_alone = SurfaceEntropy.of_parts([wall], nothing)
    assert alone.gain(camera) > 0.2
    share = wall_alone.gain(camera) * len(beside.entropy[beside.points[:, 1] > -0.05])
    assert hidden == pytest.approx(share, rel=0.15)


def turned_and_moved(points, yaw):
    return points @ exp_so3(np.array([0.0, 0.0, yaw])).T + [0.7, -0.4, 0.0]


def test_a_turned_cloud_has_the_turned_answer():
    """No start and no choice of points follows the axes of the world."""
    rng = np.random.default_rng(3)
    surface, _ = SHAPES[0].sample(1500)
    points = surface[rng.permutation(len(surface))[:900]] + NOISE * rng.normal(size=(900, 3))
    yaw = 0.7
    (here,) = find_objects(points, -0.02)
    (there,) = find_objects(turned_and_moved(points, yaw), -0.02)
    one, other = here.parts[0], there.parts[0]
    np.testing.assert_allclose(other.shape.semi_axes, one.shape.semi_axes, rtol=1e-6)
    middle = turned_and_moved(one.shape.pose[None, :3, 3], yaw)[0]
    np.testing.assert_allclose(other.shape.pose[:3, 3], middle, atol=1e-8)
    turn = exp_so3(np.array([0.0, 0.0, yaw]))[:2, :2]
    place = np.ix_([7, 8], [7, 8])
    np.testing.assert_allclose(
        other.covariance[place], turn @ one.covariance[place] @ turn.T, rtol=1e-5, atol=1e-14
    )


def test_a_camera_inside_the_object_shows_nothing():
    surface, _ = SHAPES[0].sample(300)
    entropy = SurfaceEntropy.of_parts([SHAPES[0]], surface)
    assert entropy.gain(looking_at(np.array([0.0, 0.0, 0.01]), np.zeros(3))) == 0.0


def test_what_no_superquadric_describes_has_intervals_as_wide_as_the_misfit():
    """More points do not average out what the family of shapes cannot follow."""
    rng = np.random.default_rng(5)
    surface, normal = SHAPES[2].sample(3000)
    some = rng.permutation(len(surface))[:2000]
    points, normal = surface[some], normal[some]
    wavy = 2e-3 * np.sign(np.sin(300.0 * points[:, :1])) * normal
    (plain,) = find_objects(points + 3e-4 * rng.normal(size=points.shape), -0.02)
    (rough,) = find_objects(points + wavy + 3e-4 * rng.normal(size=points.shape), -0.02)
    assert rough.misfit > 1e-3
    assert plain.parts[0].std["ax"] < 0.2e-3
    assert rough.parts[0].std["ax"] > rough.misfit


@pytest.mark.parametrize("sections", [3, 6])
def test_intervals_of_what_has_sharp_corners_reach_them(sections):
    """No taper that is a parabola follows straight sides up to a corner."""
    solid = drum(0.04, 0.05, sections=sections)
    (found,) = find_objects(seen_points([solid], 3, seed=7), support=0.0)
    (part,) = found.parts
    spread = 2.0 * np.array([part.std[f"a{axis}"] for axis in "xyz"])
    true = np.sort(np.ptp(solid.vertices, axis=0)[:2])
    order = np.argsort(part.shape.extents()[:2])
    off = np.abs(part.shape.extents()[:2][order] - true)
    assert off.max() > 1e-3
    assert np.all(off < 2.0 * spread[:2][order])
