"""Parts of an object from its points: clusters, then strays that have a shape, then fewer parts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.shape.superquadric.ascent import maximise, maximise_all
from tactile_dynamics_ros.core.shape.superquadric.clustering import (
    camera_noise,
    clusters,
    into,
    own_frame,
    reach_of,
)
from tactile_dynamics_ros.core.shape.superquadric.mixture import Mixture
from tactile_dynamics_ros.core.shape.superquadric.recovery import (
    LEAST_POINTS,
    Recovery,
    check_points,
    closer,
    finished,
    recover,
    simplified,
    sketches_of_all,
    spread_choice,
)

_MATERIAL = 0.004
"""Misfit of one surface, as a share of the cloud's size, from which it may be no description of an
object with a dent or a step. Butterflies leave 0.2 to 0.4 % (numbers 5 to 35 of the planar
objects), two ellipses side by side 0.5 to 1 %. Higher takes two of them for one waisted body."""
_DENT = 0.11
"""Share of the outline's convex hull that no point lies over, from which the outline has a dent:
hexagons show 5 to 10 % by the raster's edges, two ellipses side by side 12 to 14 %, a T 20 %. Lower
splits hexagons, higher joins ellipses."""
_SLIGHT_DENT, _LARGE = 0.08, 0.0075
"""As `_DENT`, and the misfit over the size, that together speak for parts: an ellipse beside a box
leaves 0.8 to 1 %, hexagons up to 0.7 % where they seem to have a dent. Lower ones split hexagons,
higher ones leave such pairs as one body."""
_FEWEST_CELLS = 40
"""Cells of the raster of an outline below which it shows no dent: six by seven. Lower sees dents
that the raster makes, higher overlooks those of small clouds."""
_STEP = 0.2
"""Range of the tops of columns, as a share of the height, from which an object has a step. Lower
splits bodies whose noise or taper looks like a step, higher overlooks low steps."""
_COLUMN = 16
"""Points nearest in plan that make a column: their 90 % quantile is its top, whatever one stray
above it. Fewer follow strays, more blur a step."""
_HALVED = 0.7
"""Misfit with another part, over that before, from which the part is not worth having. Nearer to 1
parts are added that hardly help, at half true ones that are small are refused."""
_STRAY_SHARE = 0.04
"""Share of an object's points that lie together and off its surfaces, from which they may be a
part. Strays of a camera lie apart. Lower looks for parts at corners that a superquadric rounds."""
_PART_SHARE = 0.15
"""As `_STRAY_SHARE`, from which they are a part whatever the outline: sides of a hexagon that are
given up are a tenth of its points at most."""
_MOST_PARTS = 4
"""Parts of one object that are looked for; each costs fits of all pairs. With fewer a table-like
object loses legs, more take time that grows with the square."""
_DECISIVE = 1200
"""Points on which the number of parts is decided; all of them only place the parts. Decisions take
time in proportion; with half as many, narrow parts are overlooked."""
_STEPS = 40
"""Steps of a joint fit of parts that begin near their end. Fits end earlier where they settle;
fewer leave parts beside their optimum."""
_BEST = 2
"""Divisions that are followed to their end. With one the division that looks best at first is
final, more cost a joint fit each."""
_SKETCHED = 4
"""Starts of the sketch of a side: box, cylinder, wedges. All ten take 2.5 times as long. With
fewer, wedges begin as boxes, which may climb to another optimum."""
_SAMPLES = 500
"""Samples of a part's surface that are looked for in other parts: shares are known to 2 %. Fewer
scatter about `_INSIDE`, more cost time for each pair."""
_INSIDE = 0.35
"""Share of a part's surface inside another from which both are one body that no superquadric fits:
a face that touches is a quarter of a surface at most, two halves of a hexagon lie half in each
other. Lower joins parts that only touch, higher keeps halves of one body apart."""
_UNSHOWN_GAIN, _UNSHOWN_INSIDE = 0.9, 0.15
"""Log likelihood per point that a further part must gain, and the largest share of its surface
inside another, where neither outline nor top shows that there are two: a box beside a cylinder as
wide gains 1.5 to 1.7 with 0.06 inside at most (numbers 47 and 67), halves of hexagons 0.7 at most
with 0.22 and more (seven up to 39). Lower gains or larger shares split hexagons, the reverse leaves
such pairs as one body."""
_PRICE = 30.0
"""Log likelihood that a further part must gain: ten parameters at 3 each, for points whose errors
go together. Lower adds parts for correlated errors, higher leaves small true parts out."""


@dataclass(frozen=True)
class TableObject:
    """An object on a table.

    Attributes:
        parts: fitted parts, the largest first.
        points: (N, 3) of its cluster, m.
        floor: noise of the camera as neighbouring points show it, m.
        misfit: RMS distance from the surfaces beyond that noise, m.
        strays: share of its points that lie on no part.
    """

    parts: tuple[Recovery, ...]
    points: Array
    floor: float
    misfit: float
    strays: float


def find_objects(
    points: Array, support: float | None = None, scale: Array | None = None
) -> list[TableObject]:
    """Find the objects in a cloud without table, and their parts.

    Args:
        points: (N, 3) world, z up, m.
        support: height of the table, m; None if objects may lie in any way.
        scale: (N,) noise of the points over that of the first.

    Returns:
        Objects, the one with the most points first.

    Raises:
        BadInputError: there are too few points, or none belong together.
    """
    points = np.asarray(points, dtype=float)
    check_points(points)
    scale = np.ones(len(points)) if scale is None else scale
    found = [
        _in_own_frame(points[members], support, scale[members]) for members in clusters(points)
    ]
    if not found:
        raise BadInputError(
            f"points: none of the {len(points)} belong together; expected the surface of an object"
        )
    return found


def _in_own_frame(points: Array, support: float | None, scale: Array) -> TableObject:
    """`find_parts` where neither starts nor choices of points depend on the world's axes."""
    frame = own_frame(points, upright=support is not None)
    found = find_parts(into(frame, points), support, scale)
    parts = tuple(part.seen_from(frame) for part in found.parts)
    return replace(found, parts=parts, points=points)


