"""Forms of laws that may act on a pushed object: free exponents, places, frequencies and rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.laws.search import leeway
from tactile_dynamics_ros.core.effects.formula.file import require_effect_name
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.planar.diagnosis.fitted import FittedPushes
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.load import SPAN, at_point
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED, PUSHED_EFFECT_NAMES
from tactile_dynamics_ros.core.planar.effects.situation import PlanarMotion
from tactile_dynamics_ros.core.planar.effects.support import scaled
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned

Values = dict[str, Any]

_DISTANCE, _SPEED = 0.1, 0.1
"""Distance, m, and speed, m/s, at which sizes are stated: those of a push. Others state the same
laws with other sizes."""
_SLOWEST = 5e-3
"""Speed, m/s, below which a law of speed fades: noise of poses has no direction. More takes slow
motion out of it."""
_NEAREST = 1e-3
"""Distance, m, that keeps a pull finite where its place is met; far below a magnet's extent."""
_GRID = 5
"""Tried places along each axis of the table, from a quarter of the way before the pushes to one
after them. Seven take twice the time; fits move between them."""
_PULLS, _DRAGS = (-3.0, -1.0, 1.0, 3.0), (0.0, 0.5, 1.0, 2.0, 3.0)
"""Exponents of distance and of speed at which fits start and move between: from a magnet to a
stiffening spring, from dry friction to a drag with the cube."""
_RATES = (1.0, 0.3, 0.1, 0.05)
"""Rates at which decays start, 1/s: time constants from 1 s to 20 s, as a recording shows them."""
_WIDTHS = (0.03, 0.06, 0.12)
"""Widths of spots of friction at which fits start, m: from what a footprint of 10 cm just feels to
a spot as large as the way of a push."""
_FARTHEST_POINT = 0.1
"""Distance of a start's point from the centroid at most, m: an object that a robot pushes is not
larger. It bounds starts only."""


def _along_xy(
    stem: str, unit: str, prior: float, text: str, typical: float
) -> tuple[EffectParameter, ...]:
    """Two parameters with the same prior."""
    return tuple(EffectParameter(f"{stem}_{axis}", unit, prior, text, typical) for axis in "xy")


_POINT = _along_xy("point", "m", 0.1, "point of the object from its centroid", 0.02)
"""Where a law acts, prior as of a pull in the catalogue."""
_PLACE = _along_xy("place", "m", 0.5, "place on the table", 0.1)
"""A place, prior half a metre: as far as a robot that pushes reaches."""
_POWER = EffectParameter("power", "1", 5.0, "exponent", 1.0)
"""An exponent, prior 5: laws of nature have -4 to 3."""
_SIZE = EffectParameter("size", "N", 3.0, "force at the reference", 0.3)
"""A size, prior 3 N: as much as it takes to push the objects of a table."""


class PushedModel(Protocol):
    """What forms ask of a model of pushes."""

    @property
    def pushes(self) -> FittedPushes:
        """Motion and common numbers."""

    def columns_of(self, effect: PushEffect) -> Array:
        """White columns (M, m) of what spans an effect."""


class PushedLaw(PushEffect):
    """A law of a form, as it is searched or as a file of effects states it.

    Attributes:
        learnt: values from which parameters count, by name; empty while it is searched.
        spanned: parameters (m, k) whose effects are screened; None for derivatives near zero.
    """

    family = "user"
    looks_like = "A residual that follows the formula."
    sentence = "a law that was learnt acts on the object"
    remedy = "Remove its cause, or keep it in the model."
    learnt: ClassVar[Mapping[str, float]] = {}
    spanned: Array | None = None

    def family_thetas(self) -> Array | None:
        """Those of the search."""
        return self.spanned

    def numbers(self, theta: Array) -> dict[str, float]:
        """Values of all parameters by name."""
        pairs = zip(self.parameters, theta, strict=True)
        return {p.name: float(value) + self.learnt.get(p.name, 0.0) for p, value in pairs}


def _pair(numbers: Mapping[str, float], stem: str) -> Array:
    """(2,) of the numbers along x and y."""
    return np.array([numbers[f"{stem}_{axis}"] for axis in "xy"])


