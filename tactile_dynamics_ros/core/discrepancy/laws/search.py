"""Which form of law takes most from a residual: many are searched at once, noise alone as well."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel, instants
from tactile_dynamics_ros.core.discrepancy.screening import FEIGNED, orthonormal
from tactile_dynamics_ros.core.discrepancy.structure import periodogram
from tactile_dynamics_ros.core.discrepancy.trials import evidence
from tactile_dynamics_ros.core.progress import tell


class LawForm(Protocol):
    """A family of laws with the same formula and free parameters, of one kind of model."""

    @property
    def name(self) -> str:
        """Name of the form."""

    @property
    def effect(self) -> Any:
        """The law as an effect that the model can be fitted with."""

    @property
    def words(self) -> str:
        """What the law is, with names of its parameters in braces."""

    @property
    def linear(self) -> tuple[str, ...]:
        """Names of the parameters that are sizes: the law is linear in them."""

    @property
    def reference(self) -> tuple[float, str] | None:
        """Value and unit of the quantity at which the size is stated."""

    def require_name(self, name: str, where: str) -> None:
        """Check that a law may have a name.

        Raises:
            BadInputError: it is that of a known effect, or no name.
        """

    def entry_of(self, found: Any) -> dict[str, Any]:
        """Entry of a file of effects, of the value, std and unit by parameter."""

    def term_of(self, found: Any) -> dict[str, Any]:
        """Formula, axes and point of the law, of the same."""

    def starts(self, model: Any, frequencies: Sequence[float]) -> list[Array]:
        """Parameters (k,) from which fits may start.

        Args:
            model: without the law.
            frequencies: of the strongest line of each spectrum that is searched, Hz.
        """

    def columns(self, model: Any, start: Array) -> Array:
        """(M, m) white columns whose coefficients complete a start."""

    def completed(self, start: Array, coefficients: Array) -> Array:
        """Parameters (k,) of a start with the coefficients (m,) of its columns."""


class FittableModel(ResidualModel, Protocol):
    """A model that fits effects from parameters that are handed over, and can draw its noise."""

    effects: tuple[Any, ...]
    theta: tuple[Array, ...]

    def fitted_from(self, effects: tuple[Any, ...], theta: tuple[Array, ...]) -> FittableModel:
        """Fit all parameters at fixed whitening."""

    def law_forms(self) -> Sequence[LawForm]:
        """Forms of laws that may act beside the model's effects; empty where none are known."""

    def draw_noise(self, random: np.random.Generator) -> Array:
        """(M,) noise before whitening."""

    def whiten(self, rows: Array) -> Array:
        """White form of rows (M, ...)."""


_DRAWS = 99
"""Recordings of noise alone on which the whole search is done too: the chance of a find is then
known to one in a hundred, the level at which models are tested. More cost time in proportion."""
_SLOWEST_HZ = 0.3
"""Frequency, Hz, from which the strongest line of a spectrum is looked for: slower ones have fewer
than ten periods in 30 s, and a drift looks like them."""
_KEPT_STARTS = 3
"""Starts of each form that are fitted, the best by their columns: fits from neighbours on a grid
end alike, and three leave room for one that misleads. More cost a fit each."""
_PROMISING = 0.3
"""Share of the best gain that a form must reach before it is fitted: columns at a start of a grid
show a law only in part. Higher may miss the right form, lower costs fits of hopeless ones."""


_LEEWAY = 3.0
"""Standard deviations by which what was learnt may move on another recording: its prior there. More
lets the law become another one, less holds what the first recording knew too little."""
_LEAST_LEEWAY = 1e-6
"""Prior of what was learnt with next to no uncertainty, in its unit: a prior must be above zero."""


def leeway(*stds: float) -> float:
    """Prior std of numbers that were learnt, in another recording, by their standard deviations."""
    return max(_LEAST_LEEWAY, _LEEWAY * max(stds))


@dataclass(frozen=True)
class Find:
    """A form of law fitted jointly with the model.

    Attributes:
        form: of the law.
        model: fitted at the whitening of the model that was searched.
        criterion: its `evidence`, with the price of the search.
    """

    form: LawForm
    model: FittableModel
    criterion: float

    @property
    def theta(self) -> Array:
        """Parameters of the law."""
        return self.model.theta[-1]


