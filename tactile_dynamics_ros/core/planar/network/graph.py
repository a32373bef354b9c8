"""The graph of a push or pull: robot, links and support as nodes, what joins them as edges.

Vectors are those of the contact: origin where the pusher touches, x along the normal into the
object, or along the way of a gripper. A network that sees them so need not learn that the table
looks alike from every side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.mechanics.linkage import turned
from tactile_dynamics_ros.core.planar.mechanics.support import SupportPatch

NODE = 16
"""Features of a node that do not come from mechanics: 13 numbers and which of the three it is. It
follows from `_link_features`; the matrices of a network have as many rows."""
HELP = 6
"""Features of a node by which mechanics help a residual network: mean and final velocities of a
link, or the force on the robot. It follows from `MOTION`; without them the residual is blind."""
EDGE = 10
"""Features of an edge: which of three it is, cause or effect, friction, place and friction of a
joint, whether that is rigid, friction of the tip. It follows from `_edges`."""
MOTION = 6
"""What is predicted of a link: velocity of the centre of mass (2) and turning rate, mean over the
step, then at its end. Both are needed: a step at 15 Hz spans starts and stops."""

_LENGTH = 0.05
"""Unit of lengths among the features, m: half an object. It scales inputs to the order of one;
another one needs another training."""
_HEIGHT = 0.03
"""Unit of heights, m: half an object's. Another one needs another training."""
_FRICTION, _FRICTION_SPREAD = 0.3, 0.4
"""Usual friction of supports and spread of its logarithm, to standardise inputs."""
_MASS, _MASS_SPREAD = 0.7, 0.5
"""Usual mass of a link, kg, and spread of its logarithm, to standardise inputs."""
_STANDS = 1e-4
"""Speed, m/s, below which a gripper has no direction of motion: 0.4 % of a slow pull."""
_TIP_FRICTION, _JOINT_FRICTION = 0.35, 0.03
"""Usual friction of a tip, and of a joint in N m, to standardise inputs."""


@dataclass(frozen=True, eq=False)
class Thing:
    """What is known of an object before it is pushed.

    Attributes:
        patches: footprint of each link.
        com_height: (L,) m above the support; None takes the height of the push for it.
        joint: (2,) m in the frame of link_1, where two links meet; None for one link.
        rigid: whether the joint does not turn. The paper's f_j = 1 is this flag.
    """

    patches: tuple[SupportPatch, ...]
    com_height: Array | None = None
    joint: Array | None = None
    rigid: bool = False

    @property
    def links(self) -> int:
        """L."""
        return len(self.patches)


@dataclass(frozen=True, eq=False)
class Push:
    """What the pusher does in one step to each of C hypotheses.

    Attributes:
        point: (C, 2) m, where it touches when the step begins, or between the pads.
        velocity: (C, 2) m/s.
        normal: (C, 2) into the object, or `grip_axis`. touching: (C,) 1 or 0. height: (C,) m.
        step: s. link: index of the touched link.
        turning: (C,) rad/s of a gripper that the link turns with; None for a tip.
    """

    point: Array
    velocity: Array
    normal: Array
    touching: Array
    height: Array
    step: float
    link: int = 0
    turning: Array | None = None


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes and edges of C pushes of objects with L links, the touched one first.

    Attributes:
        nodes: (C, 2 + L, F) robot, support, links.
        edges: (C, 2 L, EDGE) static features: robot to the touched link, each link to the next,
            then support to each link.
    """

    nodes: Array
    edges: Array


def touched_first(links: int, link: int) -> list[int]:
    """Order of links in which the touched one comes first."""
    return [link, *(k for k in range(links) if k != link)]


def grip_axis(velocity: Array, yaw: Array) -> Array:
    """Direction (C, 2) in which grippers move, those that stand by their yaw (C,)."""
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    own = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    return np.where(speed > _STANDS, velocity / np.maximum(speed, _STANDS), own)


def to_contact(vector: Array, normal: Array) -> Array:
    """Vectors (C, 2) in axes of the contact; a third number is about the vertical and stays."""
    x, y = normal[:, 0], normal[:, 1]
    a, b = vector[:, 0], vector[:, 1]
    return np.column_stack([x * a + y * b, x * b - y * a, vector[:, 2:]])


def from_contact(vector: Array, normal: Array) -> Array:
    """The inverse of `to_contact`: axes of the support."""
    return to_contact(vector, normal * np.array([1.0, -1.0]))


def centre_motion(states: Array, parameters: Array, link: int) -> tuple[Array, Array]:
    """Place (C, 2) and velocity (C, 3) of a link's centre of mass."""
    own = states[:, 6 * link : 6 * link + 6]
    arm = turned(parameters[:, 4 * link + 2 : 4 * link + 4], own[:, 2])
    across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    velocity = own[:, 3:5] + own[:, 5:6] * across
    return own[:, :2] + arm, np.concatenate([velocity, own[:, 5:6]], axis=1)