class PlacePull(PushedLaw):
    """A pull toward a place of the table that grows or falls with distance."""

    name = "place_pull"
    formula = "size (d/0.1 m)^power gap/d at a point, d^2 = gap^2 + extent^2, gap to a place"
    parameters = (_SIZE, _POWER, *_PLACE, *_POINT, EffectParameter("extent", "m", 0.03, "extent"))

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """Toward the place, at the point."""
        n = self.numbers(theta)
        point = _pair(n, "point")
        here = motion.place + turned(np.broadcast_to(point, motion.place.shape), motion.yaw)
        gap = _pair(n, "place") - here
        distance = np.sqrt(np.sum(gap**2, axis=1) + n["extent"] ** 2 + _NEAREST**2)
        size = n["size"] * (distance / _DISTANCE) ** n["power"] / distance
        return at_point(size[:, None] * gap, point, motion.yaw)


class SpeedDrag(PushedLaw):
    """A drag of the table that grows with a power of speed."""

    name = "speed_drag"
    formula = "-size (speed/0.1 m/s)^power along the velocity, rotation in proportion"
    parameters = (_SIZE, _POWER)

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """Against velocity and rotation."""
        n, pace = self.numbers(theta), np.hypot(motion.speed, _SLOWEST)
        size = n["size"] * (pace / _SPEED) ** n["power"] / pace
        turning = motion.gyration * motion.rate
        return np.asarray(-size[:, None] * np.column_stack([motion.velocity, turning]))


class AxisDrag(PushedLaw):
    """A drag along one axis of the table only."""

    name = "axis_drag"
    formula = "-size (u/0.1 m/s)^power along an axis, u the speed along it"
    parameters = (_SIZE, _POWER, EffectParameter("azimuth", "rad", 3.0, "of the axis, from x", 0.5))

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """Against the speed along the axis, at the centroid."""
        n = self.numbers(theta)
        axis = np.array([np.cos(n["azimuth"]), np.sin(n["azimuth"])])
        along = motion.velocity @ axis
        pace = np.hypot(along, _SLOWEST)
        size = -n["size"] * (pace / _SPEED) ** n["power"] * along / pace
        return np.column_stack([size[:, None] * axis, np.zeros(len(size))])


class FrictionSpot(PushedLaw):
    """Friction that is more, or less, around one place of the table."""

    name = "friction_spot"
    formula = "mu (1 + size exp(-|p - place|^2 / (2 width^2)))"
    parameters = (
        EffectParameter("size", "", 0.5, "relative change of friction at the place", 0.2),
        *_PLACE,
        EffectParameter("width", "m", 0.2, "standard deviation of the spot", 0.05),
    )

    def friction(self, motion: PlanarMotion, theta: Array) -> Array:
        """Factor by place."""
        return scaled(1.0 + self._spot(motion, theta)[0])

    def rise(self, motion: PlanarMotion, theta: Array) -> Array:
        """The side of the object that lies nearer to the place resists more, or less."""
        spot, gap, width = self._spot(motion, theta)
        return np.asarray((spot / np.maximum(1.0 + spot, 0.1) / width**2)[:, None] * gap)

    def _spot(self, motion: PlanarMotion, theta: Array) -> tuple[Array, Array, float]:
        n = self.numbers(theta)
        gap, width = _pair(n, "place") - motion.place, abs(n["width"]) + 1e-3
        return n["size"] * np.exp(-0.5 * np.sum(gap**2, axis=1) / width**2), gap, width


class Swing(PushedLaw):
    """A force that swings at one frequency, in axes of the object."""

    name = "swing"
    formula = "(cosine cos + sine sin)(2 pi frequency t) at a point, axes of the object"
    parameters = (
        EffectParameter("frequency", "Hz", 30.0, "frequency", 1.0),
        *_along_xy("cosine", "N", 3.0, "force with the cosine", 0.3),
        *_along_xy("sine", "N", 3.0, "force with the sine", 0.3),
        *_POINT,
    )

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """Turned with the object."""
        n = self.numbers(theta)
        phase = 2.0 * np.pi * n["frequency"] * motion.time
        waves = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        sizes = np.stack([_pair(n, "cosine"), _pair(n, "sine")])
        return at_point(turned(waves @ sizes, motion.yaw), _pair(n, "point"), motion.yaw)


