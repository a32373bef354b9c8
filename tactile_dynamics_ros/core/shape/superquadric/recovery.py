"""A superquadric from the points of one object or of one of its parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.shape.superquadric.ascent import maximise, maximise_all
from tactile_dynamics_ros.core.shape.superquadric.chart import Chart
from tactile_dynamics_ros.core.shape.superquadric.mixture import Mixture
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric

LEAST_POINTS = 30
"""Points below which nothing is fitted: three per parameter. Fewer let noise choose exponents, more
refuse small or far objects."""
_FEW = 300
"""Points that starts are compared on: their optima are then found to some tenths of the noise. All
points would cost in proportion, fewer confuse similar starts."""
_SOME = 800
"""Points on which the best starts are followed to their end and compared; all points only polish
the best, which takes few steps. Fewer let similar starts change places."""
_SKETCHED_TO = 1e-4
"""Move of a surface over the cloud's size at which a sketch ends: 10 um of 10 cm. Larger ranks
starts that have not come far, smaller polishes ones that are dropped."""
_TURNS = np.deg2rad(np.arange(0.0, 90.0, 5.0))
"""Turns about the vertical at which the bounding rectangle is measured. Between two of them the
rectangle of a long box is wider by a twentieth of its length, which fits find. Coarser turns begin
fits of long boxes too wide, finer ones find what the fit finds anyway."""
_QUANTILE = 0.02
"""Share of points beyond each side of the bounding rectangle: strays are cut off. With a tenth of
strays around an object as large as their box, a fifth of them lie beyond each side, which leaves
the start a little large. More cuts off corners, less lets strays set the size."""
_FIRST_NOISE = 0.1
"""Noise of the first step, as a share of the cloud's size: all of the object lies within it. A
tenth of it gives sides up as strays before the surface has come near, more forgets the start."""
_GRANTED = 0.006
"""Noise that is granted at first, as a share of the cloud's size: 0.7 mm on 12 cm, about what a
hexagon is off any superquadric. Less gives sides of it up as strays, more blurs small parts."""
_GIVEN_UP = 0.03
"""Share of points that a closer fit may call strays beyond those that the first one did. Lower
keeps the blurred fit of clean clouds, higher lets a close fit drop a side of the object."""
POSITION_NAMES = ("x", "y", "z")
"""Coordinates of a chart that are positions in the world, m."""
_ROUNDED = 7e-4
"""Standard deviation of ln a_x, ln a_y and ln a_z beside that by noise: even the least exponents
round edges that are sharp, which costs axes 0.02 to 0.07 mm of 3 to 7 cm (ten boxes, ellipses and
cylinders among the planar objects up to 19). Without it, intervals of many points are too small."""
_BLUNT_WEDGE, _BLUNT_TIPS = 0.02, 0.22
"""Standard deviation of ln a_x and ln a_y per unit of k1, of -k2: corners of a triangle lie 1 to
2.5 % of the half width beyond the surface, those of a hexagon (k2 = -0.5), whose sides are straight
where the taper is a parabola, 11 % (numbers 3, 4, 51, 54, 57 and 58). Lower tells sizes of such
bodies too surely, higher hides what is known of them."""
_SHORT, _LONG, _POLISH = 12, 40, 40
"""Steps at most of starts on few points, of the best ones on some, and of the end on all. Fits end
earlier where they settle, most after 10 to 20 steps. Fewer cut off fits that still move, more cost
time only for those that do not settle."""
_NEARLY = 1e-5
"""Move of a surface over the cloud's size at which a fit to some of the points ends: 1 um of 10 cm;
what is decided by its likelihood does not hang on that. Larger compares fits that still move,
smaller takes steps for digits that polishing finds."""
_BEST = 2
"""Starts that are followed to their end: the best may be beaten by the second on all points. With
one that second is lost, more cost a fit each."""
_TAPER_PRICE = 0.0075
"""Log likelihood per point that tapers must gain to be believed: 15 of 2000 points, two parameters
at ln N each, for points whose errors go together. Lower, cylinders come out as waisted boxes that
fit as well; higher, blunt wedges come out straight."""
_SECTIONS = (0.3, 1.0)
"""Exponents e2 of starts: a box and a cylinder; a diamond is a box turned by 45 deg. Fits go on
from there; with one of them alone the other section is found late or not."""
_TAPERED = ((0.3, 0.5, 0.0), (0.3, -0.5, 0.0), (0.1, 0.0, -0.5))
"""e2, k1 and k2 of starts that are not straight: wedges either way, and a hexagon, whose sides run
from its full width to half of it. Without them wedges and hexagons end as boxes with a misfit; each
more costs a short fit per turn."""


@dataclass(frozen=True)
class Recovery:
    """A superquadric that was fitted, and how well.

    Attributes:
        mixture: the fit, of one part.
        covariance: (P, P) of the chart's coordinates; axes as logarithms.
        points: number of points.
        foot_std: standard deviation of the height of its foot where nobody saw it, m.
    """

    mixture: Mixture
    covariance: Array
    points: int
    foot_std: float = 0.0

    @property
    def shape(self) -> Superquadric:
        """The surface."""
        return self.mixture.shapes[0]

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by coordinate; those of the semi-axes in m."""
        root = np.sqrt(np.diag(self.covariance))
        found = dict(zip(self.mixture.chart.names, map(float, root), strict=True))
        for name, axis in zip("xyz", self.shape.semi_axes, strict=True):
            found[f"a{name}"] = found.pop(f"ln_a{name}") * float(axis)
        found["az"] = float(np.hypot(found["az"], 0.5 * self.foot_std))
        return found

    def seen_from(self, frame: Array) -> Recovery:
        """Return it in the frame in which `frame` (4, 4), where it was fitted, is expressed.

        Positions are coordinates of that frame, turns those of the body, which stay.
        """
        shapes = tuple(replace(one, pose=frame @ one.pose) for one in self.mixture.shapes)
        turn = np.eye(len(self.covariance))
        place = [k for k, name in enumerate(self.mixture.chart.names) if name in POSITION_NAMES]
        turn[np.ix_(place, place)] = frame[: len(place), : len(place)]
        covariance = turn @ self.covariance @ turn.T
        return replace(self, mixture=replace(self.mixture, shapes=shapes), covariance=covariance)


