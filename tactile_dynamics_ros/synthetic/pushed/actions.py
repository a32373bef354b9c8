"""What the robot does: paths of a tip that pushes, and of a gripper that pulls or shakes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_dynamics_ros.synthetic.pushed.objects import PushedObject

BEFORE, AFTER = 0.15, 0.35
"""s at rest before an action, and after it while the pusher withdraws."""
_RAMP = 0.1
"""s in which a pusher reaches its speed; a real arm takes about that."""
_HOLD = 0.15
"""s for which the tip stays where a leg of its way ends: what slides on comes to rest meanwhile."""
_RETREAT = 0.12
"""m/s."""


@dataclass(frozen=True)
class Action:
    """One motion of the pusher, in a frame that is fixed when it begins.

    Push: origin at the tip's first place, x along the push. Pull: origin between the pads.

    Attributes:
        kind: "push" or "pull".
        link: which one is touched.
        point: (2,) m on the outline (push) or between the pads (pull), frame of the link.
        heading: rad, direction of x in the frame of the link.
        normal: (2,) of the outline at the point, inwards, frame of the link.
        grip: m, half the distance of the pads (pull).
        gap: m between tip and outline at the beginning.
        path: (K, 3) x, y in m and yaw in rad at every step of the physical clock.
        speed: m/s, the largest.
    """

    kind: str
    link: int
    point: np.ndarray
    heading: float
    normal: np.ndarray
    grip: float
    gap: float
    path: np.ndarray
    speed: float


@dataclass(frozen=True)
class ActionOptions:
    """How pushes and pulls are made.

    Attributes:
        count: of actions.
        kind: "push", "pull", "shake" or "mixed" (pushes and pulls take turns).
        speed: (2,) m/s, drawn between these on a logarithmic scale.
        travel: m of each action.
        duration: s of the motion of each action, at most: slow ones travel less.
        pauses: stops on the way of each push.
        hard_stop: whether the speed falls within 20 ms instead of 100.
        gap: m that the tip flies before it meets the object; above 0 there are impacts.
        tilt_deg: largest angle of a push to the outline's normal.
        curved: whether paths bend by up to 60 degrees.
    """

    count: int = 6
    kind: str = "push"
    speed: tuple[float, float] = (0.03, 0.2)
    travel: float = 0.09
    duration: float = 2.0
    pauses: int = 1
    hard_stop: bool = True
    gap: float = 0.0
    tilt_deg: float = 15.0
    curved: bool = False


@dataclass(frozen=True)
class PlannedPush:
    """A straight push that somebody asked for, in the frame of the part that is touched.

    Attributes:
        point: (2,) m, near the outline.
        direction: (2,).
        speed: m/s at most.
        length: m of the tip's way.
        acceleration: m/s^2 at the start. braking: m/s^2 at the end.
    """

    point: np.ndarray
    direction: np.ndarray
    speed: float
    length: float
    acceleration: float
    braking: float


def draw_actions(
    thing: PushedObject, options: ActionOptions, rng: np.random.Generator, step: float
) -> list[Action]:
    """Draw all actions of a recording; the sides that are pushed go round the object."""
    start = rng.uniform(0.0, 2.0 * np.pi)
    actions = []
    for k in range(options.count):
        pull = options.kind in ("pull", "shake") or (options.kind == "mixed" and k % 2 == 1)
        link = k % len(thing.links) if not pull else 0
        angle = start + 2.0 * np.pi * (k * 0.382 + 0.08 * rng.normal())
        maker = _pull if pull else _push
        actions.append(maker(thing, link, angle, options, rng, step))
    return actions


def _push(
    thing: PushedObject,
    link: int,
    angle: float,
    options: ActionOptions,
    rng: np.random.Generator,
    step: float,
) -> Action:
    if len(thing.links) == 2:
        free = np.pi if link == 0 else 0.0
        angle = free + (angle % (2.0 * np.pi) - np.pi) * 0.55
    point, normal = _point_at(thing.links[link].corners, angle)
    tilt = np.radians(options.tilt_deg) * rng.uniform(-1.0, 1.0)
    heading = float(np.arctan2(normal[1], normal[0]) + tilt)
    speed = float(np.exp(rng.uniform(*np.log(options.speed))))
    path = _pushing_path(speed, options, rng, step)
    return Action("push", link, point, heading, normal, 0.0, options.gap, path, speed)


def straight_push(thing: PushedObject, planned: PlannedPush, step: float) -> Action:
    """Return a push of link_1 that somebody asked for, without a pause on its way.

    Args:
        thing: the object.
        planned: how it is pushed.
        step: s of the physical clock.
    """
    point, normal = _nearest_edge(thing.links[0].corners, planned.point)
    back = -_leg(_RETREAT, AFTER, _RAMP, step)
    rests = [np.zeros(round(rest / step)) for rest in (BEFORE, _HOLD)]
    pace = np.concatenate([rests[0], _trapezoid(planned, step), rests[1], back])
    x = np.cumsum(pace) * step
    path = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    heading = float(np.arctan2(planned.direction[1], planned.direction[0]))
    return Action("push", 0, point, heading, normal, 0.0, 0.0, path, float(pace.max()))


def _trapezoid(planned: PlannedPush, step: float) -> np.ndarray:
    """Return the speeds of a way from rest to rest, lower at most where it is too short."""
    ramps = 1.0 / planned.acceleration + 1.0 / planned.braking
    top = min(planned.speed, float(np.sqrt(2.0 * planned.length / ramps)))
    duration = planned.length / top + 0.5 * top * ramps
    time = (np.arange(round(duration / step)) + 0.5) * step
    up, down = planned.acceleration * time, planned.braking * np.maximum(duration - time, 0.0)
    return np.minimum(np.minimum(up, down), top)


def _nearest_edge(corners: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of an outline that is nearest to a point, and the normal inwards there."""
    edge = np.roll(corners, -1, axis=0) - corners
    share = np.sum((point - corners) * edge, axis=1) / np.sum(edge * edge, axis=1)
    near = corners + np.clip(share, 0.0, 1.0)[:, None] * edge
    k = int(np.argmin(np.linalg.norm(near - point, axis=1)))
    return near[k], np.array([-edge[k, 1], edge[k, 0]]) / np.linalg.norm(edge[k])