class Fade(PushedLaw):
    """A pull, always the same way, that fades."""

    name = "fade"
    formula = "push exp(-rate t) at a point, axes of the table"
    parameters = (
        EffectParameter("rate", "1/s", 3.0, "rate of decay", 0.3),
        *_along_xy("push", "N", 3.0, "force at the start", 0.3),
        *_POINT,
    )

    def wrench(self, motion: PlanarMotion, theta: Array) -> Array:
        """At the point."""
        n = self.numbers(theta)
        fading = np.exp(-n["rate"] * (motion.time - motion.time[0]))
        return at_point(fading[:, None] * _pair(n, "push"), _pair(n, "point"), motion.yaw)


@dataclass(frozen=True)
class PushedForm:
    """A form of law of a pushed object; see `laws.search.LawForm`.

    Attributes:
        kind: its effect.
        words: what it is, with names of its parameters in braces.
        linear: parameters that are sizes.
        grid: gives values of parameters from which fits start.
        reference: value and unit of the quantity at which the size is stated.
        lever: whether the point comes from columns at two more points.
        line: whether starts are at frequencies of the spectrum.
    """

    kind: type[PushedLaw]
    words: str
    linear: tuple[str, ...]
    grid: Callable[[PlanarMotion], list[Values]]
    reference: tuple[float, str] | None = None
    lever: bool = False
    line: bool = False

    @property
    def name(self) -> str:
        """Of the form and of its effect."""
        return self.kind.name

    @cached_property
    def effect(self) -> PushedLaw:
        """The law as an effect."""
        return self.kind()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.kind.parameters)

    def starts(self, model: PushedModel, frequencies: Sequence[float]) -> list[Array]:
        """Parameters from which fits may start."""
        lines = [{"frequency": f} for f in sorted(set(frequencies))]
        grid = lines if self.line else self.grid(model.pushes.motion())
        return [np.array([values.get(name, 0.0) for name in self.names]) for values in grid]

    def columns(self, model: PushedModel, start: Array) -> Array:
        """White columns of each size, and of the first at two more points."""
        searched, rows = self.kind(), []
        for name in self.linear:
            rows.append(start.copy())
            rows[-1][[self.names.index(one) for one in self.linear]] = 0.0
            rows[-1][self.names.index(name)] = 1.0
        for axis in "xy" if self.lever else "":
            rows.append(rows[0].copy())
            rows[-1][self.names.index(f"point_{axis}")] = SPAN
        searched.spanned = np.array(rows)
        return model.columns_of(searched)

    def completed(self, start: Array, coefficients: Array) -> Array:
        """Start with sizes, and the point by the shares of the columns at other points."""
        theta, count = start.copy(), len(self.linear)
        theta[[self.names.index(name) for name in self.linear]] = coefficients[:count]
        if self.lever and abs(size := float(coefficients.sum())) > 0.0:
            point = SPAN * coefficients[1:] / size
            far = max(1.0, float(np.linalg.norm(point)) / _FARTHEST_POINT)
            theta[self.names.index("size")] = size
            theta[[self.names.index(f"point_{axis}") for axis in "xy"]] = point / far
        return theta

    def require_name(self, name: str, where: str) -> None:
        """Check that a law may have a name.

        Raises:
            BadInputError: it is that of a known effect, or no name.
        """
        require_effect_name(name, where)
        if name in PUSHED_EFFECT_NAMES:
            raise BadInputError(f"{where}: '{name}' is taken by the catalogue; use another name")

    def entry_of(self, found: Mapping[str, Mapping[str, Any]]) -> Values:
        """Entry of a file of effects: the form, what was learnt, and how far that is known."""
        return {
            "law_of_pushed": self.name,
            "learnt": {name: float(found[name]["value"]) for name in self.names},
            "std": {name: float(found[name]["std"]) for name in self.names},
        }

    def term_of(self, found: Mapping[str, Mapping[str, Any]]) -> Values:
        """Formula, axes and point of the law."""
        at = [float(found[f"point_{a}"]["value"]) for a in "xy" if f"point_{a}" in found]
        axes = "body" if self.line else "support"
        return {"formula": self.kind.formula, "frame": axes, "acts_at": at or "centroid"}