def recover(
    points: Array, support: float | None = None, scale: Array | None = None, least: float = 0.0
) -> Recovery:
    """Fit one superquadric to points, some of which may be strays.

    Expectation maximisation over noise, strays and shape (`Mixture`), from several starts: boxes
    and cylinders along the sides of the tightest upright rectangle and across it, plain and
    tapered either way. Source: paper B, Eq. 3 to 9.

    Args:
        points: (N, 3) world, z up, m.
        support: height of the table on which the object stands, m; None if it may lie in any way.
        scale: (N,) noise of the points over that of the first; equal by default.
        least: standard deviation of points below which none is believed, m.

    Raises:
        BadInputError: there are fewer than 30 points, or they do not span a volume.
    """
    points = np.asarray(points, dtype=float)
    check_points(points)
    scale = np.ones(len(points)) if scale is None else scale
    chart = Chart(support)
    granted = max(least, _GRANTED * float(np.ptp(points, axis=0).max()))
    starts = sketches(points, chart, scale, granted)[:_BEST]
    chosen = spread_choice(points, _SOME)
    some = points[chosen]
    within = [replace(start, scale=scale[chosen]) for start in starts]
    ends = maximise_all(within, some[None], _LONG, _NEARLY)
    best = min(ends, key=lambda mixture: mixture.cost(some))
    fine = replace(closer(best, some, least), scale=scale)
    return finished(simplified(maximise(fine, points, _POLISH, _NEARLY), points), points)


def closer(mixture: Mixture, points: Array, least: float = 0.0) -> Mixture:
    """Return a fit without granted noise, if it gives up hardly any points for that.

    Of a body that no superquadric fits, as a hexagon, the likeliest surface lies close to some of
    its sides and calls the others strays; a compromise between all of them is kept instead.
    """
    size = float(np.ptp(points, axis=0).max())
    granted = replace(mixture, least=max(least, _GRANTED * size))
    coarse = maximise(granted, points, _LONG, _NEARLY)
    fine = maximise(replace(coarse, least=least), points, _LONG, _NEARLY)
    strays = [float(m.memberships(points)[:, -1].mean()) for m in (fine, coarse)]
    return fine if strays[0] < strays[1] + _GIVEN_UP else coarse