def build_graph(
    thing: Thing, states: Array, parameters: Array, push: Push, speed: float, help_: Array | None
) -> Graph:
    """Graph of C hypotheses.

    Args:
        thing: geometry.
        states: (C, 6 L).
        parameters: (C, p), those of `LINK_PARAMETERS` of each link, then ln of the tip's friction,
            and of the joint's (N m) where there is one.
        push: of the robot.
        speed: unit of velocities, m/s.
        help_: (C, 1 + L, HELP) what mechanics expect of robot and links (touched first) in units
            of the network's outputs, or None.
    """
    order = touched_first(thing.links, push.link)
    kinds = np.eye(3)
    count = len(states)
    units = np.array([speed, speed, speed / _LENGTH])
    robot = np.zeros((count, 13))
    robot[:, 4:6] = to_contact(push.velocity, push.normal) / speed * push.touching[:, None]
    if push.turning is not None:
        robot[:, 6] = push.turning / units[2] * push.touching
    robot[:, 8], robot[:, 12] = push.height / _HEIGHT - 1.0, push.touching
    own = [_link_features(thing, states, parameters, push, units, k) for k in order]
    parts = [robot, np.zeros((count, 13)), *own]
    types = [kinds[0], kinds[1], *[kinds[2]] * thing.links]
    nodes = np.stack(
        [np.concatenate([p, np.tile(t, (count, 1))], axis=1)
         for p, t in zip(parts, types, strict=True)], axis=1,
    )  # fmt: skip
    if help_ is not None:
        more = np.insert(help_, 1, 0.0, axis=1)
        nodes = np.concatenate([nodes, more], axis=2)
    return Graph(nodes, _edges(thing, states, parameters, push, order))


def _link_features(
    thing: Thing, states: Array, parameters: Array, push: Push, units: Array, link: int
) -> Array:
    """Features (C, 13) of one link."""
    patch, yaw = thing.patches[link], states[:, 6 * link + 2]
    place, velocity = centre_motion(states, parameters, link)
    middle = states[:, 6 * link : 6 * link + 2] + turned(
        np.broadcast_to(patch.centroid, (len(yaw), 2)), yaw
    )
    moving = np.column_stack([to_contact(velocity[:, :2], push.normal), velocity[:, 2]]) / units
    heading = yaw - np.arctan2(push.normal[:, 1], push.normal[:, 0])
    same = np.ones((len(yaw), 1))
    height = push.height if thing.com_height is None else np.full(len(yaw), thing.com_height[link])
    mass = (parameters[:, 4 * link + 1] - np.log(_MASS)) / _MASS_SPREAD
    return np.concatenate(
        [
            to_contact(place - push.point, push.normal) / _LENGTH,
            to_contact(middle - push.point, push.normal) / _LENGTH,
            moving,
            mass[:, None],
            height[:, None] / _HEIGHT - 1.0,
            same * np.log(patch.gyration / 0.035**2),
            _elongation(patch, heading),
            same * (link == push.link),
        ],
        axis=1,
    )


def _elongation(patch: SupportPatch, heading: Array) -> Array:
    """How much longer than broad a footprint is, and in which direction (C, 2)."""
    second = (patch.offset * patch.share[:, None]).T @ patch.offset
    plain = np.array([second[0, 0] - second[1, 1], 2.0 * second[0, 1]]) / np.trace(second)
    return turned(np.broadcast_to(plain, (len(heading), 2)), 2.0 * heading)


def _edges(thing: Thing, states: Array, parameters: Array, push: Push, order: list[int]) -> Array:
    """Static features (C, 2 L, EDGE) of edges in the direction of the cause."""
    count, links = len(states), thing.links
    edges = np.zeros((count, 2 * links, EDGE))
    edges[:, 0, 0] = 1.0
    if push.turning is None:
        edges[:, 0, 9] = (parameters[:, 4 * links] - np.log(_TIP_FRICTION)) / _FRICTION_SPREAD
    for k in range(1, links):
        assert thing.joint is not None
        place = states[:, :2] + turned(np.broadcast_to(thing.joint, (count, 2)), states[:, 2])
        edges[:, k, 1] = 1.0
        edges[:, k, 5:7] = to_contact(place - push.point, push.normal) / _LENGTH
        edges[:, k, 8] = float(thing.rigid)
        if not thing.rigid:
            edges[:, k, 7] = parameters[:, 4 * links + 1] - np.log(_JOINT_FRICTION)
    for k, link in enumerate(order):
        friction = parameters[:, 4 * link] - parameters[:, 4 * link + 1]
        edges[:, links + k, 2] = 1.0
        edges[:, links + k, 4] = (friction - np.log(_FRICTION)) / _FRICTION_SPREAD
    return edges
