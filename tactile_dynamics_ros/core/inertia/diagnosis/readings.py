"""Fits in which the data choose the reading of effects whose name leaves it open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from tactile_dynamics_ros.core.discrepancy.regimes.border import place_event
from tactile_dynamics_ros.core.discrepancy.screening import screen
from tactile_dynamics_ros.core.discrepancy.simpler import on_fewer_sensors
from tactile_dynamics_ros.core.discrepancy.trials import try_effect
from tactile_dynamics_ros.core.discrepancy.verdict.adequacy import (
    assess,
    noise_floor,
    noise_is_as_stated,
)
from tactile_dynamics_ros.core.discrepancy.verdict.wording import write_interval
from tactile_dynamics_ros.core.effects.conditions import GatedEffect
from tactile_dynamics_ros.core.effects.sensor_zero import ZERO, with_zero
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.averaging import averaged
from tactile_dynamics_ros.core.inertia.batch.batch import BatchConfig
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.stretches import fit_representative
from tactile_dynamics_ros.core.inertia.diagnosis.discrepancy_model import HeldObjectModel
from tactile_dynamics_ros.core.inertia.residuals.stated_noise import restate_noise
from tactile_dynamics_ros.core.streams.streams import Streams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect

_CERTAIN = 3.0
"""Standard deviations beyond its bound from which a parameter cannot be. An effect that is absent
lies beyond it half of the time, by as much once in 700. Lower refuses those, higher tells negative
stiffness."""


def fit_with_readings(
    streams: Streams, effects: Sequence[Effect] = (), config: BatchConfig | None = None
) -> FittedModel:
    """Fit a recording; effects named without a reading get the one with the best evidence.

    Of a long recording only stretches are fitted (`fit_representative`), of a fast one means.
    Readings are the frame of a lag, the fingers that have a bias, the law of a torsion, the time of
    an event. The zero of a single sensor is always an effect of the model, before all others.
    Where samples do not scatter as stated, their scatter is used if that leaves nothing but noise.

    Args:
        streams: measurements of the recording.
        effects: effects of the model, in the order of the result.
        config: settings of the fit.

    Raises:
        BadInputError: an effect is one that the contacts of this recording cannot show.
        NotIdentifiableError: an effect fits only with a parameter that cannot be.
    """
    streams, effects = averaged(streams), with_zero(streams.contacts, effects)
    fitted = _fit(streams, effects, config)
    restated, ratios = restate_noise(streams)
    if ratios and not _is_white(fitted):
        again = replace(_fit(restated, effects, config), restated=ratios)
        fitted = again if _is_white(again) else fitted
    _require_possible(fitted)
    return fitted


def _require_possible(fitted: FittedModel) -> None:
    """Check that no parameter of an effect is beyond its bound by more than its uncertainty.

    Raises:
        NotIdentifiableError: one is, as a spring that pushes.
    """
    for effect, theta in zip(fitted.effects, fitted.theta, strict=True):
        parameters = effect.parameters(fitted.samples[0])
        if all(p.allows(value) for p, value in zip(parameters, theta, strict=True)):
            continue
        found = fitted.to_estimate().effects[effect.name]
        for p in parameters:
            value, std = found.value[p.name], found.std[p.name]
            nearest = min(max(value, p.least), p.most)
            if abs(value - nearest) > _CERTAIN * std:
                bound = "least" if value < nearest else "most"
                raise NotIdentifiableError(
                    f"effect '{effect.name}' fits this recording only with {p.name} = "
                    f"{write_interval(value, std)} {p.unit}, which cannot be (at "
                    f"{bound} {nearest:g}): it is not what acts here; leave it out"
                )


def model_with_seen_noise(
    model: HeldObjectModel, streams: Streams, effects: Sequence[Effect] = ()
) -> HeldObjectModel | None:
    """The model with the noise that samples show, where its noise floor speaks for that.

    Args:
        model: with the noise that is stated.
        streams: measurements of the recording.
        effects: effects of the model.

    Returns:
        None where the floor is 1 as it should be, or where it is not with the other noise either.
    """
    restated, ratios = restate_noise(averaged(streams))
    if not ratios or model.fitted.restated or noise_is_as_stated(model):
        return None
    known = with_zero(streams.contacts, effects)
    other = HeldObjectModel.from_fit(replace(_fit(restated, known, None), restated=ratios))
    return other if noise_is_as_stated(other) else None


def _is_white(fitted: FittedModel) -> bool:
    return assess(HeldObjectModel.from_fit(fitted)).white


def _fit(streams: Streams, effects: Sequence[Effect], config: BatchConfig | None) -> FittedModel:
    single = len(streams.contacts) == 1
    chosen = [e for e in effects if (e.reading or (single and e.name == ZERO)) and not e.event]
    fitted = fit_representative(streams, chosen, config)
    model = HeldObjectModel.from_fit(fitted)
    if any(effect.reading for effect in chosen):
        model = model.refined()
    std = None
    for effect in effects:
        if effect in chosen:
            continue
        name, floor = effect.name, noise_floor(model)
        if effect.event and not isinstance(effect, GatedEffect):
            name, std = place_event(model, name, floor)
        families = model.families([name])
        if not families:
            raise BadInputError(
                f"effect '{name}': these contacts cannot show it beside the load; leave it out"
            )
        scores = screen(model, families, floor)
        best = try_effect(model, scores, name, floor)
        found = on_fewer_sensors(best, best.model.refined(), floor).model
        assert isinstance(found, HeldObjectModel)
        model = found
    return replace(model.fitted, survey=fitted.survey, event_std=std)
