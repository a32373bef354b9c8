"""A long recording in bounded memory: stretches that represent it are fitted, all are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig, fit_problems, fit_recording
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel, Survey
from tactile_dynamics_ros.core.inertia.residuals.contact_grid import choose_grid
from tactile_dynamics_ros.core.inertia.residuals.newton_euler_residual import WrenchProblem
from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.core.streams.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect


STRETCH = 30.0
"""Length of a stretch of a long recording, s: that for which the estimators and the diagnosis are
tested. Shorter ones have fewer blocks to widen intervals by; longer ones need memory in proportion
(eight are held at once)."""
FEWEST = 500
"""Samples of a stretch at least: a logger of 1 Hz has eight minutes in one. Fewer tell little of a
body by themselves; more only make stretches of slow recordings longer."""
MARGIN = 2.0
"""What windows may see of the neighbouring stretches, s: far more than their 0.16 s, so that delays
of a quarter of a second and gaps between samples fit in. It costs 13 % of reading time. Below the
windows' half width stretches lose samples at their ends; more reads more for nothing."""
EVEN, WORST = 5, 3
"""How many stretches are fitted: evenly spread ones, and those with the largest error. Eight of 30
s are the four minutes up to which a recording is fitted whole, which bounds memory (1.1 GB for half
an hour of recording). More read and fit more of a long recording, in proportion of time and memory;
fewer leave what happens briefly, or slowly over hours, out of the fit."""
NOTABLE = 1.1
"""Error of a stretch, over the median of all, from which it is taken in for its error. Clean
stretches of 3000 samples scatter by 0.5 %, so that 10 % is something that happened there; higher,
an effect that acts briefly is not fitted."""


def fit_representative(
    streams: Streams, effects: Sequence[Effect] = (), config: BatchConfig | None = None
) -> FittedModel:
    """`fit_recording` with memory that does not grow with the length of the recording.

    Recordings of more than four minutes are cut into stretches of 30 s. Evenly spread ones are
    fitted; every other one is then held against that fit, one at a time, and the worst join it.

    Returns:
        The fitted model, with a survey of all stretches if the recording is long.

    Raises:
        BadInputError: contacts and motion are missing or do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    config = config or BatchConfig()
    grid = choose_grid(streams, config.problem.maximum_rate)
    count = int((grid[-1] - grid[0]) // max(STRETCH, FEWEST * float(np.median(np.diff(grid)))))
    if count <= EVEN + WORST:
        return fit_recording(streams, effects, config)
    config = config.paced((EVEN + WORST) * STRETCH)
    edges = np.linspace(grid[0], grid[-1] + 1e-6, count + 1)
    chosen = _evenly(_held(streams, edges))
    read = _read(streams, config, edges, chosen)
    model = fit_problems(list(read.values()), effects, config)
    rms = np.array(
        [_error(read.get(k) or _problem(streams, config, edges, k), model) for k in range(count)]
    )
    notable = rms > NOTABLE * np.nanmedian(rms)
    notable[chosen] = False
    worst = sorted(map(int, np.flatnonzero(notable)), key=lambda k: -rms[k])[:WORST]
    if worst:
        chosen = sorted([*chosen, *worst])
        read |= _read(streams, config, edges, worst)
        model = fit_problems([read[k] for k in sorted(read)], effects, config)
    fitted = np.isin(np.arange(count), chosen)
    return replace(model, survey=Survey(edges, rms, fitted))


def _held(streams: Streams, edges: Array) -> Array:
    """(K,) share of the forces of each stretch that are not zero."""
    stamps = np.concatenate([c.time for c in streams.contacts.values()])
    touching = np.concatenate([c.force.any(axis=1) for c in streams.contacts.values()])
    total = np.histogram(stamps, edges)[0]
    return np.asarray(np.histogram(stamps[touching], edges)[0] / np.maximum(total, 1))


def _evenly(held: Array) -> list[int]:
    """Numbers of stretches, spread evenly over those in which the object is held."""
    among = np.flatnonzero(held > 0.5 * held.max())
    places = np.linspace(0, len(among) - 1, min(EVEN, len(among)))
    return [int(k) for k in among[places.round().astype(int)]]


def _read(
    streams: Streams, config: BatchConfig, edges: Array, chosen: Sequence[int]
) -> dict[int, WrenchProblem]:
    """Problems by number of the stretch; those in which nothing is held are left out."""
    found = {k: _problem(streams, config, edges, k) for k in chosen}
    held = {k: problem for k, problem in found.items() if problem is not None}
    if not held:
        raise BadInputError("the object is hardly held in this recording; cut out where it is")
    return held


def _problem(
    streams: Streams, config: BatchConfig, edges: Array, stretch: int
) -> WrenchProblem | None:
    first, last = float(edges[stretch]), float(edges[stretch + 1])
    around = cut_streams(streams, first - MARGIN, last + MARGIN)
    if around.contacts.keys() != streams.contacts.keys():
        around = streams
    return WrenchProblem.try_from_streams(around, config.problem, (first, last), float(edges[0]))


def _error(problem: WrenchProblem | None, model: FittedModel) -> float:
    """White RMS of a stretch at the parameters of a model; NaN where nothing is held."""
    if problem is None:
        return float("nan")
    linearisation = problem.linearise(model.phi, model.effects, model.theta)
    white = linearisation.whiten(problem.residual(model.phi, model.effects, model.theta))
    return float(np.sqrt(np.mean(white**2)))