def sketches(
    points: Array, chart: Chart, scale: Array, least: float = 0.0, most: int | None = None
) -> list[Mixture]:
    """Return short fits to some of the points from several starts, the best first.

    Args:
        points: (N, 3) world, m.
        chart: coordinates.
        scale: (N,) noise of the points over that of the first.
        least: standard deviation of points below which none is believed, m.
        most: starts that are tried; all by default.
    """
    return sketches_of_all([(points, scale)], chart, least, most)[0]


def sketches_of_all(
    sets: Sequence[tuple[Array, Array]], chart: Chart, least: float, most: int | None = None
) -> list[list[Mixture]]:
    """Return `sketches` of several sets of points, each with its scale of the noise, at once."""
    chosen = [spread_choice(points, _FEW) for points, _ in sets]
    width = max(len(few) for few in chosen)
    starts: list[Mixture] = []
    rows: list[int] = []
    clouds, weights = np.zeros((len(sets), width, 3)), np.zeros((len(sets), width))
    for row, ((points, scale), few) in enumerate(zip(sets, chosen, strict=True)):
        cloud = points[few]
        padded = np.ones(width)
        padded[: len(few)] = scale[few]
        clouds[row], weights[row, : len(few)] = cloud[0], 1.0
        clouds[row, : len(few)] = cloud
        noise = _FIRST_NOISE * float(np.ptp(points, axis=0).max())
        for start in islice(starts_around(cloud, chart.support), most):
            starts.append(
                Mixture.around([chart.settled(start)], cloud, padded, chart, noise, least)
            )
            rows.append(row)
    ends = maximise_all(starts, clouds[rows], _SHORT, tolerance=_SKETCHED_TO, weights=weights[rows])
    costs = [end.cost(clouds[row], weights[row]) for end, row in zip(ends, rows, strict=True)]
    order = np.argsort(costs, kind="stable")
    return [[ends[k] for k in order if rows[k] == row] for row in range(len(sets))]


def simplified(mixture: Mixture, points: Array) -> Mixture:
    """Return a fit without tapers if points hardly speak for them."""
    straight = tuple(replace(shape, taper=np.zeros(2)) for shape in mixture.shapes)
    chart = replace(mixture.chart, plain=True)
    plain = maximise(replace(mixture, shapes=straight, chart=chart), points, _LONG)
    gain = plain.cost(points) - mixture.cost(points)
    return plain if gain < _TAPER_PRICE * len(points) * len(mixture.shapes) else mixture


def finished(mixture: Mixture, points: Array, part: int = 0, misfit: float = 0.0) -> Recovery:
    """Return one part of a fit with its covariance.

    Args:
        mixture: the fit.
        points: (N, 3) m.
        part: number of the part.
        misfit: RMS distance of points from the surfaces beyond the camera's noise, m. No number of
            points averages it out, so semi-axes and position are uncertain by as much.
    """
    alone = replace(mixture, shapes=mixture.shapes[part : part + 1], shares=np.ones(1))
    member = mixture.memberships(points)[:, part]
    covariance = alone.covariance(points, member)
    shape = alone.shapes[0]
    k1, k2 = shape.taper
    blunt = np.array([1.0, 1.0, 0.0]) * (_BLUNT_WEDGE * abs(k1) + _BLUNT_TIPS * max(-k2, 0.0))
    covariance[np.arange(3), np.arange(3)] += (
        _ROUNDED**2 + (misfit / shape.semi_axes) ** 2 + blunt**2
    )
    place = [k for k, name in enumerate(alone.chart.names) if name in POSITION_NAMES]
    covariance[place, place] += misfit**2
    return Recovery(alone, covariance, len(points))


