"""Estimate of two parts from a recording of pushes: their structure, then their properties."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.effects.acting import described
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.joint import LooseJoint
from tactile_dynamics_ros.core.planar.effects.part import has_law
from tactile_dynamics_ros.core.planar.linked.description import (
    Effects,
    LinkedEstimate,
    PlacedJoint,
    Value,
    remedies,
    vague,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.properties.intervals import COARSE
from tactile_dynamics_ros.core.planar.properties.linked_fit import PairFit, fit_jointed, fit_rigid
from tactile_dynamics_ros.core.planar.properties.linked_pair import Pair
from tactile_dynamics_ros.core.planar.properties.linked_rigid import RigidModel
from tactile_dynamics_ros.core.planar.properties.push_model import ASTRAY
from tactile_dynamics_ros.core.planar.streams import PushedStreams

TURNED = np.radians(5.0)
"""Turn of a joint from which its friction and the parts' shares are reported, rad. At 2 degrees of
six joints two came out with a tenth of their friction torque, at a stated half."""
_SHARE_SPREAD = 0.8
"""Standard deviation of ln(mass ratio over area ratio) of two parts before the data: other heights
and materials. Where parts move as one body it is nearly all that is known."""
_GUESS_SPREAD = 0.6
"""Relative std of what is only guessed from the forces and the areas; it is never told."""
_INERTIA_SPREAD = 0.3
"""Relative std of an inertia about that of an even plate, as of one part."""
_CARRIED = 0.5
"""Std of a part's centre of mass about the place where it is carried, over its radius of gyration:
that of the centre beforehand. A joint that keeps parts from tipping lets them stand as one body; on
a simulated one centres were 9 mm from where two parts of 60 to 90 mm were carried (0.3)."""
_SHARES = np.linspace(0.02, 0.98, 97)
"""Shares of the second part in the mass that are weighed against each other."""


class Alone(Protocol):
    """An estimate of one part."""

    @property
    def values(self) -> dict[str, Value]:
        """Value and std by name."""


@dataclass(frozen=True, eq=False)
class _Found:
    """What a fit says: parts, both together, and what stands in the covariance."""

    links: tuple[dict[str, Value], dict[str, Value]]
    whole: dict[str, Value]
    covariance: Array
    names: tuple[str, ...]
    samples: int
    error: float | None
    torque: Value | None = None
    one_body: bool = False
    effects: Effects = field(default_factory=dict)
    fit: PairFit | None = None


def estimate_pair(
    streams: PushedStreams,
    estimate_alone: Callable[[PushedStreams], Alone],
    effects: Sequence[PushEffect] = (),
) -> tuple[LinkedEstimate, PairFit | None]:
    """Estimate two parts; also return the fit, if the numbers are read from one of both.

    Args:
        streams: with poses of both at 5 Hz or more.
        estimate_alone: estimates one part; it is asked where the parts are separate.
        effects: of the model; one of the joint lets it have play.

    Raises:
        BadInputError: nothing is touched while poses are known.
        NotIdentifiableError: the parts slide too little, or an effect has no law for such parts.
    """
    pair = Pair.of_streams(streams, loose=any(effect.of_joint for effect in effects))
    structure = pair.structure
    others = [effect for effect in effects if not effect.of_joint]
    for effect in others:
        if not has_law(effect, structure.name):
            raise NotIdentifiableError(
                f"{effect.name}: has no law for {structure.name} parts; leave it out"
            )
    found = _found(pair, estimate_alone, others)
    slack = structure.slack.play[0] if structure.slack is not None else None
    joint = None
    if structure.name == "jointed":
        std = np.sqrt(np.diag(structure.hinge.covariance)[:2])
        joint = PlacedJoint(structure.hinge.first, std, found.torque)
    undetermined = _undetermined(pair, found)
    if structure.name == "jointed" and found.torque is None:
        undetermined += ("joint.friction_torque_nm",)
    estimate = LinkedEstimate(
        samples=found.samples,
        duration=float(streams.links[0].time[-1] - streams.links[0].time[0]),
        structure=structure.name,
        probability=structure.probability,
        links=found.links,
        whole=found.whole,
        joint=joint,
        undetermined=undetermined,
        remedies=remedies(structure.name, found.one_body, undetermined, slack, pair.telling_push),
        covariance=found.covariance,
        covariance_names=found.names,
        error=found.error,
        effects=_effects(pair, found, others),
    )
    return estimate, found.fit


def _effects(pair: Pair, found: _Found, others: Sequence[PushEffect]) -> Effects:
    """Those of the fit, or what is known of them beforehand; and play, where there may be any."""
    std = np.array([p.prior_std for effect in others for p in effect.parameters])
    table = found.effects or described(others, np.zeros(len(std)), std)
    value, doubt = np.array(pair.play)[:, None]
    return described((LooseJoint(),), value, doubt) | table if pair.loose else table


def _found(
    pair: Pair,
    estimate_alone: Callable[[PushedStreams], Alone],
    effects: Sequence[PushEffect],
) -> _Found:
    structure = pair.structure
    if structure.slack is not None:
        return _guessed(pair)
    if structure.likeliest == "separate":
        return _of_separate(pair, estimate_alone)
    if structure.likeliest == "jointed" and structure.hinge.turned > TURNED:
        try:
            fit = fit_jointed(pair, effects)
        except NotIdentifiableError:
            return _guessed(pair)
        read = _of_jointed
    else:
        fit, read = fit_rigid(pair, effects), _of_rigid
    return replace(read(pair, _trusted(fit)), fit=fit) if fit.converged else _guessed(pair)


def _trusted(fit: PairFit) -> PairFit:
    """The fit with masses that count as unknown where it has not converged or forces are coarse."""
    if fit.whitened_rms <= ASTRAY and fit.model.intervals.step <= COARSE:
        return fit
    vague = np.array([name.startswith("ln_mass") for name in fit.names])
    return replace(fit, covariance=fit.covariance + np.diag(_GUESS_SPREAD**2 * vague))


def _guessed(pair: Pair) -> _Found:
    """What forces and areas let guess, with stds that call all of it undetermined."""
    weight = pair.seen.force
    area = np.array([patch.gyration for patch in pair.patches])
    area /= area.sum()
    links = [_guessed_link(pair, k, weight * float(area[k])) for k in (0, 1)]
    whole = {
        "mass": (weight / 2.94, _GUESS_SPREAD * weight / 2.94),
        "friction_force_n": (weight, _GUESS_SPREAD * weight),
    }
    return _Found((links[0], links[1]), whole, np.zeros((0, 0)), (), 0, None, one_body=True)


def _guessed_link(pair: Pair, k: int, force: float) -> dict[str, Value]:
    patch = pair.patches[k]
    reach = 0.5 * float(np.sqrt(patch.gyration))
    mass, (x, y) = force / 2.94, patch.centroid
    return _link(
        pair,
        k,
        mass=(mass, _GUESS_SPREAD * mass),
        friction=(0.3, _GUESS_SPREAD * 0.3),
        force=(force, _GUESS_SPREAD * force),
        com=((float(x), reach), (float(y), reach)),
        scale=(0.0, _INERTIA_SPREAD),
        inertia=(0.0, _GUESS_SPREAD),
    )


def _link(
    pair: Pair,
    k: int,
    mass: Value,
    friction: Value,
    force: Value,
    com: tuple[Value, Value],
    scale: Value,
    inertia: Value,
) -> dict[str, Value]:
    """Values and std of a part; scale and inertia are logarithms over those of the footprint."""
    patch = pair.patches[k]
    centre = np.array([[com[0][0], com[1][0]]]) - patch.centroid
    radius = float(patch.friction_radius(centre, np.exp([scale[0]]))[0])
    about = mass[0] * patch.gyration * float(np.exp(inertia[0]))
    return {
        "mass": mass,
        "friction": friction,
        "friction_force_n": force,
        "com_x": com[0],
        "com_y": com[1],
        "friction_radius_m": (radius, radius * scale[1]),
        "inertia_zz": (about, about * float(np.hypot(mass[1] / mass[0], inertia[1]))),
    }


def _spread(fit: PairFit, weights: dict[str, float]) -> float:
    """Standard deviation of a weighted sum of common numbers."""
    row = np.zeros(len(fit.common))
    for name, weight in weights.items():
        row[fit.model.at(name)] = weight
    variance = float(row @ fit.covariance @ row)
    return float(np.sqrt(max(variance, 0.0)))


def _of_jointed(pair: Pair, fit: PairFit) -> _Found:
    gravity = -float(pair.streams.gravity[2])
    links: list[dict[str, Value]] = []
    forces: list[float] = []
    masses: list[float] = []
    for k in (0, 1):
        product, mass, inertia = (f"{n}_{k + 1}" for n in ("ln_product", "ln_mass", "ln_inertia"))
        force = gravity * float(np.exp(fit.value(product)))
        kilos = float(np.exp(fit.value(mass)))
        coefficient = force / kilos / gravity
        centre = pair.patches[k].centroid
        names = (f"com_x_{k + 1}", f"com_y_{k + 1}")
        at = [(float(c + fit.value(n)), fit.std(n)) for c, n in zip(centre, names, strict=True)]
        reach = _CARRIED * float(np.sqrt(pair.patches[k].gyration))
        com = [(value, float(np.hypot(std, reach))) for value, std in at]
        scale = f"ln_scale_{k + 1}"
        links.append(
            _link(
                pair,
                k,
                mass=(kilos, kilos * fit.std(mass)),
                friction=(
                    coefficient,
                    coefficient * _spread(fit, {product: 1.0, mass: -1.0}),
                ),
                force=(force, force * fit.std(product)),
                com=(com[0], com[1]),
                scale=(fit.value(scale), fit.std(scale)),
                inertia=(fit.value(inertia), fit.std(inertia)),
            )
            | {"carried_x": at[0], "carried_y": at[1]}
        )
        forces.append(force)
        masses.append(kilos)
    whole = {
        "mass": (sum(masses), _spread(fit, {"ln_mass_1": masses[0], "ln_mass_2": masses[1]})),
        "friction_force_n": (
            sum(forces),
            _spread(fit, {"ln_product_1": forces[0], "ln_product_2": forces[1]}),
        ),
    }
    torque = float(np.exp(fit.value("ln_joint_torque")))
    return _Found(
        links=(links[0], links[1]),
        whole=whole,
        covariance=fit.covariance,
        names=fit.names,
        samples=int(fit.model.data.mask.sum()),
        error=fit.whitened_rms,
        torque=(torque, torque * fit.std("ln_joint_torque")),
        effects=fit.effects,
    )


def _of_rigid(pair: Pair, fit: PairFit) -> _Found:
    """The whole body's numbers, and what they leave open of its parts."""
    model = fit.model
    assert isinstance(model, RigidModel)
    gravity = -float(pair.streams.gravity[2])
    mass = float(np.exp(fit.value("ln_mass")))
    middle = model.patch.centroid + fit.common[[2, 3]]
    ratio = fit.value("ln_ratio")
    scale = np.exp([fit.value("ln_scale")])
    pressure = model.patch.pressure(fit.common[None, 2:4], scale)[0]
    second = float(np.sum(pressure[model.patch.second]))
    share = (1.0 - second) * np.exp(-0.5 * ratio) + second * np.exp(0.5 * ratio)
    slope = (second * np.exp(0.5 * ratio) - (1.0 - second) * np.exp(-0.5 * ratio)) / (2.0 * share)
    force = gravity * float(np.exp(fit.value("ln_product")) * share)
    whole = {
        "mass": (mass, mass * fit.std("ln_mass")),
        "friction_force_n": (
            force,
            force * _spread(fit, {"ln_product": 1.0, "ln_ratio": float(slope)}),
        ),
        "com_x": (float(middle[0]), fit.std("com_x")),
        "com_y": (float(middle[1]), fit.std("com_y")),
    }
    return _Found(
        links=_split(pair, fit, mass, middle, gravity),
        whole=whole,
        covariance=fit.covariance,
        names=fit.names,
        samples=int(model.data.mask.sum()),
        error=fit.whitened_rms,
        one_body=True,
        effects=fit.effects,
    )


