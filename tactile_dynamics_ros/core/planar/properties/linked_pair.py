"""Two parts as they were seen: intervals, and latent motion of both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.planar.effects.joint import LooseJoint
from tactile_dynamics_ros.core.planar.linked.chances import SeenParts, weigh_chances
from tactile_dynamics_ros.core.planar.linked.outlines import (
    RelativePoses,
    in_second,
    meeting_points,
)
from tactile_dynamics_ros.core.planar.linked.pushes import TellingPush, telling_push
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch
from tactile_dynamics_ros.core.planar.properties.intervals import (
    Intervals,
    Sightings,
    cut_intervals,
    smoothed,
)
from tactile_dynamics_ros.core.planar.properties.latent_model import PushData
from tactile_dynamics_ros.core.planar.properties.linked_structure import Structure, infer_structure
from tactile_dynamics_ros.core.planar.streams import PushedStreams

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PairData(PushData):
    """What a model of two parts is made from.

    Attributes:
        touched: (N,) 0 or 1, the part that is touched.
        turning: (N,) whether the parts turn beside each other.
    """

    touched: Array
    turning: Mask


@dataclass(frozen=True, eq=False)
class SeenPart:
    """Poses (M,) of one part beside the motion at their stamps.

    Attributes:
        at: where they lie on the spline. residual: (M, 3) white.
        by_nodes: (M, 3, 3, D) derivative by three nodes. by_common: (M, 3, p).
    """

    at: Sightings
    residual: Array
    by_nodes: Array
    by_common: Array


_LEAST_POSES = 10
"""Poses of each part within the pushes below which their motion tells no structure."""
_PLACED = 0.01
"""Std of a joint's place, m, from which it is looked for where outlines meet: a fifth of a part,
beyond which lever arms would be off by more than a half."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two parts while something pushes them.

    Attributes:
        streams: what was measured. intervals: of it, with poses of both parts.
        nodes, spread: (N, 3) of each part's smoothed motion.
        relative: poses of the second part in the first one's frame.
        loose: whether a joint may have play.
    """

    streams: PushedStreams
    intervals: Intervals
    nodes: tuple[Array, Array]
    spread: tuple[Array, Array]
    relative: RelativePoses
    loose: bool = False

    @classmethod
    def of_streams(cls, streams: PushedStreams, loose: bool = False) -> Pair:
        """Cut a recording into intervals and smooth the motion of both parts.

        Args:
            streams: with poses of both.
            loose: whether a joint may have play.

        Raises:
            BadInputError: nothing is touched while poses are known.
            NotIdentifiableError: there are more than two parts, or too few poses of one.
        """
        if len(streams.links) != 2:
            raise NotIdentifiableError(
                f"{len(streams.links)} links: properties of up to two are estimated; record fewer"
            )
        cut = cut_intervals(streams)
        for k, poses in enumerate(cut.poses):
            if len(poses.time) < _LEAST_POSES:
                raise NotIdentifiableError(
                    f"link_{k + 1} has {len(poses.time)} poses during pushes, expected "
                    f"{_LEAST_POSES} at least; record its pose all the time"
                )
        first, second = (smoothed(cut, poses) for poses in cut.poses)
        relative = RelativePoses.of_links(*streams.links)
        nodes, spread = zip(first, second, strict=True)
        return cls(streams, cut, nodes, spread, relative, loose)

    @cached_property
    def outlines(self) -> tuple[Array, Array]:
        """(V, 2) m, each in its part's frame."""
        first, second = (np.asarray(k.footprint, dtype=float) for k in self.streams.links)
        return first, second

    @cached_property
    def patches(self) -> tuple[SupportPatch, SupportPatch]:
        """Footprints."""
        return SupportPatch(self.outlines[0]), SupportPatch(self.outlines[1])

    @cached_property
    def seen(self) -> SeenParts:
        """Motion of both parts at the inner nodes."""
        cut = self.intervals
        at = np.flatnonzero(cut.inner)
        before, here, after = ([n[at + k] for n in self.nodes] for k in (-1, 0, 1))
        rows = list(zip(before, here, after, strict=True))
        poses = [(b + 6.0 * h + a) / 8.0 for b, h, a in rows]
        velocities = [(a - b) / (2.0 * cut.step) for b, _, a in rows]
        accelerations = [(b - 2.0 * h + a) / cut.step**2 for b, h, a in rows]
        force = float(np.median(np.linalg.norm(cut.force[cut.touching, :2], axis=1)))
        return SeenParts(
            step=cut.step,
            outlines=self.outlines,
            poses=(poses[0], poses[1]),
            velocities=(velocities[0], velocities[1]),
            accelerations=(accelerations[0], accelerations[1]),
            offset=self.relative.value[0],
            point=cut.point[at, :2],
            touching=cut.touching[at],
            force=force,
        )

    @cached_property
    def structure(self) -> Structure:
        """What the parts are to each other."""
        offset = self.relative.value[0]
        place = meeting_points(*self.outlines, offset).mean(axis=0)
        size = sum(float(np.linalg.norm(np.ptp(o, axis=0))) for o in self.outlines) / np.sqrt(2.0)
        between = np.stack([place, in_second(place, offset)])
        chances = weigh_chances(self.seen)
        return infer_structure(self.relative, between, size, chances, self.loose)

    @property
    def play(self) -> tuple[float, float]:
        """Play of the joint and its std, m; no more than its prior where there is no joint."""
        if self.structure.likeliest == "jointed":
            return self.structure.hinge.play
        return 0.0, LooseJoint.parameters[0].prior_std

    @property
    def telling_push(self) -> TellingPush | None:
        """The push that would turn a joint; None where none is wanted, or none would."""
        if self.structure.name not in ("undecided", "jointed"):
            return None
        hinge = self.structure.hinge
        known = np.sqrt(np.trace(hinge.covariance[:2, :2])) < _PLACED
        return telling_push(self.seen, np.stack([hinge.first, hinge.second]) if known else None)

    @cached_property
    def touched(self) -> Array:
        """(N,) 0 or 1, the part that is touched, at every node."""
        cut = self.intervals
        touched = np.zeros(len(cut))
        touched[cut.inner] = self.seen.touched
        return touched

    def alone(self, part: int) -> PushedStreams:
        """One part with what touches it, as an object of its own."""
        contacts = {}
        for name, contact in self.streams.contacts.items():
            touches = np.interp(contact.time, self.intervals.time, self.touched) > 0.5
            kept = touches == (part == 1)
            force = np.where(kept[:, None], contact.force, 0.0)
            contacts[name] = replace(contact, force=force)
        heights = self.streams.com_height, self.streams.com_height_std
        own = [(h[part],) if h is not None else None for h in heights]
        return replace(
            self.streams,
            links=(self.streams.links[part],),
            contacts=contacts,
            com_height=own[0],
            com_height_std=own[1],
        )
