"""What `estimate` makes of the same recordings: all samples at once, the motion itself unknown."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.planar.trial import Population
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate, estimate

MASS = ("mass", "friction")
"""Names of what is undetermined where only the product shows."""


def fitted(population: Population, one: Any) -> dict[str, Any]:
    """Estimates, errors over their std where determined, and CPU time of one object.

    Where the mass is undetermined the best guess is that of the population at this product, as
    filters begin with the population; where the fit is refused, that of the population.
    """
    start = time.process_time()
    try:
        found = estimate(one.streams)
    except NotIdentifiableError as error:
        return {"values": population.means(), "z": {}, "refused": str(error)}
    assert isinstance(found, PushedEstimate)
    link = one.scene.thing.links[0]
    told = SimpleNamespace(**{name: value for name, (value, _) in found.values.items()})
    values = population.given_product(np.array([told.friction_force_n]))
    if not {*MASS} & {*found.undetermined}:
        values |= {"m1": told.mass, "f1": told.friction}
    com = np.array([told.com_x, told.com_y])
    values["com1"] = float(np.linalg.norm(com - link.feet.mean(axis=0)))
    return {
        "values": values,
        "z": _errors(found, one.truth()["links"][0]),
        "undetermined": list(found.undetermined),
        "cpu_s": time.process_time() - start,
    }


def _errors(found: PushedEstimate, truth: dict[str, Any]) -> dict[str, list[float]]:
    """Errors over their std of what is determined."""
    known = {"q1": ("friction_force_n", truth["friction_force_n"]), "m1": ("mass", truth["mass"])}
    known["f1"] = ("friction", truth["friction"])
    z = {
        key: [(found.values[name][0] - value) / found.values[name][1]]
        for key, (name, value) in known.items()
        if name not in found.undetermined
    }
    if "com" not in found.undetermined:
        pairs = zip(("com_x", "com_y"), truth["com"], strict=True)
        z["com1"] = [(found.values[n][0] - v) / found.values[n][1] for n, v in pairs]
    return {key: [float(each) for each in row] for key, row in z.items()}