@dataclass(frozen=True)
class Search:
    """Outcome of a search.

    Attributes:
        finds: the best fit of each promising form, best first.
        p_value: chance that noise alone gives as good a start of any form.
        tried: starts of all forms.
    """

    finds: tuple[Find, ...]
    p_value: float
    tried: int


def search_laws(
    model: FittableModel, forms: Sequence[LawForm], floor: float, seed: int = 0
) -> Search:
    """Try all starts of all forms, fit the best jointly with the model's own parameters.

    The statistic of a search is the largest gain less (m) log(M) over all starts. The same is taken
    of draws of the model's noise, lasting errors among it, which pay for the number of forms and
    starts. A floor above 1 is noise stated too small: the residual counts less.

    Args:
        model: fitted, without the law.
        forms: that are tried.
        floor: white RMS of the noise alone.
        seed: of the draws.

    Source: Schwarz 1978 (penalty); Westfall, Young 1993 (largest statistic of all tests).
    """
    tell("drawing recordings of noise alone")
    random = np.random.default_rng(seed)
    draws = [model.whiten(model.draw_noise(random)) for _ in range(_DRAWS)]
    series = np.stack([model.residual / max(floor, 1.0), *draws], axis=1)
    frequencies = [_strongest_line(model, column) for column in series.T]
    basis = orthonormal(model.jacobian)
    series = series - basis @ (basis.T @ series)
    best = np.full(series.shape[1], -np.inf)
    ranked: list[list[tuple[float, Array]]] = []
    for form in forms:
        tell(f"searching laws: {form.name}")
        own = []
        for start in form.starts(model, frequencies):
            gains, coefficients, rank = _project(form.columns(model, start), basis, series)
            value = gains - rank * float(np.log(len(series)))
            best = np.maximum(best, value)
            own.append((float(value[0]), form.completed(start, max(floor, 1.0) * coefficients)))
        ranked.append(sorted(own, key=lambda one: -one[0]))
    p_value = (1.0 + float(np.sum(best[1:] >= best[0]))) / len(best)
    tried = sum(map(len, ranked))
    finds = _fit(model, zip(forms, ranked, strict=True), float(best[0]), floor, tried)
    return Search(tuple(sorted(finds, key=lambda find: find.criterion)), p_value, tried)


def fit_law(
    model: FittableModel, form: LawForm, starts: Iterable[Array], floor: float, tried: int
) -> Find:
    """Fit one form jointly with a model from each start; return the best.

    Args:
        model: without the law.
        form: of the law.
        starts: parameters of the law.
        floor: white RMS of the noise alone.
        tried: starts of the whole search, which its evidence pays for.
    """
    fits = [model.fitted_from((*model.effects, form.effect), (*model.theta, s)) for s in starts]
    finds = [Find(form, fit, evidence(fit, floor, tried)) for fit in fits]
    return min(finds, key=lambda find: find.criterion)


def _fit(
    model: FittableModel,
    ranked: Iterable[tuple[LawForm, list[tuple[float, Array]]]],
    best: float,
    floor: float,
    tried: int,
) -> list[Find]:
    found = []
    for form, starts in ranked:
        if starts and best > 0.0 and starts[0][0] >= _PROMISING * best:
            tell(f"fitting a law: {form.name}")
            picked = [theta for _, theta in starts[:_KEPT_STARTS]]
            found.append(fit_law(model, form, picked, floor, tried))
    return found


def _project(columns: Array, basis: Array, series: Array) -> tuple[Array, Array, int]:
    """Gains of columns in each series, coefficients of the first, and their rank."""
    unit = columns - basis @ (basis.T @ columns)
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    unit /= scale
    values, vectors = np.linalg.eigh(unit.T @ unit)
    sound = values > FEIGNED * max(float(values[-1]), 1e-300)
    half = vectors[:, sound] / np.sqrt(values[sound])
    score = half.T @ (unit.T @ series)
    return np.sum(score**2, axis=0), (half @ score[:, 0]) / scale, int(sound.sum())


def _strongest_line(model: FittableModel, white: Array) -> float:
    """Frequency of the largest power of a white series (M,), Hz."""
    time, shape = instants(model)
    spectrum = periodogram(time, white.reshape(shape.shape))
    power = spectrum.power.reshape(len(spectrum.hz), -1).sum(axis=1)
    fast = spectrum.hz >= _SLOWEST_HZ
    return float(spectrum.hz[fast][np.argmax(power[fast])])
