"""What is said of two parts: JSON and sentences."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.linked.pushes import TellingPush

Value = tuple[float, float]
Effects = dict[str, dict[str, dict[str, Any]]]
"""Value, std and unit by effect and parameter."""

_NAMES = {"rigid": "rigidly joined", "jointed": "jointed", "separate": "separate objects"}
"""Words for what two parts are to each other, in the order in which sentences list them."""
_UNKNOWN = 0.2
"""Relative std from which a quantity is undetermined, as every mass of this product."""
_UNKNOWN_COM = 0.25
"""Std of a coordinate of the centre of mass over the footprint's radius of gyration from which it
is undetermined: half the prior's."""
PLACES = ("com_", "carried_")
"""How the names of coordinates begin: of centres of mass, and of where friction acts."""
_TELL_STRUCTURE = (
    "push sideways close to where the parts meet, on either part in turn, faster or further"
)
"""Action that tells rigid from jointed parts: there the other part trails and turns a joint."""
_TELL_SHARES = (
    "lift or push the parts one by one: parts that move as one body do not tell their shares"
)
"""Action that tells the shares of parts which are one body, as no push of both together does."""
_TELL_BY_TURNING = (
    "push so that the joint turns by more than 5 degrees: parts that move as one body tell neither "
    "their shares nor the friction of the joint"
)
"""Action that tells shares and joint friction where the joint has hardly turned so far."""
_TELL_PLAY = "estimate --effects loose_joint: the parts move as on a joint with play"
"""Action where a joint with play is far likelier than all that the model has."""
_TELL_UNTOUCHED = "push each part"
"""Action that tells a separate part of which only poses are known, since nothing touched it."""
TELL_MASS = "push faster and brake over 0.3 s, or shake while pulling, with forces at 100 Hz"
"""Action that tells masses from products: only acceleration does, as for one part alone."""


_TELL_CENTRES = (
    "lift the parts one by one: where a joint keeps parts from tipping, friction tells where each "
    "is carried, not where its centre of mass lies"
)
"""Action that tells the centres of mass of parts on a joint; pushes tell the common one."""


@dataclass(frozen=True)
class PlacedJoint:
    """Where a joint lies and how hard it turns.

    Attributes:
        position: (2,) m in the first part's frame. std: (2,) m.
        friction_torque: N m and its std, or None where it did not turn far enough.
    """

    position: Array
    std: Array
    friction_torque: Value | None


@dataclass(frozen=True)
class LinkedEstimate:
    """What is known of two parts on a support.

    Attributes:
        samples: intervals in which both slide. duration: s.
        structure: "rigid", "jointed", "separate" or "undecided".
        probability: of the three.
        links: value and std by name of each part, as of one part; on a joint also carried_x and
            carried_y, where its friction acts (m, its frame).
        whole: mass (kg), friction_force_n (N) and, of parts that moved as one body, com_x, com_y
            (m, first part's frame), with std.
        joint: where the structure is "jointed".
        undetermined: names such as "link_1.mass" that this recording does not tell.
        remedies: actions that would tell them.
        covariance: of the numbers that `covariance_names` lists.
        error: whitened RMS, 1 where only noise remains; None without a fit.
        effects: of those in the model.
    """

    samples: int
    duration: float
    structure: str
    probability: dict[str, float]
    links: tuple[dict[str, Value], dict[str, Value]]
    whole: dict[str, Value]
    joint: PlacedJoint | None
    undetermined: tuple[str, ...]
    remedies: tuple[str, ...]
    covariance: Array
    covariance_names: tuple[str, ...]
    error: float | None
    effects: Effects = field(default_factory=dict)

    @property
    def is_answer(self) -> bool:
        """Whether the friction force of both parts together is known."""
        return "friction_force_n" not in self.undetermined

    def to_document(self) -> dict[str, Any]:
        """JSON of the estimate."""
        joint: dict[str, Any] = {
            "probability": self.probability["jointed"],
            "position": None,
            "position_std": None,
            "friction_torque_nm": None,
        }
        if self.joint is not None:
            joint["position"] = self.joint.position.tolist()
            joint["position_std"] = self.joint.std.tolist()
            if self.joint.friction_torque is not None:
                joint["friction_torque_nm"] = _pair(self.joint.friction_torque)
        return {
            "model": "pushed",
            "samples": self.samples,
            "duration_s": self.duration,
            "structure": self.structure,
            "structure_probability": self.probability,
            "links": [_described(link) for link in self.links],
            "whole": _described(self.whole),
            "joint": joint,
            "undetermined": list(self.undetermined),
            "remedies": list(self.remedies),
            "covariance": {
                "names": list(self.covariance_names),
                "matrix": self.covariance.tolist(),
            },
            "effects": self.effects,
            "error": self.error,
        }

    def lines(self, fits: bool = True) -> list[str]:
        """Sentences for people.

        Args:
            fits: whether the model explains the recording; else no push would tell more.
        """
        said = [_structure_line(self.structure, self.probability)]
        if self.joint is not None:
            x, y = 1e3 * self.joint.position
            dx, dy = 1e3 * self.joint.std
            said.append(f"joint             {x:.1f} ± {dx:.1f}, {y:.1f} ± {dy:.1f} mm in link_1")
            if self.joint.friction_torque is not None:
                said.append(
                    "joint friction    {:.4f} ± {:.4f} N m".format(*self.joint.friction_torque)
                )
        said.append("both together     friction force {:.3f} ± {:.3f} N".format(
            *self.whole["friction_force_n"]))  # fmt: skip
        for k, link in enumerate(self.links):
            said += _link_lines(f"link_{k + 1}", link, self.undetermined)
        if self.error is not None:
            said.append(
                f"error             {self.error:.2f} times the noise, {self.samples} samples"
            )
        said += effect_lines(self.effects)
        if self.undetermined:
            said.append(f"undetermined: {', '.join(self.undetermined)}")
        said += [f"to tell more: {remedy}" for remedy in self.remedies if fits]
        return said