def find_parts(points: Array, support: float | None, scale: Array) -> TableObject:
    """Fit as many superquadrics to one object as its points speak for.

    One is fitted first. Where it leaves a material misfit or many strays, a part is added where
    they are; if nothing but the misfit speaks for it, it must explain very much. Parts that one
    surface describes as well are merged again.
    """
    floor = camera_noise(points)
    every, all_scale = points, scale
    chosen = spread_choice(points, _DECISIVE)
    points, scale = points[chosen], scale[chosen]
    mixture = recover(points, support, scale).mixture
    while len(mixture.shapes) < _MOST_PARTS:
        shown = not _describes(mixture, points, floor)
        if not shown and _is_close(mixture, points, floor):
            break
        more = _with_another(mixture, points, floor)
        if more is None or not _is_better(more, mixture, points, floor, shown):
            break
        mixture = more
    if len(mixture.shapes) > 1:
        if len(mixture.shapes) > 2:
            mixture = _merged(mixture, points, support, floor)
        mixture = simplified(closer(mixture, points), points)
    points = every
    mixture = maximise(replace(mixture, scale=all_scale), points, _STEPS)
    order = np.argsort(-mixture.shares)
    member = mixture.memberships(points)
    misfit = _misfit(mixture, floor)
    return TableObject(
        tuple(finished(mixture, points, int(k), misfit) for k in order),
        points,
        floor,
        misfit,
        float(member[:, -1].mean()),
    )


def _misfit(mixture: Mixture, floor: float) -> float:
    return float(np.sqrt(max(mixture.noise**2 - floor**2, 0.0)))


