"""A fitted arm as a document: links, friction, payload and effects, for later use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.joints.effects import JOINTS, JointEffect
from tactile_dynamics_ros.core.joints.model import JointsModel

_KIND = "joints"
"""What the document says that it is; fixed, so that other files of estimates are refused."""


@dataclass(frozen=True, eq=False)
class KnownArm:
    """What is known of an arm.

    Attributes:
        joints: names.
        bodies: (n, 10) dynamic parameters of each link in its own frame, without the payload.
        payload: (10,) in the last link's frame.
        friction: (3, n) Coulomb friction, viscous friction, offset.
        noise: (n,) noise of a block's mean torque, N m.
        std: (n,) RMS error of the model's torques, N m, with their noise.
        effects: with their parameters.
    """

    joints: tuple[str, ...]
    bodies: Array
    payload: Array
    friction: Array
    noise: Array
    std: Array
    effects: tuple[tuple[JointEffect, Array], ...] = ()

    @classmethod
    def of(cls, model: JointsModel) -> KnownArm:
        """Of a fitted model."""
        left = np.sqrt(np.mean(model.residuals().physical ** 2, axis=0))
        pairs = tuple(zip(model.effects, model.theta, strict=True))
        return cls(
            model.joints,
            model.link_bodies,
            model.payload,
            model.friction,
            model.effort_std,
            left,
            pairs,
        )

    def to_document(self) -> dict[str, Any]:
        """Plain numbers."""
        arrays = ("bodies", "payload", "friction", "noise", "std")
        return {
            "model": _KIND,
            "joints": list(self.joints),
            **{name: getattr(self, name).tolist() for name in arrays},
            "effects": [
                {"name": effect.name, "reading": asdict(effect), "parameters": theta.tolist()}
                for effect, theta in self.effects
            ],
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any], source: str) -> KnownArm:
        """Read what `to_document` gives.

        Args:
            document: parsed.
            source: named in errors.

        Raises:
            BadInputError: it is something else.
        """
        if document.get("model") != _KIND:
            raise BadInputError(
                f"{source}: no model of an arm's joints; expected a file of `estimate --save`"
            )
        try:
            effects = tuple(_effect(entry) for entry in document["effects"])
            bodies, payload, friction, noise, std = (
                np.array(document[name], dtype=float)
                for name in ("bodies", "payload", "friction", "noise", "std")
            )
            names = tuple(str(name) for name in document["joints"])
            return cls(names, bodies, payload, friction, noise, std, effects)
        except (KeyError, TypeError, ValueError) as error:
            raise BadInputError(
                f"{source}: the model of the arm cannot be read ({error})"
            ) from error


def _effect(entry: Mapping[str, Any]) -> tuple[JointEffect, Array]:
    fields = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in entry["reading"].items()
    }
    kind = type(JOINTS.create(entry["name"]))
    return kind(**fields), np.array(entry["parameters"], dtype=float)
