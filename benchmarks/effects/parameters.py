"""True parameters of hidden effects in the names that the product prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

_NAMES: dict[str, dict[str, str]] = {
    "viscous_drag": {"c": "c"},
    "quadratic_drag": {"c": "c"},
    "rotational_drag": {"c": "c"},
    "tether_spring": {"stiffness": "k", "anchor": "a_{axis}", "point": "b_{axis}"},
    "hanging_cable": {"force": "F_{axis}", "point": "p_{axis}"},
    "unsensed_contact": {"force": "f_{axis}", "point": "p_{axis}"},
    "spinning_rotor": {"angular_momentum": "h_{axis}"},
    "sloshing_mass": {
        "mass": "m_s",
        "frequency": "f_n",
        "damping_ratio": "zeta",
        "point": "r_{axis}",
    },
    "added_mass": {"mass": "m_a"},
    "mass_change": {"rate": "rate"},
    "gravity_tilt": {"tilt": "tilt_{axis}"},
    "contact_torsion": {"mu_t": "mu"},
    "contact_offset": {"offset": "{finger}_d_{axis}"},
    "force_bias": {"bias": "{finger}_b_{axis}"},
    "force_drift": {"rate": "{finger}_d_{axis}"},
    "force_scale": {"gain_error": "{finger}_gain"},
    "sensor_rotation": {"rotation": "{finger}_r_{axis}"},
    "sensor_lag": {"time_constant": "tau"},
    "time_offset": {"offset": "offset"},
}


def true_parameters(effect: str, truth: dict[str, Any]) -> dict[str, float]:
    """True values by the product's name of each parameter."""
    return dict(_spread(effect, truth["effects"][effect]["parameters"]))


def parameter_errors(
    effect: str, truth: dict[str, Any], estimate: dict[str, Any], axes_told: bool = True
) -> dict[str, tuple[float, float]]:
    """(error, stated standard deviation) of every parameter that both sides name.

    What the product says of all fingers together is compared with the truth of one of them. Where a
    recording does not tell the axes of the sensors, lengths of vectors in them are compared.
    """
    found = next(
        (entry for name, entry in estimate["effects"].items() if name.split(":")[0] == effect), {}
    )
    if effect == "force_scale":
        return _gain_errors(true_parameters(effect, truth), found)
    errors = {}
    if effect == "contact_torsion" and "mu" not in found:
        return _torsion_errors(true_parameters(effect, truth)["mu"], found)
    for name, value in true_parameters(effect, truth).items():
        said = name if name in found else name.partition("_")[2]
        if said in found and found[said]["std"]:
            errors[said] = (found[said]["value"] - value, found[said]["std"])
    in_axes = truth["effects"][effect].get("reading") == "contact" or effect == "sensor_rotation"
    return errors if axes_told or not in_axes else _length_errors(errors, found)


def _length_errors(
    errors: dict[str, tuple[float, float]], found: dict[str, Any]
) -> dict[str, tuple[float, float]]:
    """Errors of the lengths of vectors whose coordinates are named ..._x, ..._y, ..._z."""
    lengths = {}
    for name in sorted({key[:-2] for key in errors}):
        keys = [key for key in errors if key[:-2] == name]
        said = np.array([found[key]["value"] for key in keys])
        true = said - [errors[key][0] for key in keys]
        std = np.array([errors[key][1] for key in keys])
        length = float(np.linalg.norm(said))
        along = float(np.linalg.norm(std * said / max(length, 1e-12)))
        lengths[name] = (length - float(np.linalg.norm(true)), along)
    return lengths


def _torsion_errors(true: float, found: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Errors of the coefficient of every finger, which is the same for all of them."""
    return {
        name: (entry["value"] - true, entry["std"])
        for name, entry in found.items()
        if name.startswith("torsion_") and entry["std"]
    }


def _gain_errors(true: dict[str, float], found: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Errors of gains against the mean gain: a gain that all fingers share looks like mass.

    A finger that the product does not mention has gain one.
    """
    names = list(true)
    wanted = np.log1p([true[name] for name in names])
    said = np.log1p([found.get(name, {"value": 0.0})["value"] for name in names])
    error = (said - said.mean()) - (wanted - wanted.mean())
    return {
        name: (float(error[k]), found[name]["std"])
        for k, name in enumerate(names)
        if name in found and found[name]["std"]
    }


def _spread(effect: str, parameters: dict[str, Any]) -> Iterator[tuple[str, float]]:
    for key, entry in parameters.items():
        finger, _, quantity = key.rpartition(".")
        template = _NAMES[effect][quantity]
        values = np.atleast_1d(entry["value"])
        for axis, value in zip("xyz", values, strict=False):
            yield template.format(finger=finger, axis=axis), float(value)