def _is_better(more: Mixture, fewer: Mixture, points: Array, floor: float, shown: bool) -> bool:
    """Whether one part more is worth it: likelier by its price, and a much smaller misfit.

    Args:
        more: with a part more than `fewer`.
        fewer: as before.
        points: (N, 3) m.
        floor: noise of the camera, m.
        shown: whether outline, top or strays show that there is more than one.
    """
    strays = [float(m.memberships(points)[:, -1].mean()) for m in (more, fewer)]
    less = _misfit(more, floor) < _HALVED * _misfit(fewer, floor) or strays[0] < 0.7 * strays[1]
    gain = fewer.cost(points) - more.cost(points)
    price = _PRICE if shown else _UNSHOWN_GAIN * len(points)
    return less and gain > price and _inside(more) < (_INSIDE if shown else _UNSHOWN_INSIDE)


def _inside(mixture: Mixture) -> float:
    """Largest share of the surface of a part that lies within another one."""
    surfaces = [shape.sample(_SAMPLES)[0] for shape in mixture.shapes]
    return max(
        float(np.mean(other.gauge(other.to_body(surface)) < 1.0))
        for k, surface in enumerate(surfaces)
        for n, other in enumerate(mixture.shapes)
        if n != k
    )


def _is_close(mixture: Mixture, points: Array, floor: float) -> bool:
    """Whether the misfit is not material."""
    size = float(np.ptp(points, axis=0).max())
    return _misfit(mixture, floor) < max(_MATERIAL * size, floor)


def _describes(mixture: Mixture, points: Array, floor: float) -> bool:
    """Whether surfaces leave no material misfit where there is a dent or a step, and few strays."""
    size = float(np.ptp(points, axis=0).max())
    member = mixture.memberships(points)
    left = _left_together(mixture, points)
    if left > _PART_SHARE:
        return False
    if left < _STRAY_SHARE and _is_close(mixture, points, floor):
        return True
    large = _misfit(mixture, floor) > _LARGE * size
    owner = np.argmax(member, axis=1)
    return not any(_is_composed(points[owner == k], large) for k in range(len(mixture.shapes)))


def _is_composed(points: Array, large: bool) -> bool:
    """Whether points of a part have a dent in their outline or a step in their top.

    Args:
        points: (N, 3) of one part.
        large: whether the misfit is large, so that a slight dent counts.
    """
    if len(points) < LEAST_POINTS:
        return False
    return _dent(points[:, :2]) > (_SLIGHT_DENT if large else _DENT) or _step(points) > _STEP


def _left_together(mixture: Mixture, points: Array) -> float:
    """Largest share of the points that lie together and on no surface."""
    strays = mixture.memberships(points)[:, -1] > 0.5
    return max((float(c.mean()) for c in _clusters_of(points, strays)), default=0.0)


def _dent(outline: Array) -> float:
    """Share of the convex hull of points (N, 2) that none of them lies in.

    Cells of a raster are counted against those that fill their hull, A + B / 2 + 1 (Pick).
    """
    if len(outline) < LEAST_POINTS:
        return 0.0
    cell = 4.0 * float(np.sqrt(np.prod(np.ptp(outline, axis=0)) / len(outline)))
    cells, counts = np.unique(np.floor(outline / cell), axis=0, return_counts=True)
    cells = cells[counts > 1]
    if len(cells) < _FEWEST_CELLS:
        return 0.0
    hull = ConvexHull(cells)
    return float(1.0 - len(cells) / (hull.volume + 0.5 * hull.area + 1.0))


def _step(points: Array) -> float:
    """Range of the tops of columns, as a share of the height."""
    low, high = np.quantile(_tops(points[spread_choice(points, 400)]), [0.1, 0.9])
    return float((high - low) / max(np.ptp(np.quantile(points[:, 2], [0.01, 0.99])), 1e-9))


def _with_another(mixture: Mixture, points: Array, floor: float) -> Mixture | None:
    """Return the best fit with one part more, or None if there is none."""
    drafts = _drafted(mixture, points, _divisions(mixture, points), floor)[:_BEST]
    if not drafts:
        return None
    ends = maximise_all(drafts, points[None], _STEPS)
    return min(ends, key=lambda found: found.cost(points))