def check_points(points: Array) -> None:
    """Refuse points that cannot be fitted.

    Raises:
        BadInputError: there are too few, or they do not span a volume.
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise BadInputError(f"points: shape {points.shape}, expected (N, 3) in metres")
    if len(points) < LEAST_POINTS:
        raise BadInputError(f"points: {len(points)}, expected at least {LEAST_POINTS} of an object")
    if not np.all(np.isfinite(points)):
        raise BadInputError("points: some are not finite; leave invalid pixels out")
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if singular[1] < 1e-6 * singular[0] or singular[0] == 0.0:
        raise BadInputError("points: they lie on a line; expected the surface of an object")


def spread_choice(points: Array, count: int) -> NDArray[np.intp]:
    """Return indices of about `count` points, the same whatever the order of the points.

    Points are taken at even steps of their distance from the middle.
    """
    return even_choice(np.linalg.norm(points - np.median(points, axis=0), axis=1), count)


def even_choice(values: Array, count: int) -> NDArray[np.intp]:
    """Return indices of `count` of N values, or all: at even steps of their order."""
    if len(values) <= count:
        return np.arange(len(values))
    order = np.argsort(values, kind="stable")
    return order[np.linspace(0, len(values) - 1, count).round().astype(np.intp)]


def starts_around(points: Array, support: float | None) -> Iterator[Superquadric]:
    """Yield shapes from which a fit may start."""
    frames = [np.eye(3)] if support is not None else _principal_frames(points)
    for frame in frames:
        turned = points @ frame
        low, high = _reach(turned[:, 2])
        if support is not None:
            low = min(support, high - 1e-3)
        yaw = _tightest(turned[:, :2])
        for turn in (yaw, yaw + 0.5 * np.pi):
            pose, half = _box(turned, turn)
            half[2] = max(0.5 * (high - low), 0.05 * half[:2].min())
            pose[2, 3] = 0.5 * (high + low)
            pose[:3, :3], pose[:3, 3] = frame @ pose[:3, :3], frame @ pose[:3, 3]
            plain = [(e2, 0.0, 0.0) for e2 in _SECTIONS] if turn == yaw else []
            for e2, *taper in [*plain, *_TAPERED]:
                yield Superquadric(half, np.array([0.3, e2]), np.array(taper), pose)
        pose, half = _box(turned, yaw + 0.25 * np.pi)
        half[2], pose[2, 3] = max(0.5 * (high - low), 1e-3), 0.5 * (high + low)
        pose[:3, :3], pose[:3, 3] = frame @ pose[:3, :3], frame @ pose[:3, 3]
        yield Superquadric(half, np.array([0.3, 0.5]), np.zeros(2), pose)


def _principal_frames(points: Array) -> list[Array]:
    """Right-handed frames with each principal axis as z."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    frames = [np.roll(axes, k, axis=0).T for k in range(3)]
    return [frame * [1.0, 1.0, np.sign(np.linalg.det(frame))] for frame in frames]


def _tightest(points: Array) -> float:
    """Turn about z, rad, of the rectangle of least area around points (N, 2)."""
    turned = np.hstack([points @ _plane(turn) for turn in _TURNS])
    low, high = _reach(turned)
    areas = np.prod((high - low).reshape(-1, 2), axis=1)
    return float(_TURNS[int(np.argmin(areas))])


def _box(points: Array, turn: float) -> tuple[Array, Array]:
    """Pose (4, 4) and half edges (3,) of the rectangle around points at a turn; z is left open."""
    low, high = _reach(points[:, :2] @ _plane(turn))
    pose = np.eye(4)
    pose[:3, :3] = exp_so3(np.array([0.0, 0.0, turn]))
    pose[:2, 3] = _plane(turn) @ (0.5 * (low + high))
    return pose, np.array([*np.maximum(0.5 * (high - low), 1e-4), 1e-4])


def _plane(turn: float) -> Array:
    c, s = np.cos(turn), np.sin(turn)
    return np.array([[c, -s], [s, c]])


def _reach(values: Array) -> Array:
    """Lowest and highest values but for strays, along the first axis."""
    return np.asarray(np.quantile(values, [_QUANTILE, 1.0 - _QUANTILE], axis=0))