def effect_lines(effects: Effects) -> list[str]:
    """Parameters of effects, a line each."""
    said = []
    for name, parameters in effects.items():
        numbers = [
            f"{symbol} = {entry['value']:.3g} ± {entry['std']:.2g} {entry['unit']}".strip()
            for symbol, entry in parameters.items()
        ]
        said.append(f"{name}: {', '.join(numbers)}")
    return said


def vague(values: dict[str, Value], gyration: float | None = None) -> list[str]:
    """Names of what is not determined.

    Args:
        values: value and std by name.
        gyration: squared radius of gyration of the footprint, m^2; None where no centre is asked.
    """
    relative = [name for name in values if not name.startswith(PLACES)]
    names = [n for n in relative if values[n][1] > _UNKNOWN * abs(values[n][0])]
    reach = _UNKNOWN_COM * (0.0 if gyration is None else gyration) ** 0.5
    centre = () if gyration is None else ("com_x", "com_y")
    return names + ["com"] * any(values[n][1] > reach for n in centre)


def _pair(value: Value) -> dict[str, float]:
    return {"value": value[0], "std": value[1]}


def _described(values: dict[str, Value]) -> dict[str, Any]:
    found: dict[str, Any] = {
        name: _pair(value) for name, value in values.items() if not name.startswith(PLACES)
    }
    for stem, told in zip(PLACES, ("com", "carried_at"), strict=True):
        if f"{stem}x" in values:
            (x, dx), (y, dy) = values[f"{stem}x"], values[f"{stem}y"]
            found[told] = {"value": [x, y], "std": [dx, dy]}
    return found


def _structure_line(structure: str, probability: dict[str, float]) -> str:
    shares = ", ".join(f"{_NAMES[name]} {p:.3f}" for name, p in probability.items())
    if structure == "undecided":
        return f"parts             undecided: the motion does not tell ({shares})"
    return f"parts             {_NAMES[structure]} ({shares})"


def _link_lines(name: str, link: dict[str, Value], undetermined: tuple[str, ...]) -> list[str]:
    said = []
    if f"{name}.friction_force_n" not in undetermined:
        said.append("{}  friction force  {:.3f} ± {:.3f} N".format(name, *link["friction_force_n"]))
    if f"{name}.mass" not in undetermined:
        said.append("{}  mass            {:.3f} ± {:.3f} kg".format(name, *link["mass"]))
    if f"{name}.friction" not in undetermined:
        said.append("{}  friction        {:.3f} ± {:.3f}".format(name, *link["friction"]))
    shown = {"com_": f"{name}.com" not in undetermined, "carried_": "carried_x" in link}
    for stem, title in zip(PLACES, ("centre of mass", "carried at    "), strict=True):
        if shown[stem]:
            (x, dx), (y, dy) = link[f"{stem}x"], link[f"{stem}y"]
            said.append(
                f"{name}  {title}  {1e3 * x:.1f} ± {1e3 * dx:.1f}, {1e3 * y:.1f} ± "
                f"{1e3 * dy:.1f} mm in its frame"
            )
    return said


def remedies(
    structure: str,
    one_body: bool,
    undetermined: tuple[str, ...],
    slack: float | None = None,
    push: TellingPush | None = None,
) -> tuple[str, ...]:
    """Actions that would tell what is not known.

    Args:
        structure: what the parts are to each other.
        one_body: whether they moved as one body.
        undetermined: names that are not known.
        slack: play of a joint, m, that the motion shows and the model lacks.
        push: that would turn a joint.
    """
    such = f"; such as: {push.words}" if push is not None else ""
    said = [_TELL_STRUCTURE + such] * (structure == "undecided")
    if slack is not None:
        said.insert(0, f"{_TELL_PLAY} (about {1e3 * slack:.1f} mm)")
    parts = [n for n in undetermined if "." in n]
    if parts and structure == "separate":
        said.append(_TELL_UNTOUCHED)
    if parts and one_body:
        said.append(_TELL_BY_TURNING + such if structure == "jointed" else _TELL_SHARES)
    if not one_body and structure == "jointed":
        said.append(_TELL_CENTRES)
    if not one_body and any(n.endswith("mass") for n in parts):
        said.append(TELL_MASS)
    return tuple(said)
