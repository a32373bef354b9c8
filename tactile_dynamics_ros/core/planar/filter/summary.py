"""What is known of a pushed object now, by the filter or by a fit, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate

_GRAVITY = 9.81
"""Acceleration of gravity, m/s^2, with which forces follow from products."""
_UNKNOWN, _UNKNOWN_COM = 0.2, 0.25
"""Relative std from which a number is undetermined, and std of the centre of mass over the
footprint's radius of gyration: those of the fits to recordings."""
_MASS_FLOOR = 0.25
"""Least relative std of a mass of the filter: it sees mass only in the few steps of a start or a
stop, in which arms give way. Over ten simulated recordings its masses were off by up to a quarter.
The fit after a push tells it."""
_COM_FLOOR = 0.1
"""Least std of the filter's centre of mass over the radius of gyration: in two of ten simulated
recordings it was off by more than three of its own, by 6 mm at most."""
_SCALE_STD, _INERTIA_STD = 0.03, 0.3
"""Relative std of the size of the part that carries, and of the inertia over that of an even plate,
as the fits presume."""
_POOR = 1.5
"""Error over the noise from which a fit is said not to fit: clean simulated pushes have 0.9 to 1.2;
effects raise it to 1.1 to 5, and what is below is a matter for `diagnose`."""
_TOLD = 2.0
"""Size of an effect's parameter over its standard deviation from which it is reported: right
effects of eight simulated changes had 8 to 40, those that stood for a second object 1."""
_APART = 4.0
"""Difference of two friction forces in their standard deviations from which it is reported."""


@dataclass(frozen=True)
class Properties:
    """What is said of one link.

    Attributes:
        values: value and std by name, those of an estimate. undetermined: names among them.
        text: one sentence. doubtful: whether anything speaks against it.
        source: "nothing", "filter" or "fit".
    """

    values: dict[str, tuple[float, float]]
    undetermined: tuple[str, ...]
    text: str
    doubtful: bool
    source: str


def of_filter(mean: Array, covariance: Array, patch: SupportPatch, steps: int) -> Properties:
    """What the filter knows.

    Args:
        mean: (p,) parameters, those of `LINK_PARAMETERS` first.
        covariance: (p, p).
        patch: footprint.
        steps: with touch so far.
    """
    spread = covariance[:4, :4].copy()
    floor = [0.0, _MASS_FLOOR, *(_COM_FLOOR * np.sqrt(patch.gyration) * np.ones(2))]
    spread += np.diag(np.square(floor))
    std = np.sqrt(np.diag(spread))
    force, mass = _GRAVITY * np.exp(mean[0]), np.exp(mean[1])
    ratio = float(np.sqrt(max(spread[0, 0] + spread[1, 1] - 2.0 * spread[0, 1], 0.0)))
    radius = float(patch.friction_radius(mean[None, 2:4] - patch.centroid, np.ones(1))[0])
    inertia = mass * patch.gyration
    pairs = {
        "mass": (mass, mass * std[1]),
        "friction": (force / mass / _GRAVITY, force / mass / _GRAVITY * ratio),
        "friction_force_n": (force, force * std[0]),
        "com_x": (mean[2], std[2]),
        "com_y": (mean[3], std[3]),
        "friction_radius_m": (radius, radius * _SCALE_STD),
        "inertia_zz": (inertia, inertia * np.hypot(std[1], _INERTIA_STD)),
    }
    values = {name: (float(value), float(spread)) for name, (value, spread) in pairs.items()}
    unknown = _undetermined(values, patch.gyration)
    if steps == 0:
        text = "nothing was pushed yet: these are the values before any data"
        return Properties(values, tuple(unknown), text, True, "nothing")
    return Properties(values, tuple(unknown), words(values, unknown), False, "filter")


def doubted(known: Properties, why: str) -> Properties:
    """The same, with a reason not to trust it."""
    return replace(known, text=f"{known.text}; {why}", doubtful=True)


def of_fit(fit: PushedEstimate, live: Properties, refused: str) -> Properties:
    """What the last fit tells, beside what the filter says now.

    Args:
        fit: of all pushes until then.
        live: what the filter knows.
        refused: why a later fit failed; empty if none did.
    """
    remarks = [words(fit.values, fit.undetermined)]
    if fit.error > _POOR:
        remarks.append(
            f"the model does not fit ({fit.error:.1f} times the noise): ask /model_check/diagnose"
        )
    remarks += [
        f"how large {name} is, the pushes do not tell: something else may have changed"
        for name in vague_effects(fit)
    ]
    (force, std), (now, now_std) = (v["friction_force_n"] for v in (fit.values, live.values))
    if abs(now - force) > _APART * np.hypot(std, now_std):
        remarks.append(f"now it slides as with {now:.2f} ± {now_std:.2f} N: something changed")
    if refused:
        remarks.append(f"the latest push is not in it: {refused}")
    return Properties(
        fit.values, fit.undetermined, "; ".join(remarks), len(remarks) > 1, "fit"
    )  # fmt: skip


def vague_effects(fit: PushedEstimate) -> tuple[str, ...]:
    """Effects in the model of which no parameter is reported.

    Where the model lacks something else, fits end with a heavy object on ice, beside which an
    effect may have any size.
    """
    return tuple(
        name
        for name, parameters in fit.effects.items()
        if all(abs(_float(p["value"])) < _TOLD * _float(p["std"]) for p in parameters.values())
    )


def _float(value: object) -> float:
    assert isinstance(value, float | int)
    return float(value)


def words(values: dict[str, tuple[float, float]], undetermined: tuple[str, ...] | list[str]) -> str:
    """One sentence on what is known, and what would tell the rest."""
    force, std = values["friction_force_n"]
    if "friction_force_n" in undetermined:
        return "the friction force is not known yet: push it further"
    said = f"friction force {force:.2f} ± {std:.2f} N"
    if "mass" in undetermined or "friction" in undetermined:
        said = (
            f"mass and friction are known only as a product ({force:.2f} ± {std:.2f} N): push "
            "faster and brake over 0.3 s, or shake while pulling"
        )
    if "com" in undetermined:
        said += "; centre of mass undetermined: push from another side, off its middle"
    return said


def _undetermined(values: dict[str, tuple[float, float]], gyration: float) -> list[str]:
    relative = ("mass", "friction", "friction_force_n", "friction_radius_m", "inertia_zz")
    names = [n for n in relative if values[n][1] > _UNKNOWN * abs(values[n][0])]
    reach = _UNKNOWN_COM * np.sqrt(gyration)
    return names + ["com"] * any(values[n][1] > reach for n in ("com_x", "com_y"))
