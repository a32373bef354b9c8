"""Surface of an object to be tracked: distance, samples and edges, from shapes or a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import read_mesh, read_yaml, require_file
from tactile_dynamics_ros.core.rigid_body.rotation import described_pose, exp_so3, rpy_to_matrix

Triangles: TypeAlias = Any
"""A trimesh.Trimesh; the library is not typed."""

MESH_SUFFIXES = (".obj", ".stl", ".ply", ".off", ".glb")
"""Endings of files that are read as meshes, in metres; what trimesh reads without further
libraries. A file with another ending is read as the yaml of an object, and refused."""
_SMALLEST, _LARGEST = 1e-4, 5.0
"""Sizes of what a hand or an arm holds, m: smaller ones are thinner than paper, larger ones are
given in another unit."""
_SAMPLES = 8000
"""Samples of an object's surface; on a box of 10 cm one per 2.7 mm. An image is compared with the
first 2000 of them (`fit.JUDGED`), a mesh's distance is that to the nearest of four times
as many. Fewer make the distance to curved meshes coarse, more take longer to load."""
_EDGE_SPACING = 2.5e-3
"""Distance, m, between samples of an edge: about a pixel of a 320 x 240 image at 0.8 m. Closer ones
cost time, wider ones leave gaps in the outline."""
_SECTIONS = 64
"""Sides of the prism by which a cylinder is drawn: at a radius of 4 cm it is at most 0.05 mm
inside. Fewer draw an outline inside the true one, which a fit takes for a smaller distance; more
cost time for each drawing."""
_PROBED = 300
"""Samples by which a turn is tested for being a symmetry. Few suffice, since the mean of all must
be small. With far fewer a small handle may go unseen and a mug pass for round; more cost time when
a shape is loaded."""
_ALIKE = 5e-4
"""Mean distance of turned samples from the surface, m, up to which orientations look the same: a
box of 50 x 51 mm counts as square (0.33 mm), one of 50 x 52 mm does not (0.67 mm). Twice as much
would hide turns that a camera can see. A tenth of it takes meshes that are round to rounding of
their triangles for unsymmetric, whose turns no camera shows."""


class Surface(Protocol):
    """Part of an object's surface."""

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""


@dataclass(frozen=True)
class BoxSurface:
    """A box: half edges (3,) m and pose (4, 4) of its centre."""

    half: Array
    pose: Array

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        excess = np.abs(local) - self.half
        gradient = np.maximum(excess, 0.0)
        distance = np.sqrt(np.einsum("ij,ij->i", gradient, gradient))
        inside = np.flatnonzero(distance <= 1e-12)
        deepest = np.argmax(excess[inside], axis=1)
        gradient[inside, deepest] = 1.0
        gradient /= np.where(distance > 1e-12, distance, 1.0)[:, None]
        distance[inside] = excess[inside, deepest]
        return distance, np.copysign(gradient, local) @ self.pose[:3, :3].T

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        return trimesh.creation.box(2.0 * self.half, transform=self.pose)


@dataclass(frozen=True)
class CylinderSurface:
    """A cylinder along z: radius and half height, m, and pose (4, 4) of its centre."""

    radius: float
    half: float
    pose: Array

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        reach = np.hypot(local[:, 0], local[:, 1])
        radial = np.zeros_like(local)
        radial[:, :2] = local[:, :2] / np.maximum(reach, 1e-9)[:, None]
        axial = np.zeros_like(local)
        axial[:, 2] = np.where(local[:, 2] < 0.0, -1.0, 1.0)
        excess = np.stack([reach - self.radius, np.abs(local[:, 2]) - self.half], axis=1)
        outward = np.maximum(excess, 0.0)
        length = np.hypot(outward[:, 0], outward[:, 1])
        outside = length > 1e-12
        share = np.where(excess[:, :1] > excess[:, 1:], [[1.0, 0.0]], [[0.0, 1.0]])
        share[outside] = outward[outside] / length[outside, None]
        distance = np.where(outside, length, excess.max(axis=1))
        gradient = share[:, :1] * radial + share[:, 1:] * axial
        return distance, gradient @ self.pose[:3, :3].T

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        return trimesh.creation.cylinder(
            self.radius, 2.0 * self.half, sections=_SECTIONS, transform=self.pose
        )


@dataclass(frozen=True)
class SphereSurface:
    """A sphere: radius, m, and centre (3,)."""

    radius: float
    centre: Array

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        arm = points - self.centre
        length = np.linalg.norm(arm, axis=1)
        return length - self.radius, arm / np.maximum(length, 1e-9)[:, None]

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        ball = trimesh.creation.icosphere(subdivisions=4, radius=self.radius)
        ball.apply_translation(self.centre)
        return ball


