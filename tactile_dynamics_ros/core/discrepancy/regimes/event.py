"""The time of an event, where the model is said to have one but not when."""

from __future__ import annotations

from tactile_dynamics_ros.core.discrepancy.model.residual_model import ResidualModel
from tactile_dynamics_ros.core.discrepancy.regimes.border import find_border
from tactile_dynamics_ros.core.discrepancy.regimes.refinement import refine_border
from tactile_dynamics_ros.core.discrepancy.regimes.search import RegimeSearch
from tactile_dynamics_ros.core.errors import BadInputError


def place_event(model: ResidualModel, name: str, floor: float) -> tuple[str, float | None]:
    """Name of an event with the time at which it fits best, and the standard deviation of that, s.

    Args:
        model: fitted, without it.
        name: of the event, without a time.
        floor: white RMS of the noise alone.

    Raises:
        BadInputError: these contacts cannot show it, or the recording is too short.
    """
    search = RegimeSearch.of(model, floor, [name])
    found = search.candidates() if search is not None else []
    if search is None or not found:
        raise BadInputError(
            f"effect '{name}': no time can be found at which it happens in this recording; say it, "
            f"{name}[t>SECONDS], or leave it out"
        )
    best = found[0]
    condition = next(c for c in model.conditions() if c.symbol == best.gate.symbol)
    border = find_border(search.sums, best.family, condition, best.gate, floor)
    if border is None:
        return f"{name}[{best.gate}]", None
    refined = refine_border(model, name, best.family.label, border)
    return f"{name}[{refined.gate}]", refined.std