def _divisions(
    mixture: Mixture, points: Array
) -> list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Divisions (N,), (N,) of the points: strays and the rest, halves by place and by height."""
    member = mixture.memberships(points)
    found = []
    for cluster in _clusters_of(points, member[:, -1] > 0.5):
        found.append((~cluster, cluster))
    worst = int(np.argmax([np.sum(member[:, k]) for k in range(len(mixture.shapes))]))
    own = member[:, worst] + member[:, -1] > 0.5
    flat = points[:, :2] - np.median(points[own, :2], axis=0)
    _, _, axes = np.linalg.svd(flat[own], full_matrices=False)
    along = flat @ axes.T
    for values in (along[:, 0], along[:, 1], _tops(points)):
        for cut in _cuts(values[own]):
            found.append((own & (values <= cut), own & (values > cut)))
    return found


def _clusters_of(points: Array, chosen: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """Clusters (N,) among chosen points; none where there are too few."""
    indices = np.flatnonzero(chosen)
    if len(indices) < 2 * LEAST_POINTS:
        return []
    found = []
    for members in clusters(points[indices], reach_of(points))[:2]:
        mask = np.zeros(len(points), dtype=bool)
        mask[indices[members]] = True
        found.append(mask)
    return found


def _tops(points: Array) -> Array:
    """Height (N,) of the highest point in the column of each point."""
    near = cKDTree(points[:, :2]).query(points[:, :2], min(_COLUMN, len(points)))[1]
    return np.asarray(np.quantile(points[near, 2], 0.9, axis=1))


def _cuts(values: Array) -> list[float]:
    """Values at a third, half and two thirds of the range."""
    low, high = np.quantile(values, [0.02, 0.98])
    return [float(low + share * (high - low)) for share in (1 / 3, 1 / 2, 2 / 3)]


def _drafted(
    mixture: Mixture,
    points: Array,
    divisions: list[tuple[NDArray[np.bool_], NDArray[np.bool_]]],
    floor: float,
) -> list[Mixture]:
    """Sketch both sides of divisions beside the parts that are not divided, the best first."""
    divisions = [d for d in divisions if min(int(side.sum()) for side in d) >= LEAST_POINTS]
    if not divisions:
        return []
    member = mixture.memberships(points)
    chart = replace(mixture.chart, plain=False)
    sets = [(points[side], mixture.scale[side]) for division in divisions for side in division]
    sides = [found[0] for found in sketches_of_all(sets, chart, floor, _SKETCHED)]
    drafts = []
    for n, (one, other) in enumerate(divisions):
        divided = int(np.argmax(member[one | other].sum(axis=0)[:-1]))
        kept = [shape for k, shape in enumerate(mixture.shapes) if k != divided]
        pair = sides[2 * n : 2 * n + 2]
        shapes = (*kept, *(side.shapes[0] for side in pair))
        noise = max(side.noise for side in pair)
        drafts.append(Mixture.around(shapes, points, mixture.scale, chart, noise))
    return sorted(drafts, key=lambda draft: draft.cost(points))


def _merged(mixture: Mixture, points: Array, support: float | None, floor: float) -> Mixture:
    """Return a fit with fewer parts while one surface describes two of them as well."""
    while len(mixture.shapes) > 1:
        member = mixture.memberships(points)
        fewer = [
            found
            for a in range(len(mixture.shapes))
            for b in range(a)
            for found in [_union(mixture, points, member, (a, b), support)]
            if found is not None and _describes(found, points, floor)
        ]
        if not fewer:
            return mixture
        mixture = min(fewer, key=lambda found: found.cost(points))
    return mixture


def _union(
    mixture: Mixture, points: Array, member: Array, pair: tuple[int, int], support: float | None
) -> Mixture | None:
    """Fit one surface to the points of two parts, beside the others."""
    own = member[:, list(pair)].sum(axis=1) > 0.5
    if own.sum() < LEAST_POINTS:
        return None
    one = recover(points[own], support, mixture.scale[own])
    others = [s for k, s in enumerate(mixture.shapes) if k not in pair]
    start = Mixture.around(
        (*others, one.shape), points, mixture.scale, mixture.chart, one.mixture.noise
    )
    return maximise(start, points, _STEPS)