class MeshSurface:
    """Any triangle mesh; distance to the tangent plane of the nearest of many samples.

    Args:
        triangles: object frame, m.
    """

    def __init__(self, triangles: Triangles) -> None:
        self._mesh = triangles
        points, faces = trimesh.sample.sample_surface(triangles, 4 * _SAMPLES, seed=1)
        self._points = np.asarray(points)
        self._normals = np.asarray(triangles.face_normals[faces])
        self._tree = cKDTree(self._points)

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,), m, and their gradients (N, 3)."""
        _, nearest = self._tree.query(points)
        normal = self._normals[nearest]
        return np.einsum("ij,ij->i", normal, points - self._points[nearest]), normal

    def mesh(self) -> Triangles:
        """Return triangles, object frame."""
        return self._mesh


@dataclass(frozen=True)
class Edges:
    """Samples of the edges between triangles.

    Attributes:
        face_normals, face_planes: (F, 3) outward normals of the triangles, (F,) distances of their
            planes from the origin, m.
        faces: (E, 2) the two triangles at each edge.
        points, tangents: (S, 3) samples of the edges, m, and unit vectors along them there.
        edge: (S,) the edge of each.
    """

    face_normals: Array
    face_planes: Array
    faces: NDArray[np.intp]
    points: Array
    tangents: Array
    edge: NDArray[np.intp]

    @classmethod
    def between(cls, meshes: Sequence[Triangles]) -> Edges:
        """Sample the edges between triangles that touch in each of some meshes."""
        mesh: Triangles = trimesh.util.concatenate(list(meshes))
        ends = np.asarray(mesh.vertices)[mesh.face_adjacency_edges]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        count = np.maximum(1, np.ceil(length / _EDGE_SPACING).astype(int))
        edge = np.repeat(np.arange(len(ends)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        share = ((np.arange(len(edge)) - first + 0.5) / count[edge])[:, None]
        normals = np.asarray(mesh.face_normals)
        tangents = (ends[:, 1] - ends[:, 0]) / np.maximum(length, 1e-9)[:, None]
        return cls(
            normals,
            np.einsum("ij,ij->i", normals, np.asarray(mesh.triangles)[:, 0]),
            np.asarray(mesh.face_adjacency),
            ends[edge, 0] * (1.0 - share) + ends[edge, 1] * share,
            tangents[edge],
            edge,
        )


class ObjectShape:
    """Everything that a tracker needs to know about an object's surface, object frame.

    Args:
        surfaces: whose union is the object.
        expected: (3, 3) R_WO in which the object is expected at first; tells apart orientations
            that look the same.

    Attributes:
        surfaces: as given.
        centre: (3,) centre of the bounding sphere, m. radius: its radius, m.
        half: (3,) half extents, m.
        points, normals: (N, 3) samples of the surface in random order.
        edges: between the triangles by which it is drawn.
        symmetries: (S, 3, 3) rotations about the centre that leave the surface as it is.
        symmetry_axes: (A, 3) axes about which every turn does.
    """

    def __init__(self, surfaces: Sequence[Surface], expected: Array | None = None) -> None:
        self.surfaces = tuple(surfaces)
        self.expected = np.eye(3) if expected is None else np.asarray(expected, dtype=float)
        meshes = [surface.mesh() for surface in self.surfaces]
        corners = np.vstack([np.asarray(mesh.vertices) for mesh in meshes])
        self.centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        self.half = 0.5 * np.ptp(corners, axis=0)
        self.radius = float(np.linalg.norm(corners - self.centre, axis=1).max())
        self.points, self.normals = self._sample(meshes)
        self.planes = np.einsum("ij,ij->i", self.normals, self.points)
        self.edges = Edges.between(meshes)
        self.symmetries, self.symmetry_axes = self._find_symmetries()

    def distance(self, points: Array) -> tuple[Array, Array]:
        """Return signed distances (N,) of points (N, 3), m, and their gradients (N, 3)."""
        distance, gradient = self.surfaces[0].distance(points)
        for surface in self.surfaces[1:]:
            other, slope = surface.distance(points)
            nearer = other < distance
            distance = np.where(nearer, other, distance)
            gradient = np.where(nearer[:, None], slope, gradient)
        return distance, gradient

    def _find_symmetries(self) -> tuple[Array, Array]:
        """Return turns about the axes that map the surface onto itself, and their products."""
        arm = self.points[:_PROBED] - self.centre

        def is_symmetry(turn: Array) -> bool:
            distance, _ = self.distance(arm @ turn.T + self.centre)
            return bool(np.mean(np.abs(distance)) < _ALIKE)

        about = [[turn for turn in turns if is_symmetry(turn)] for turns in _axis_turns()]
        full = [len(found) == len(turns) for found, turns in zip(about, _axis_turns(), strict=True)]
        flips = [turn for turn in _right_angled_turns() if is_symmetry(turn)]
        turns = [np.eye(3), *(turn for found in about for turn in found)]
        return np.array([turn @ flip for turn in turns for flip in flips]), np.eye(3)[full]

    def _sample(self, meshes: Sequence[Triangles]) -> tuple[Array, Array]:
        area = np.array([mesh.area for mesh in meshes])
        points, normals = [], []
        for k, (mesh, surface) in enumerate(zip(meshes, self.surfaces, strict=True)):
            count = max(50, round(_SAMPLES * area[k] / area.sum()))
            sample = np.asarray(trimesh.sample.sample_surface(mesh, count, seed=k)[0])
            distance, gradient = surface.distance(sample)
            sample = sample - distance[:, None] * gradient
            keep = np.ones(len(sample), dtype=bool)
            for other in self.surfaces[:k] + self.surfaces[k + 1 :]:
                keep &= other.distance(sample)[0] > -1e-4
            points.append(sample[keep])
            normals.append(gradient[keep])
        order = np.random.default_rng(0).permutation(sum(len(part) for part in points))
        return np.vstack(points)[order], np.vstack(normals)[order]


def _axis_turns() -> list[list[Array]]:
    """Return rotations about x, about y and about z in steps of five degrees."""
    angles = np.deg2rad(np.arange(5, 360, 5))
    return [[exp_so3(angle * axis) for angle in angles] for axis in np.eye(3)]


def _right_angled_turns() -> list[Array]:
    """Return the 24 rotations that map the axes onto axes, the identity first."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.diag(signs)[list(order)]
            if np.linalg.det(turn) > 0.0:
                found.append(turn)
    return found


