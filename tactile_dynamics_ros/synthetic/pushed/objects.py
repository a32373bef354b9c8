"""Objects on a table: prisms with ballast inside; one, two joined, or two on a hinge."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.synthetic import randomness

GRAVITY = 9.81
KINDS = ("single", "rigid_pair", "jointed")
OUTLINES = ("box", "disc", "hexagon", "triangle")

_LENGTH = (0.08, 0.14)
"""Of an outline along x, m."""
_SLENDERNESS = (0.7, 1.0)
_HEIGHT = (0.03, 0.06)
_MASS = (0.35, 1.6)
"""Of the whole object, kg."""
_FRICTION = (0.15, 0.5)
_COM_SHARE = 0.3
"""Largest offset of the centre of mass over the half extents."""
_JOINT_FRICTION = (0.01, 0.1)
"""N m."""
_GAP = 0.004
"""Between jointed parts, m."""
_STEADY = 0.3
"""Largest friction times height over the half extents: above about 0.5 a push would tip the object
over."""
_CORNERS = 48
"""Corners of a disc: at a radius of 5 cm 0.1 mm inside the circle."""


@dataclass(frozen=True)
class Link:
    """A prism of which only the underside rubs.

    Attributes:
        corners: (K, 2) m, anticlockwise, in the link's frame (origin in the middle of the outline).
        height: m.
        mass: kg. com: (2,) m. inertia: kg m^2 about the vertical through the centre of mass.
        friction: coefficient on the table.
        feet: (N, 2) m, points that carry it, link's frame.
        stiffness: (N,) of each foot against settling, relative to the others.
    """

    corners: np.ndarray
    height: float
    mass: float
    com: np.ndarray
    inertia: float
    friction: float
    feet: np.ndarray
    stiffness: np.ndarray


@dataclass(frozen=True)
class PushedObject:
    """One or two links; those of a rigid pair share one body.

    Attributes:
        kind: one of KINDS.
        links: link_1, then link_2.
        offset: (2,) m, origin of link_2 in the frame of link_1 while both point the same way.
        joint: (2,) m, of the hinge in the frame of link_1; None without.
        joint_friction: N m.
        play: m, by which the pin of the hinge is thinner than its hole, in radius.
    """

    kind: str
    links: tuple[Link, ...]
    offset: np.ndarray
    joint: np.ndarray | None
    joint_friction: float
    play: float = 0.0


def draw_object(seed: int, kind: str = "single", feet: int = 10) -> PushedObject:
    """Draw an object.

    Args:
        seed: equal seeds give equal objects.
        kind: one of KINDS.
        feet: along the longer side of an outline.
    """
    rng = randomness.stream(seed, "pushed", kind)
    count = 1 if kind == "single" else 2
    names = OUTLINES if kind == "single" else ("disc", "hexagon") if kind == "jointed" else ("box",)
    outlines = [_outline(str(rng.choice(names)), rng) for _ in range(count)]
    masses = rng.uniform(*_MASS) * rng.dirichlet(np.full(count, 5.0))
    links = tuple(_link(o, float(m), rng, feet) for o, m in zip(outlines, masses, strict=True))
    gap = _GAP if kind == "jointed" else 0.0
    reach = float(links[0].corners[:, 0].max())
    offset = np.zeros(2)
    if count == 2:
        offset = np.array([reach + gap - links[1].corners[:, 0].min(), 0.0])
    joint = np.array([reach + 0.5 * gap, 0.0]) if kind == "jointed" else None
    rubbing = float(rng.uniform(*_JOINT_FRICTION)) if kind == "jointed" else 0.0
    return PushedObject(kind, links, offset, joint, rubbing)


def _outline(name: str, rng: np.random.Generator) -> np.ndarray:
    length = rng.uniform(*_LENGTH)
    x, y = 0.5 * length, 0.5 * length * rng.uniform(*_SLENDERNESS)
    if name == "box":
        return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    if name == "triangle":
        corners = np.array([[-x, -y], [x, -y], [-x, y]])
        return corners - [-x / 3.0, -y / 3.0]
    count = _CORNERS if name == "disc" else 6
    angle = 2.0 * np.pi * np.arange(count) / count
    return x * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _link(corners: np.ndarray, mass: float, rng: np.random.Generator, feet: int) -> Link:
    """Draw what is inside an outline: a plate and ballast that moves the centre of mass."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 0.5 * (high - low)
    inside = 2.0 if len(corners) == 3 else 1.0
    middle = feet_within(corners, float((high - low).max()) / feet).mean(axis=0)
    com = middle + _COM_SHARE / inside * half * rng.uniform(-1.0, 1.0, 2)
    share = rng.uniform(0.35, 0.6)
    friction = float(rng.uniform(*_FRICTION))
    return ballasted(corners, float(rng.uniform(*_HEIGHT)), mass, com, friction, share, feet)


def ballasted(
    corners: np.ndarray,
    height: float,
    mass: float,
    com: np.ndarray,
    friction: float,
    share: float = 0.5,
    feet: int = 10,
) -> Link:
    """Return a plate with ballast at one place, cut so low that no push tips it over.

    Args:
        corners: (K, 2) m, anticlockwise, of the outline.
        height: m, at most.
        mass: kg.
        com: (2,) m.
        friction: coefficient on the table.
        share: of the mass that is ballast.
        feet: along the longer side.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    points = feet_within(corners, float((high - low).max()) / feet)
    middle = points.mean(axis=0)
    ballast = middle + (com - middle) / share
    inertia = mass * (1.0 - share) * (np.sum((points - middle) ** 2, axis=1).mean())
    inertia += mass * (1.0 - share) * np.sum((middle - com) ** 2)
    inertia += mass * share * np.sum((ballast - com) ** 2)
    low_enough = min(height, _STEADY * 0.5 * float((high - low).min()) / friction)
    area = np.full(len(points), _area(corners) / len(points))
    return Link(corners, low_enough, mass, com, float(inertia), friction, points, area)


def _area(corners: np.ndarray) -> float:
    after = np.roll(corners, -1, axis=0)
    return 0.5 * float(np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0]))


def feet_within(corners: np.ndarray, spacing: float) -> np.ndarray:
    """Return the middles (N, 2) of the cells of a square grid that lie within an outline."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    counts = np.maximum(np.round((high - low) / spacing), 1).astype(int)
    axes = [
        a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, counts, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    after = np.roll(corners, -1, axis=0)
    edge, to_point = after - corners, points[:, None] - corners
    left = edge[:, 0] * to_point[..., 1] - edge[:, 1] * to_point[..., 0]
    return points[np.all(left > 0.0, axis=1)]


def with_uneven_support(thing: PushedObject, rng: np.random.Generator, size: float) -> PushedObject:
    """Return the object on an underside that is higher in some places and in its middle or rim.

    Args:
        thing: with any underside.
        rng: of the draw.
        size: relative std of the feet's stiffness; 0 is even.
    """
    return replace(thing, links=tuple(_uneven(link, rng, size) for link in thing.links))


def _uneven(link: Link, rng: np.random.Generator, size: float) -> Link:
    half = 0.5 * np.ptp(link.corners, axis=0)
    unit = (link.feet - link.feet.mean(axis=0)) / half
    squared = np.sum(unit**2, axis=1)
    shapes = np.stack([unit[:, 0], unit[:, 1], squared - squared.mean()], axis=1)
    shapes /= shapes.std(axis=0)
    log = shapes @ rng.normal(size=3) * size / np.sqrt(3.0)
    return replace(link, stiffness=link.stiffness * np.exp(log))
