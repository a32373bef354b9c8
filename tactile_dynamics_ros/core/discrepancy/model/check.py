"""Contract test of a model, ours or a user's, before the engine is asked about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contract import CheckReport, central_differences
from tactile_dynamics_ros.core.discrepancy.model.least_squares import LeastSquaresModel
from tactile_dynamics_ros.core.discrepancy.model.residual_model import Family, instants
from tactile_dynamics_ros.core.discrepancy.screening import orthonormal, screen
from tactile_dynamics_ros.core.discrepancy.trials import square, try_effect

AnyModel = LeastSquaresModel[Any]
Test = tuple[str, Callable[[], list[str]]]

_STEP = 1e-4
"""Step of finite differences in units of each parameter's scale. Where the model takes differences
itself (of 1e-5) the two must not be the same numbers; curvature changes them by 1e-8. Larger steps
take the bend of a law for a wrong derivative, far smaller ones rounding."""
_TOLERANCE = 1e-3
"""Difference between a derivative and its finite difference, as a share of the column's length. The
derivatives of our models agree to 1e-5; a term left out or a wrong sign makes more than 1e-2. Lower
reports bends, higher passes wrong terms."""
_DRAWS = 200
"""Draws of the noise. A variance of M rows is then known to sqrt(2 / (200 M)): with a hundred rows,
to one per cent. More find smaller faults of a whitening, at time in proportion."""
_LEVEL = 1e-6
"""Probability that a test of the noise fails by chance. Of the millions of checks that people make,
a few fail wrongly; a standard deviation that is off by 5 % fails with a hundred rows. Larger: sound
models fail now and then; smaller: larger faults pass."""
_OUTSIDE = 0.3
"""Share of what a typical effect does to the residual, in energy, that its family may leave. Those
of linear effects leave nothing; others hold samples of the effect only: of ours that of the
sloshing mass leaves most, 0.18. A family of something else leaves nearly all. Lower refuses bent
effects that fits do find, higher passes families of something else."""
_SAME = 1e-9
"""Difference of numbers that are computed twice in one process, as a share: threads of linear
algebra may sum in another order. Zero would report rounding, far more would pass a fit that draws
small random numbers."""
_BACK = 0.02
"""Rise of the white RMS, as a share, when an effect is added and removed again: both are quick fits
that end where little is left to gain. Lower reports fits that ended early, higher passes effects
that do harm."""


def check_residual_model(
    model: AnyModel, names: Sequence[str] | None = None, seed: int = 0
) -> CheckReport:
    """Test what the engine relies on.

    Shapes and order of the rows; the Jacobian against finite differences; whitening that gives the
    model's own noise unit variance in every channel; priors; effects of the catalogue that are
    absent at zero, lie mostly in their families, and can be tried, taken away and told in words;
    and that the same question has the same answer. Where priors or rows are wrong, the rest is not
    tested.

    Args:
        model: fitted.
        names: effects to be tried; the whole catalogue by default.
        seed: of the draws of noise.
    """
    wanted = [n for n in (names or model.catalogue) if n not in model.effect_names]
    random = np.random.default_rng(seed)
    others: list[Test] = [
        ("derivatives", lambda: _check_derivatives(model, model.x, model.effects, "the model")),
        ("whitening", lambda: _check_whitening(model, random)),
        *((name, partial(_check_effect, model, name)) for name in wanted),
    ]
    failures = (
        _failures([("priors", lambda: _check_priors(model))])
        or _failures([("rows", lambda: _check_rows(model))])
        or _failures(others)
    )
    return CheckReport(type(model).__name__, tuple(failures))


def _failures(tests: Sequence[Test]) -> list[str]:
    found: list[str] = []
    for what, test in tests:
        try:
            found += test()
        except Exception as error:  # the report names what a foreign model raised
            found.append(f"{what}: raised {error!r}")
    return found


def _check_rows(model: AnyModel) -> list[str]:
    rows, count = len(model.time), len(model.x)
    found = []
    for what, value, shape in (
        ("residual", model.residual, (rows,)),
        ("jacobian", model.jacobian, (rows, count)),
        ("measured", model.measured, (rows,)),
        ("lack", model.lack(model.x, model.effects), (rows,)),
    ):
        if value.shape != shape:
            found.append(f"{what} has shape {value.shape}, expected {shape}")
        elif not np.all(np.isfinite(value)):
            found.append(f"{what} is not finite")
    if found:
        return found
    if np.any(np.diff(model.time) < 0.0):
        found.append("time decreases: order the rows in time, channel fastest")
    residuals = model.residuals()
    time, white = instants(model)
    if white.shape != (len(time), len(residuals.channels)):
        found.append(f"{white.shape[1]} rows for each time, {len(residuals.channels)} channels")
    elif not np.allclose(residuals.white, white):
        found.append("residuals().white differs from the residual")
    again = model.with_parameters(model.own, model.effects, model.theta)
    if not np.allclose(again.residual, model.residual, rtol=_SAME, atol=_SAME):
        found.append(
            "the residual at the same parameters differs from the first: not deterministic"
        )
    whitened = model.whiten(model.lack(model.x, model.effects))
    if _differs(model.residual, whitened, _TOLERANCE):
        found.append("residual differs from whiten(lack)")
    return found


def _check_derivatives(model: AnyModel, x: Array, effects: tuple[Any, ...], of: str) -> list[str]:
    steps = _STEP * model.scales(effects)
    numeric = central_differences(lambda at: model.evaluate(at, effects)[0], x, steps)
    stated = model.evaluate(x, effects)[1]
    if stated.shape != numeric.shape:
        return [f"jacobian of {of} has shape {stated.shape}, expected {numeric.shape}"]
    length = np.linalg.norm(numeric, axis=0)
    error = np.linalg.norm(stated - numeric, axis=0)
    least = 1e-9 * float(np.max(length * steps / np.maximum(steps, 1e-300)))
    return [
        f"jacobian of {of}, column {k}, differs from finite differences by {error[k]:.2g} of "
        f"{length[k]:.2g}"
        for k in np.flatnonzero(error > _TOLERANCE * np.maximum(length, least))
    ]


def _check_whitening(model: AnyModel, random: np.random.Generator) -> list[str]:
    """Mean square of white noise by channel, and correlation of neighbours, over many draws."""
    channels = instants(model)[1].shape[1]
    draws = np.stack([model.whiten(model.draw_noise(random)) for _ in range(_DRAWS)])
    by_channel = draws.reshape(_DRAWS, -1, channels)
    count = by_channel.shape[0] * by_channel.shape[1]
    low = float(chdtri(count, 1.0 - _LEVEL / 2.0)) / count
    high = float(chdtri(count, _LEVEL / 2.0)) / count
    found = []
    for channel, square_mean in enumerate(np.mean(by_channel**2, axis=(0, 1))):
        if not low < square_mean < high:
            found.append(
                f"whitening: own noise has variance {square_mean:.3f} in channel {channel}, "
                f"expected 1 ({low:.3f} to {high:.3f})"
            )
    limit = float(ndtri(1.0 - _LEVEL / 2.0)) / np.sqrt(draws.size)
    for apart in sorted({1, channels}):
        together = float(np.mean(draws[:, apart:] * draws[:, :-apart]))
        if abs(together) > limit:
            found.append(
                f"whitening: own noise is correlated by {together:.3f} between rows {apart} apart, "
                f"expected less than {limit:.3f}"
            )
    return found


def _check_priors(model: AnyModel) -> list[str]:
    found = []
    for name in {*model.catalogue, *model.effect_names}:
        parameters = model.parameters_of(model.effect_named(name))
        symbols = [p.name for p in parameters]
        if len(set(symbols)) < len(symbols):
            found.append(f"{name}: parameter names repeat: {symbols}")
        found += [
            f"{name}: prior_std of {p.name} is {p.prior_std}, expected a positive number"
            for p in parameters
            if not (p.prior_std > 0 and np.isfinite(p.prior_std))
        ]
    if found:
        return found
    rows, values = model.prior_rows(model.effects)
    if rows.shape[1:] != (len(model.x),) or rows.shape[:1] != values.shape:
        found.append(f"prior_rows have shapes {rows.shape} and {values.shape}")
    return found


def _check_effect(model: AnyModel, name: str) -> list[str]:
    families = model.families([name])
    if not families:
        return [f"{name}: is in the catalogue but has no family"]
    found = []
    for family, again in zip(families, model.families([name]), strict=True):
        found += _check_family(model, name, family)
        if _differs(family.columns, again.columns, _SAME):
            found.append(f"{name}: columns differ when asked for twice: not deterministic")
    if found:
        return found
    found += _check_absence(model, name, families[0])
    return found + _check_trial(model, name, families)


def _check_family(model: AnyModel, name: str, family: Family) -> list[str]:
    if family.name != name:
        return [f"{name}: a family of it is named {family.name}"]
    columns = family.columns
    if columns.ndim != 2 or len(columns) != len(model.time) or not np.all(np.isfinite(columns)):
        return [f"{name}: columns of {family.label} are not finite numbers for every row"]
    if family.kept and max(family.kept) >= columns.shape[1]:
        return [f"{name}: kept = {family.kept} of {columns.shape[1]} columns"]
    return []


def _check_absence(model: AnyModel, name: str, family: Family) -> list[str]:
    """At zero an effect changes nothing; where it is typical, its family holds most of it."""
    effects = (*model.effects, family.source)
    typical = np.array([p.typical for p in model.parameters_of(family.source)])
    absent = model.evaluate(np.concatenate([model.x, 0.0 * typical]), effects)[0]
    if _differs(model.residual, absent, _SAME * 1e3):
        return [f"{name}: changes the residual at theta = 0"]
    present = np.concatenate([model.x, typical])
    found = _check_derivatives(model, present, effects, name)
    made = absent - model.evaluate(present, effects)[0]
    basis = orthonormal(np.concatenate([family.columns, model.jacobian], axis=1))
    left = float(np.linalg.norm(made - basis @ (basis.T @ made)))
    share = (left / max(float(np.linalg.norm(made)), 1e-300)) ** 2
    if share > _OUTSIDE:
        found.append(f"{name}: its family leaves {100 * share:.0f} % of a typical one: want < 30 %")
    return found


def _check_trial(model: AnyModel, name: str, families: Sequence[Family]) -> list[str]:
    trial = try_effect(model, screen(model, families), name, 1.0)
    tried = trial.model
    found = []
    if name not in tried.effect_names:
        return [f"{name}: the model that was fitted with it has {tried.effect_names}"]
    if square(tried) > square(model) * (1.0 + _BACK):
        found.append(f"{name}: fits worse with it than without: it cannot have been fitted")
    back = tried.without_effect(name)
    if name in back.effect_names:
        found.append(f"{name}: is still there after without_effect")
    elif square(back) > square(model) * (1.0 + _BACK) ** 2:
        found.append(f"{name}: the model fits worse once it was added and removed")
    again = try_effect(model, screen(model, families), name, 1.0).model
    if _differs(tried.residual, again.residual, _SAME):
        found.append(f"{name}: another residual when fitted twice: not deterministic")
    table = tried.parameters().get(name, {})
    values = [float(entry[key]) for entry in table.values() for key in ("value", "std")]
    if not values or not np.all(np.isfinite(values)):
        found.append(f"{name}: parameters() says {table} of it")
    if not model.sentence(name):
        found.append(f"{name}: sentence is empty")
    return found


def _differs(one: Array, other: Array, share: float) -> bool:
    """Whether two arrays differ by more than a share of the first."""
    if one.shape != other.shape:
        return True
    return float(np.linalg.norm(one - other)) > share * max(float(np.linalg.norm(one)), 1e-9)