def pushed_forms() -> tuple[PushedForm, ...]:
    """All forms that are tried."""
    at = "at {point} m of the object"
    return (
        PushedForm(PlacePull, f"a pull toward {{place}} m of the table, {at}, ~ distance^{{power}}",
                   ("size",), _pulls, (_DISTANCE, "m"), lever=True),
        PushedForm(SpeedDrag, "a drag ~ speed^{power}", ("size",),
                   lambda _: [{"power": n} for n in _DRAGS], (_SPEED, "m/s")),
        PushedForm(AxisDrag, "a drag along the axis at {azimuth} rad only, ~ speed^{power}",
                   ("size",), _axes, (_SPEED, "m/s")),
        PushedForm(FrictionSpot, "friction that differs by {size} of it around {place} m, "
                   "width {width} m", ("size",), _spots),
        PushedForm(Swing, f"a force that swings at {{frequency}} Hz with the object, {at}",
                   ("cosine_x", "cosine_y", "sine_x", "sine_y"), lambda _: [], line=True),
        PushedForm(Fade, f"a force {{push}} N that fades at {{rate}} 1/s, {at}",
                   ("push_x", "push_y"), lambda _: [{"rate": r} for r in _RATES]),
    )  # fmt: skip


def read_law(name: str, entry: Mapping[str, Any], where: str) -> type[PushedLaw]:
    """Effect of a law in a file: sizes free, the rest as learnt with what may change of it.

    Args:
        name: of the effect.
        entry: as `PushedForm.entry_of` gives it.
        where: what messages name.

    Raises:
        BadInputError: there is no such form, or a number is missing.
    """
    forms = {one.name: one for one in pushed_forms()}
    form = forms.get(str(entry.get("law_of_pushed")))
    values, stds = entry.get("learnt"), entry.get("std")
    if form is None or not isinstance(values, Mapping) or not isinstance(stds, Mapping):
        raise BadInputError(f"{where}: expected law_of_pushed ({', '.join(forms)}), learnt and std")
    parameters, learnt = [], {}
    for p in form.kind.parameters:
        try:
            value, std = float(values[p.name]), float(stds[p.name])
        except (KeyError, TypeError, ValueError):
            raise BadInputError(f"{where}: {p.name}: expected a number in learnt and std") from None
        prior = max(p.prior_std, leeway(abs(value)))
        if p.name not in form.linear:
            learnt[p.name], prior = value, leeway(std)
        parameters.append(EffectParameter(p.name, p.unit, prior, p.description, prior))
    form.require_name(name, where)
    body = {"name": name, "parameters": tuple(parameters), "learnt": learnt}
    return PUSHED.register(type(name, (form.kind,), body))


def _pulls(motion: PlanarMotion) -> list[Values]:
    places = _places(motion)
    return [{"power": n, **place, "extent": 0.01} for n, place in product(_PULLS, places)]


def _axes(motion: PlanarMotion) -> list[Values]:
    angles = np.arange(4) * np.pi / 4.0
    return [{"power": n, "azimuth": float(a)} for n, a in product(_DRAGS, angles)]


def _spots(motion: PlanarMotion) -> list[Values]:
    return [{**place, "width": w} for w, place in product(_WIDTHS, _places(motion))]


def _places(motion: PlanarMotion) -> list[Values]:
    """Places of a grid over the pushes and a little beyond."""
    low, span = motion.place.min(axis=0), np.ptp(motion.place, axis=0)
    steps = np.linspace(-0.25, 1.25, _GRID)
    grid = product(*(low[k] + steps * span[k] for k in (0, 1)))
    return [{"place_x": float(x), "place_y": float(y)} for x, y in grid]
