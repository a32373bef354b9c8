"""Effects that every finger has for itself: parameters per contact, restrictions to some."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from itertools import combinations
from typing import ClassVar

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.contact.wrench_samples import WrenchSamples
from tactile_dynamics_ros.core.effects.effect import Effect
from tactile_dynamics_ros.core.effects.geometry import body_from_world
from tactile_dynamics_ros.core.effects.parameter import EffectParameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.rigid_body.rotation import log_so3

_COMMON = "common"
"""Reading in which all contacts share one set of parameters; names are API."""
_MOST_SUBSETS = 6
"""Contacts up to which every subset is a restriction: 62 of them. Of more, single ones and all but
one are tried: their number would grow as 2^n, and each pays 2 log n evidence for being searched.
Lower would not try pairs of fingers that share a fault."""
_LEAST_TURN = 0.04
"""Turn of contact frames in the body, rad, from which axes of the sensor differ from those of the
body. `_MOSTLY` of the samples of a finger that does not roll turn by less than 0.004 (noise) in
synthetic recordings; re-grasps turn by 0.07 to 0.3, fingers that roll by 0.4 to 0.6. Lower offers
both axes where only noise tells them apart, which costs evidence; higher misses re-grasps."""
_MOSTLY = 0.9
"""Quantile of the samples whose turn counts, so that few bad frames are no turn, and a re-grasp
that lasts a tenth of the recording is one. Higher lets bad frames decide, lower misses such a
re-grasp."""


class FingerEffect(Effect):
    """An effect with its own parameters at each of the chosen contacts (all by default).

    A reading is written `index+thumb` (those contacts), `common` (one set of parameters for all)
    or empty (every contact for itself).

    Attributes:
        allows_common: whether one set of parameters for all contacts is a sensible reading.
    """

    external = False
    allows_common = False

    def __init__(self, contacts: tuple[str, ...] = (), common: bool = False) -> None:
        """Choose the contacts.

        Args:
            contacts: names; empty means all.
            common: all contacts share one set of parameters.
        """
        self.contacts = contacts
        self.common = common
        self.reading = _COMMON if common else "+".join(contacts)

    def with_reading(self, reading: str) -> Effect:
        """`common` or contact names joined by `+`."""
        if reading == _COMMON and self.allows_common:
            return type(self)(common=True)
        return type(self)(tuple(reading.split("+")) if reading else ())

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Every contact for itself, and all in common where that makes sense."""
        own = type(self)()
        if self.allows_common and len(samples.contact_names) > 1:
            return (own, type(self)(common=True))
        return (own,)

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """Every proper subset of contacts (of one and all but one for many contacts)."""
        chosen = self.chosen(samples)
        if self.common or len(chosen) < 2:
            return ()
        width = len(self.contact_parameters(samples, chosen[0]))
        names = samples.contact_names
        found = []
        for picked in _proper_subsets(len(chosen)):
            effect = type(self)(tuple(names[chosen[i]] for i in picked))
            columns = tuple(width * i + j for i in picked for j in range(width))
            found.append((effect, columns))
        return tuple(found)

    def freest(self) -> tuple[Effect, ...]:
        """All contacts, each for itself."""
        return (type(self)(),)

    @abstractmethod
    def axis_parameters(self) -> tuple[EffectParameter, ...]:
        """Parameters of one contact, without the name of the contact."""

    def contact_parameters(
        self, samples: WrenchSamples, contact: int
    ) -> tuple[EffectParameter, ...]:
        """Parameters of one contact of these samples, the same count for every contact."""
        return self.axis_parameters()

    @abstractmethod
    def finger_wrench(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Delta (N, 6) of one contact."""

    @abstractmethod
    def finger_jacobian(self, samples: WrenchSamples, contact: int, theta: Array) -> Array:
        """Derivative (N, 6, k) of one contact."""

    def chosen(self, samples: WrenchSamples) -> list[int]:
        """Indices of the chosen contacts.

        Raises:
            BadInputError: a chosen contact is not in the samples.
        """
        if not self.contacts:
            return list(range(len(samples.contact_names)))
        unknown = sorted(set(self.contacts) - set(samples.contact_names))
        if unknown:
            raise BadInputError(
                f"effect '{self.label}': contact '{unknown[0]}' is not in the recording: "
                f"expected {', '.join(samples.contact_names)}"
            )
        return [samples.contact_names.index(name) for name in self.contacts]

    def parameters(self, samples: WrenchSamples) -> tuple[EffectParameter, ...]:
        """Parameters named `<symbol>_<contact>`, or plain where common."""
        if self.common:
            return self.contact_parameters(samples, 0)
        return tuple(
            replace(p, name=f"{samples.contact_names[c]}_{p.name}", typical=p.typical / (1 + i))
            for i, c in enumerate(self.chosen(samples))
            for p in self.contact_parameters(samples, c)
        )

    def wrench(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Sum over the chosen contacts."""
        parts = [self.finger_wrench(samples, c, part) for c, part in self._split(samples, theta)]
        return np.asarray(np.sum(parts, axis=0))

    def jacobian(self, samples: WrenchSamples, inertia: Array, theta: Array) -> Array:
        """Columns of the chosen contacts side by side, or their sum where common."""
        columns = [self.finger_jacobian(samples, c, p) for c, p in self._split(samples, theta)]
        total = np.sum(columns, axis=0) if self.common else np.concatenate(columns, axis=2)
        return np.asarray(total)

    def _split(self, samples: WrenchSamples, theta: Array) -> list[tuple[int, Array]]:
        chosen = self.chosen(samples)
        if self.common:
            return [(c, theta) for c in chosen]
        return list(zip(chosen, np.split(theta, len(chosen)), strict=True))


class FramedFingerEffect(FingerEffect):
    """A finger effect that is constant in one of several frames.

    A reading is written `index+thumb@world`; the first of `frames` needs no suffix.

    Attributes:
        frames: of `body`, `sensor` (the contact frame) and `world`; the default first.
    """

    frames: ClassVar[tuple[str, ...]] = ("body", "sensor")

    def __init__(
        self, contacts: tuple[str, ...] = (), common: bool = False, frame: str = ""
    ) -> None:
        """Choose contacts and frame.

        Args:
            contacts: names; empty means all.
            common: all contacts share one set of parameters.
            frame: one of `frames`; the first by default.
        """
        super().__init__(contacts, common)
        self.frame = frame or self.frames[0]
        suffix = "" if self.frame == self.frames[0] else f"@{self.frame}"
        self.reading = "+".join(contacts) + suffix

    def with_reading(self, reading: str) -> Effect:
        """`index+thumb`, `@sensor` or both."""
        contacts, _, frame = reading.partition("@")
        if frame not in ("", *self.frames):
            raise BadInputError(
                f"effect '{self.name}' has no frame '{frame}': expected {', '.join(self.frames)}"
            )
        return type(self)(tuple(contacts.split("+")) if contacts else (), False, frame)

    def readings(self, samples: WrenchSamples) -> tuple[Effect, ...]:
        """Every frame; body and sensor frame are told apart only if contact frames turn."""
        frames = self.frames
        if not frames_turn(samples):
            frames = frames[:1] + tuple(f for f in frames[1:] if f == "world")
        return tuple(type(self)((), False, frame) for frame in frames)

    def restrictions(self, samples: WrenchSamples) -> tuple[tuple[Effect, tuple[int, ...]], ...]:
        """Subsets of the contacts in the same frame."""
        return tuple(
            (type(self)(effect.contacts, False, self.frame), columns)
            for effect, columns in super().restrictions(samples)
            if isinstance(effect, FingerEffect)
        )

    def freest(self) -> tuple[Effect, ...]:
        """All contacts, in every frame."""
        return tuple(type(self)((), False, frame) for frame in self.frames)

    def axes(self, samples: WrenchSamples, contact: int) -> Array:
        """Axes of the frame at one contact, as columns in the body frame, (N, 3, 3)."""
        if self.frame == "sensor":
            return samples.contact_rotation[:, contact]
        if self.frame == "world":
            return body_from_world(samples)
        return np.broadcast_to(np.eye(3), (len(samples.time), 3, 3))


def frames_turn(samples: WrenchSamples) -> bool:
    """Whether the frame of any contact turns in the body frame, for instance by a re-grasp."""
    turns = []
    for contact, touching in enumerate(samples.in_contact.T):
        frames = samples.contact_rotation[touching, contact]
        turned = log_so3(frames @ np.swapaxes(frames[:1], 1, 2))
        turns.append(np.quantile(np.linalg.norm(turned, axis=-1), _MOSTLY) if len(turned) else 0.0)
    return max(turns, default=0.0) > _LEAST_TURN


def _proper_subsets(count: int) -> list[tuple[int, ...]]:
    everything = range(count)
    sizes = range(1, count) if count <= _MOST_SUBSETS else (1, count - 1)
    return [subset for size in sizes for subset in combinations(everything, size)]