def load_shape(path: Path) -> ObjectShape:
    """Return the shape in an object's yaml file or in a mesh file (m).

    Raises:
        BadInputError: the file is missing, of another kind, or holds no shape.
    """
    require_file(path, "the shape of an object")
    if path.suffix.lower() in MESH_SUFFIXES:
        return _load_mesh(path)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise BadInputError(
            f"object shape {path}: expected a yaml file of an object, or a mesh "
            f"({', '.join(MESH_SUFFIXES)})"
        )
    values = read_yaml(path, "a yaml file of an object")
    try:
        surfaces = [_surface(shape) for shape in values["shapes"]]
        angles = _finite(values.get("rest", {}).get("rpy_deg", (0.0, 0.0, 0.0)), 3)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"object shape {path}: {error!r}; expected `shapes`") from error
    if not surfaces:
        raise BadInputError(f"object shape {path}: no shapes, expected at least one")
    return ObjectShape(surfaces, rpy_to_matrix(np.deg2rad(angles)))


def _load_mesh(path: Path) -> ObjectShape:
    mesh = read_mesh(path, "the shape of an object")
    if np.ptp(mesh.vertices, axis=0).max() > _LARGEST:
        raise BadInputError(
            f"object shape {path}: {np.ptp(mesh.vertices, axis=0).max():.0f} m long; "
            "the unit of a mesh is the metre"
        )
    return ObjectShape([MeshSurface(mesh)])


def _surface(values: Mapping[str, Any]) -> Surface:
    """Return a surface.

    Raises:
        ValueError: a size is none, or a place no finite numbers.
    """
    pose = described_pose(values)
    if not np.isfinite(pose).all():
        raise ValueError("the place of a shape is not finite")
    if "box" in values:
        return BoxSurface(0.5 * _sizes(values["box"], 3), pose)
    if "sphere" in values:
        return SphereSurface(_sizes([values["sphere"]["radius"]], 1)[0], pose[:3, 3])
    cylinder = values["cylinder"]
    radius, height = _sizes([cylinder["radius"], cylinder["height"]], 2)
    return CylinderSurface(radius, 0.5 * height, pose)


def _sizes(given: Any, count: int) -> Array:
    sizes = _finite(given, count)
    if np.any(sizes < _SMALLEST) or np.any(sizes > _LARGEST):
        raise ValueError(f"sizes {sizes.tolist()}, expected {_SMALLEST:g} to {_LARGEST:g} m")
    return sizes


def _finite(given: Any, count: int) -> Array:
    numbers = np.asarray(given, dtype=float)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ValueError(f"{str(given)[:40]}, expected {count} finite numbers")
    return numbers