def _point_at(corners: np.ndarray, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of an outline in a direction, off its corners, and the normal inwards."""
    ray = np.array([np.cos(angle), np.sin(angle)])
    edge = np.roll(corners, -1, axis=0) - corners
    cross = edge[:, 0] * ray[1] - edge[:, 1] * ray[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (ray[0] * corners[:, 1] - ray[1] * corners[:, 0]) / cross
        reach = (edge[:, 0] * corners[:, 1] - edge[:, 1] * corners[:, 0]) / cross
    hit = (share >= 0.0) & (share <= 1.0) & (reach > 0.0)
    k = int(np.argmax(np.where(hit, reach, -np.inf)))
    inset = min(0.3, 0.012 / float(np.linalg.norm(edge[k])))
    point = corners[k] + np.clip(share[k], inset, 1.0 - inset) * edge[k]
    return point, np.array([-edge[k, 1], edge[k, 0]]) / np.linalg.norm(edge[k])


def _pushing_path(
    speed: float, options: ActionOptions, rng: np.random.Generator, step: float
) -> np.ndarray:
    """Return a path that stops now and then, holds, and withdraws."""
    brake = 0.02 if options.hard_stop else _RAMP
    moving = min(options.travel / speed, options.duration)
    legs = options.pauses + 1
    pieces = [np.zeros(round(BEFORE / step))]
    for _ in range(legs):
        pieces += [_leg(speed, max(moving / legs, _RAMP + brake), brake, step)]
        pieces += [np.zeros(round(_HOLD / step))]
    forward = np.concatenate(pieces)
    turn = rng.uniform(-1.0, 1.0) * np.pi / 3.0 if options.curved else 0.0
    bearing = turn * np.cumsum(forward) / max(forward.sum(), 1e-12)
    back = -_leg(_RETREAT, AFTER, _RAMP, step)
    pace = np.concatenate([forward, back])
    bearing = np.concatenate([bearing, np.full(len(back), bearing[-1])])
    x, y = np.cumsum(pace * np.cos(bearing)) * step, np.cumsum(pace * np.sin(bearing)) * step
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def _leg(speed: float, duration: float, brake: float, step: float) -> np.ndarray:
    """Return the speeds of a motion from rest to rest, with smooth ramps."""
    time = np.arange(round(duration / step)) * step
    up, down = np.clip(time / _RAMP, 0.0, 1.0), np.clip((duration - time) / brake, 0.0, 1.0)
    share = np.minimum(up, down)
    return speed * share * share * (3.0 - 2.0 * share)


def _pull(
    thing: PushedObject,
    link: int,
    angle: float,
    options: ActionOptions,
    rng: np.random.Generator,
    step: float,
) -> Action:
    corners = thing.links[link].corners
    across = rng.uniform(-0.2, 0.2) if len(thing.links) == 2 else angle
    first, normal = _point_at(corners, across + np.pi)
    second, _ = _point_at(corners, float(np.arctan2(normal[1], normal[0])))
    middle, grip = 0.5 * (first + second), 0.5 * float(np.linalg.norm(second - first))
    axis = 0.5 * (second - first) / grip
    heading = float(np.arctan2(axis[1], axis[0]))
    speed = float(np.exp(rng.uniform(*np.log(options.speed))))
    shakes = options.kind == "shake"
    path = _pulling_path(speed, options, rng, step, shakes)
    return Action("pull", link, middle, heading, axis, grip, 0.0, path, speed)


def _pulling_path(
    speed: float, options: ActionOptions, rng: np.random.Generator, step: float, shakes: bool
) -> np.ndarray:
    """Return a path with a slow turn, and 10 mm at 2 Hz across it where the gripper shakes."""
    moving = min(options.travel / speed, options.duration)
    legs = options.pauses + 1
    pieces = [np.zeros(round(BEFORE / step))]
    for _ in range(legs):
        pieces += [_leg(speed, max(moving / legs, 2 * _RAMP), _RAMP, step)]
        pieces += [np.zeros(round(0.1 / step))]
    pace = np.concatenate([*pieces, np.zeros(round(0.1 / step))])
    bearing = rng.uniform(-np.pi, np.pi)
    along = np.cumsum(pace) * step
    yaw = rng.uniform(-0.5, 0.5) * along / max(along[-1], 1e-12)
    x, y = along * np.cos(bearing), along * np.sin(bearing)
    if shakes:
        time = np.arange(len(along)) * step
        envelope = np.clip(np.minimum(time, time[-1] - time) / 0.3, 0.0, 1.0)
        swing = 0.01 * envelope**2 * np.sin(4.0 * np.pi * time)
        x, y = x - swing * np.sin(bearing), y + swing * np.cos(bearing)
    return np.stack([x, y, yaw], axis=1)