def _split(
    pair: Pair, fit: PairFit, mass: float, middle: Array, gravity: float
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Parts of one body: their shares are known by the areas and the common centre of mass."""
    offset = pair.structure.offset
    second = offset[:2] + turned(pair.patches[1].centroid[None], offset[2:])[0]
    places = (pair.patches[0].centroid, second)
    spreads = [0.25 * patch.gyration for patch in pair.patches]
    area = [abs(float(np.prod(np.ptp(o, axis=0)))) for o in pair.outlines]
    away = np.log(_SHARES / (1.0 - _SHARES)) - np.log(area[1] / area[0])
    log = -0.5 * np.square(away / _SHARE_SPREAD) - np.log(_SHARES * (1.0 - _SHARES))
    variance = (1.0 - _SHARES) ** 2 * spreads[0] + _SHARES**2 * spreads[1]
    variance = variance + 0.5 * (fit.std("com_x") ** 2 + fit.std("com_y") ** 2)
    lack = middle - (1.0 - _SHARES)[:, None] * places[0] - _SHARES[:, None] * places[1]
    log -= 0.5 * np.sum(lack**2, axis=1) / variance + np.log(variance)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    links = []
    for k, portion in enumerate((1.0 - _SHARES, _SHARES)):
        gain = portion * spreads[k] / variance
        centres = places[k] + gain[:, None] * lack
        own = spreads[k] * (1.0 - gain * portion)
        mean = weight @ centres
        std = np.sqrt(weight @ ((centres - mean) ** 2 + own[:, None]))
        if k == 1:
            mean = turned((mean - offset[:2])[None], -offset[2:])[0]
        part = float(weight @ portion)
        doubt = float(np.sqrt(weight @ (portion - part) ** 2)) / part
        links.append(_part_of_whole(pair, fit, k, mass * part, doubt, mean, std, gravity))
    return links[0], links[1]


def _part_of_whole(
    pair: Pair,
    fit: PairFit,
    k: int,
    mass: float,
    doubt: float,
    com: Array,
    com_std: Array,
    gravity: float,
) -> dict[str, Value]:
    half = (-0.5, 0.5)[k]
    ln_friction = fit.value("ln_product") - fit.value("ln_mass") + half * fit.value("ln_ratio")
    friction = float(np.exp(ln_friction))
    force = friction * mass * gravity
    known = _spread(fit, {"ln_product": 1.0, "ln_ratio": half})
    by_friction = _spread(fit, {"ln_product": 1.0, "ln_mass": -1.0, "ln_ratio": half})
    return _link(
        pair,
        k,
        mass=(mass, mass * float(np.hypot(fit.std("ln_mass"), doubt))),
        friction=(friction, friction * by_friction),
        force=(force, force * float(np.hypot(known, doubt))),
        com=((float(com[0]), float(com_std[0])), (float(com[1]), float(com_std[1]))),
        scale=(fit.value("ln_scale"), fit.std("ln_scale")),
        inertia=(0.0, _INERTIA_SPREAD),
    )


def _of_separate(pair: Pair, estimate_alone: Callable[[PushedStreams], Alone]) -> _Found:
    """Each part that is touched by itself; the other one is only guessed."""
    links, whole = [], np.zeros((2, 2))
    for k in (0, 1):
        touching = pair.intervals.touching & (pair.touched == float(k))
        try:
            link = estimate_alone(pair.alone(k)).values if touching.any() else None
        except NotIdentifiableError:
            link = None
        link = link if link is not None else _guessed_link(pair, k, pair.seen.force)
        links.append(link)
        whole += np.square([[0.0, v] for v in (link["mass"][1], link["friction_force_n"][1])])
        whole[:, 0] += link["mass"][0], link["friction_force_n"][0]
    return _Found(
        links=(links[0], links[1]),
        whole={
            "mass": (float(whole[0, 0]), float(np.sqrt(whole[0, 1]))),
            "friction_force_n": (float(whole[1, 0]), float(np.sqrt(whole[1, 1]))),
        },
        covariance=np.zeros((0, 0)),
        names=(),
        samples=int(pair.seen.moving.sum()),
        error=None,
    )


def _undetermined(pair: Pair, found: _Found) -> tuple[str, ...]:
    """Names of what is not determined; the whole's have no link before them."""
    names = vague(found.whole)
    for k, link in enumerate(found.links):
        names += [f"link_{k + 1}.{n}" for n in vague(link, pair.patches[k].gyration)]
    return tuple(names)
