"""The one door to an estimate of a pushed or pulled object from what was recorded of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.known import KnownPushed
from tactile_dynamics_ros.core.planar.linked.description import TELL_MASS, effect_lines, vague
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.misreading import check_reading
from tactile_dynamics_ros.core.planar.properties.balance import NAMES
from tactile_dynamics_ros.core.planar.properties.intervals import COARSE
from tactile_dynamics_ros.core.planar.properties.latent_model import USUAL_FRICTION
from tactile_dynamics_ros.core.planar.properties.push_model import ASTRAY
from tactile_dynamics_ros.core.planar.sparse import fit_sparse
from tactile_dynamics_ros.core.planar.sparse.fit import SIZE_STD, fit_pushes
from tactile_dynamics_ros.core.planar.sparse.prediction import NAMES as SPARSE_NAMES
from tactile_dynamics_ros.core.planar.sparse.pushes import cut_pushes
from tactile_dynamics_ros.core.planar.sparse.sliding import friction_from_slides
from tactile_dynamics_ros.core.planar.streams import PushedStreams

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.planar.linked.description import LinkedEstimate
    from tactile_dynamics_ros.core.planar.properties.linked_fit import PairFit
    from tactile_dynamics_ros.core.planar.properties.push_model import PushFit
    from tactile_dynamics_ros.core.planar.sparse import SparseFit


_PRIOR_FRICTION_STD = 0.6
"""Relative std of mass and friction where only their product is known: that of friction of
tables."""
_EVEN = 0.03
"""Relative variation of friction up to which nothing is said of it: made tables without any come
out with as much at most."""
_SLOW = 0.1
"""m/s up to which paths alone tell the centre of friction: a stop from it within 0.1 s takes a
third of what friction of 0.3 does, from 0.2 m/s twice as much, and inertia is not in that model."""
NO_FORCE = (
    "no force was measured: poses tell the centre of mass and how friction is spread, free slides "
    "the friction coefficient; mass, friction force and inertia share a factor that nothing tells "
    "(the robot's --stiffness would, where /pusher/target was recorded)"
)
"""What is said of a recording of poses alone."""
_SPARSE_RATE = 5.0
"""Poses per second of touch below which the mechanics are integrated from pose to pose instead of
following the motion: three poses within a push of half a second."""


class Pushed(Protocol):
    """Anything with the streams of a pushed object, such as a `PushedRecording`."""

    @property
    def streams(self) -> PushedStreams:
        """What was measured."""


@dataclass(frozen=True)
class PushedEstimate:
    """What is known of a pushed object with one link.

    Attributes:
        samples: intervals in which it slides. duration: s.
        values: value and std of mass (kg), friction, friction_force_n (N), com_x, com_y (m, link
            frame), friction_radius_m (m) and inertia_zz (kg m^2).
        undetermined: names of those that this recording does not tell; their std is the prior's.
        covariance: (4, 4) of ln friction force, ln mass, com_x, com_y.
        error: whitened RMS, 1 where only noise remains.
        effects: {effect: {parameter: {"value", "std", "unit"}}} of those in the model.
        error_without: the same without the effects, at the same unevenness; None without effects.
        delay: s, of the forces' stamps after those of the poses, and its std; None: not estimated.
        here: (4, 4) of the same as `covariance`, at the places that were pushed; None: no other.
        unevenness: relative standard deviation of friction from place to place by which the model
            holds; 0 where it was not asked.
    """

    samples: int
    duration: float
    values: dict[str, tuple[float, float]]
    undetermined: tuple[str, ...]
    covariance: Array
    error: float
    effects: dict[str, dict[str, dict[str, Any]]] = field(default_factory=dict)
    here: Array | None = None
    delay: tuple[float, float] | None = None
    error_without: float | None = None
    unevenness: float = 0.0

    @property
    def is_uneven(self) -> bool:
        """Whether friction had to differ more than on an even table, or something is missing."""
        return self.unevenness > _EVEN

    @property
    def is_answer(self) -> bool:
        """Whether the friction force is known."""
        return "friction_force_n" not in self.undetermined

    def to_document(self) -> dict[str, Any]:
        """JSON of the estimate."""
        names = ["ln_friction_force", "ln_mass", "com_x", "com_y"]
        link: dict[str, Any] = {
            name: {"value": value, "std": std}
            for name, (value, std) in self.values.items()
            if not name.startswith("com_")
        }
        (x, x_std), (y, y_std) = self.values["com_x"], self.values["com_y"]
        link["com"] = {"value": [x, y], "std": [x_std, y_std]}
        return {
            "model": "pushed",
            "samples": self.samples,
            "duration_s": self.duration,
            "links": [link],
            "joint": None,
            "undetermined": list(self.undetermined),
            "covariance": {
                "names": names[-len(self.covariance) :],
                "matrix": self.covariance.tolist(),
            },
            "effects": self.effects,
            "error": self.error,
            "friction_variation": self.unevenness,
        }

    def lines(self, fits: bool = True) -> list[str]:
        """Sentences for people.

        Args:
            fits: whether the model explains the recording; else no push would tell more.
        """
        v = self.values
        force, std = v.get("friction_force_n", (0.0, 0.0))
        said = [f"friction force    {force:.3f} ± {std:.3f} N"]
        if "friction_force_n" not in v:
            said = ["forces            not measured; a common factor of mass and forces is unknown"]
            if "friction" in v:
                said.append("friction          {:.3f} ± {:.3f}".format(*v["friction"]))
        elif "mass" in self.undetermined:
            product = f"mass and friction are known only as a product ({force:.2f} ± {std:.2f} N)"
            said.append(f"{product}: {TELL_MASS}" if fits else product)
        else:
            said.append("mass              {:.3f} ± {:.3f} kg".format(*v["mass"]))
            said.append("friction          {:.3f} ± {:.3f}".format(*v["friction"]))
        (x, x_std), (y, y_std) = v["com_x"], v["com_y"]
        said.append(
            f"centre of mass    {1e3 * x:.1f} ± {1e3 * x_std:.1f}, {1e3 * y:.1f} ± "
            f"{1e3 * y_std:.1f} mm in the link's frame"
        )
        radius, radius_std = v["friction_radius_m"]
        said.append(f"friction radius   {1e3 * radius:.1f} ± {1e3 * radius_std:.1f} mm")
        if "mass" not in self.undetermined:
            inertia, inertia_std = v["inertia_zz"]
            said.append(f"inertia           {1e6 * inertia:.0f} ± {1e6 * inertia_std:.0f} kg mm^2")
        said.append(f"error             {self.error:.2f} times the noise, {self.samples} samples")
        if self.is_uneven:
            said.append(
                f"friction is taken to differ by {100.0 * self.unevenness:.0f} % from place to "
                "place; a lean, a drag or another effect may look like that: `diagnose` tells"
            )
        said += effect_lines(self.effects)
        if self.undetermined:
            said.append(f"undetermined: {', '.join(self.undetermined)}")
        if "friction_force_n" not in v and "friction" in self.undetermined:
            said.append(
                "friction: stop hard from 0.2 m/s or more, so that it slides on by itself; poses "
                "at 100 Hz tell more than at 30"
            )
        return said


def estimate(
    recording: PushedStreams | Pushed,
    effects: Sequence[str] = (),
    known: KnownPushed | None = None,
) -> PushedEstimate | LinkedEstimate:
    """Estimate friction force, mass and centre of mass of a pushed object of one or two parts.

    Args:
        recording: streams, or what has them; poses may be sparse, before and after each push.
        effects: names of those in the model.
        known: of an object of one part before all that is in the recording, such as before a
            change; None: nothing.

    Raises:
        BadInputError: an effect is unknown, nothing is touched while poses are known, or signs,
            units or axes are other ones.
        NotIdentifiableError: the object has more than two parts, slides too little, or the
            optimiser did not come to an end.
    """
    return estimate_with_fit(recording, effects, known)[0]


def estimate_with_fit(
    recording: PushedStreams | Pushed,
    effects: Sequence[str] = (),
    known: KnownPushed | None = None,
) -> tuple[PushedEstimate | LinkedEstimate, PushFit | PairFit | None]:
    """`estimate`, and the fit that it is read from, so that the same fit can be questioned.

    The fit is None where poses are sparse, or two parts are separate or their numbers only guessed.
    """
    streams = recording if isinstance(recording, PushedStreams) else recording.streams
    check_reading(streams)
    if len(streams.links) > 1:
        return _of_pair(streams, effects)
    return _of_one(streams, effects, known)


def _of_pair(
    streams: PushedStreams, effects: Sequence[str]
) -> tuple[LinkedEstimate, PairFit | None]:
    chosen = PUSHED.create_all(effects)
    if _is_sparse(streams):
        raise NotIdentifiableError(
            "poses before and after pushes alone: for a single part only; record poses at 5 Hz"
        )
    from tactile_dynamics_ros.core.planar.properties.linked_estimate import estimate_pair

    return estimate_pair(streams, lambda part: _of_one(part)[0], chosen)


def _of_one(
    streams: PushedStreams, effects: Sequence[str] = (), known: KnownPushed | None = None
) -> tuple[PushedEstimate, PushFit | None]:
    patch = SupportPatch(np.asarray(streams.links[0].footprint, dtype=float))
    chosen = PUSHED.create_all(effects)
    if not streams.feels:
        if chosen:
            raise NotIdentifiableError("effects change forces, and none was measured")
        return _of_paths(streams, patch), None
    if _is_sparse(streams):
        if chosen:
            raise NotIdentifiableError(
                "poses before and after pushes alone tell no effects; record them at 5 Hz"
            )
        return _of_sparse(fit_sparse(streams), streams, patch), None
    from tactile_dynamics_ros.core.planar.properties.fit import error_without_effects, fit_push

    fit = fit_push(streams, chosen, known)
    found = _of_dense(fit, streams, patch)
    if chosen:
        found = replace(found, error_without=error_without_effects(fit))
    return found, fit


def _is_sparse(streams: PushedStreams) -> bool:
    """Whether poses are known less than `_SPARSE_RATE` times per second of force."""
    step = max(
        (float(np.median(np.diff(c.time))) for c in streams.contacts.values() if len(c.time) > 1),
        default=0.0,
    )
    touched = step * max((len(c.time) for c in streams.contacts.values()), default=0)
    return len(streams.links[0].time) < _SPARSE_RATE * touched


def _duration(streams: PushedStreams) -> float:
    return float(streams.links[0].time[-1] - streams.links[0].time[0])


def _of_dense(fit: PushFit, streams: PushedStreams, patch: SupportPatch) -> PushedEstimate:
    if not fit.converged:
        raise NotIdentifiableError(
            "the fit of the push did not come to an end: the model may lack something (ask "
            "`diagnose`), or footprint, units or clocks are wrong"
        )
    chosen = [NAMES.index(n) for n in ("ln_product", "ln_mass", "com_x", "com_y")]
    here = fit.covariance[np.ix_(chosen, chosen)]
    elsewhere = np.diag(np.array([*fit.place_std, 0.0])[[0, 3, 1, 2]] ** 2)
    at, late = NAMES.index("ln_inertia"), NAMES.index("delay")
    common = fit.common[chosen]
    here = _doubted(here, streams, float(np.exp(common[1])))
    covariance = here + elsewhere
    lost = fit.mass_is_bound or fit.whitened_rms > ASTRAY
    if fit.model.intervals.step > COARSE or lost:
        here, covariance = _without_mass(here), _without_mass(covariance)
    if lost:
        common[1] = common[0] - np.log(USUAL_FRICTION)
    values = _values(
        common + [np.log(-streams.gravity[2]), 0.0, 0.0, 0.0],
        covariance,
        streams,
        patch,
        (fit.common[NAMES.index("ln_scale")], fit.std(NAMES.index("ln_scale"))),
        (fit.common[at], fit.std(at)),
    )
    return PushedEstimate(
        samples=int(fit.model.data.mask.sum()),
        duration=_duration(streams),
        values=values,
        undetermined=tuple(vague(values, patch.gyration)),
        covariance=covariance,
        error=fit.whitened_rms,
        effects=fit.effects,
        here=here,
        delay=(float(fit.common[late]), fit.std(late)),
        unevenness=fit.variation,
    )


def _of_sparse(fit: SparseFit, streams: PushedStreams, patch: SupportPatch) -> PushedEstimate:
    if not fit.converged:
        raise NotIdentifiableError(
            "the fit of the pushes did not come to an end from two starts; check footprint, units "
            "and the pusher's path"
        )
    chosen = [SPARSE_NAMES.index(n) for n in ("ln_product", "ln_mass", "com_x", "com_y")]
    covariance = _without_mass(_doubted(fit.covariance[np.ix_(chosen, chosen)], streams, 1.0))
    at = SPARSE_NAMES.index("ln_scale")
    centre = fit.values[chosen[2:]] - patch.centroid
    values = _values(
        np.append(fit.values[chosen[:2]], centre),
        covariance,
        streams,
        patch,
        (fit.values[at], fit.std[at]),
        (0.0, _PRIOR_FRICTION_STD),
    )
    return PushedEstimate(
        samples=len(fit.residuals),
        duration=_duration(streams),
        values=values,
        undetermined=tuple(vague(values, patch.gyration)),
        covariance=covariance,
        error=fit.residual_rms,
    )


def _of_paths(streams: PushedStreams, patch: SupportPatch) -> PushedEstimate:
    """What poses of object and pusher tell without a force.

    Raises:
        NotIdentifiableError: no push was slow, or the fit came to no end from any start.
    """
    pushes = cut_pushes(streams)
    slow = np.flatnonzero(pushes.speed < _SLOW)
    if not len(slow):
        raise NotIdentifiableError(
            f"no force was measured and no push was slower than {_SLOW:g} m/s: push slowly for the "
            "centre of mass, and stop hard from 0.2 m/s or more for the friction coefficient"
        )
    fit = fit_pushes(pushes.taken(slow), streams.links[0].footprint)
    if not fit.settled:
        raise NotIdentifiableError(
            "the fit of the paths did not come to an end; check footprint, units and frames"
        )
    chosen = [SPARSE_NAMES.index(n) for n in ("com_x", "com_y")]
    centre, std = fit.values[chosen], fit.std[chosen]
    radius = float(patch.friction_radius(centre[None] - patch.centroid, np.ones(1))[0])
    values = {
        "com_x": (float(centre[0]), float(std[0])),
        "com_y": (float(centre[1]), float(std[1])),
        "friction_radius_m": (radius, radius * SIZE_STD),
    }
    sliding = friction_from_slides(streams, centre)
    if sliding.friction is not None:
        values["friction"] = sliding.friction
    unknown = ["mass", "friction_force_n", "inertia_zz"]
    unknown += ["friction"] * ("friction" not in values) + vague(values, patch.gyration)
    return PushedEstimate(
        samples=len(slow),
        duration=_duration(streams),
        values=values,
        undetermined=tuple(unknown),
        covariance=fit.covariance[np.ix_(chosen, chosen)],
        error=fit.residual_rms,
    )


def _doubted(covariance: Array, streams: PushedStreams, mass: float) -> Array:
    """The covariance with doubts of forces, which friction and mass share, and of mass (kg)."""
    out = covariance.copy()
    out[:2, :2] += streams.force_doubt**2
    out[1, 1] += (streams.mass_doubt / mass) ** 2
    return out


def _without_mass(covariance: Array) -> Array:
    """The covariance with what is known of friction beforehand in place of the mass."""
    out = covariance.copy()
    out[1, :] = out[:, 1] = 0.0
    out[1, 1] = _PRIOR_FRICTION_STD**2
    return out


def _values(
    common: Array,
    covariance: Array,
    streams: PushedStreams,
    patch: SupportPatch,
    scale: tuple[float, float],
    inertia: tuple[float, float],
) -> dict[str, tuple[float, float]]:
    """Values and std by name.

    Args:
        common: (4,) ln friction force (N), ln mass (kg), centre of mass from the centroid (m).
        covariance: (4, 4) of them.
        streams: for gravity.
        patch: footprint.
        scale: ln of the size of the part that carries, and its std.
        inertia: ln of the inertia over that of an even plate, and its std.
    """
    force, mass = np.exp(common[:2])
    std = np.sqrt(np.diag(covariance))
    ratio = max(covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1], 0.0)
    friction = force / mass / -streams.gravity[2]
    centre = patch.centroid + common[2:4]
    radius = float(patch.friction_radius(common[None, 2:4], np.exp([scale[0]]))[0])
    about = mass * patch.gyration * np.exp(inertia[0])
    pairs = {
        "mass": (mass, mass * std[1]),
        "friction": (friction, friction * np.sqrt(ratio)),
        "friction_force_n": (force, force * std[0]),
        "com_x": (centre[0], std[2]),
        "com_y": (centre[1], std[3]),
        "friction_radius_m": (radius, radius * scale[1]),
        "inertia_zz": (about, about * np.hypot(std[1], inertia[1])),
    }
    return {name: (float(value), float(spread)) for name, (value, spread) in pairs.items()}
