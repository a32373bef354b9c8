"""Probe recordings with a hidden effect, from a fingertip as a mass that is pulled over a surface.

Nothing here is shared with the effects of the catalogue: areas come from contact mechanics, the
anisotropy is an ellipse, the normal is turned by a rotation, the skin creeps with two time
constants. The slips are then found by the probe's own log.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.friction.estimate import SlipEvent
from tactile_dynamics_ros.core.friction.slip_log import Attempt, SlipLog
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3

EFFECTS = (
    "adhesion",
    "load_dependent_friction",
    "velocity_weakening",
    "anisotropic_friction",
    "normal_misalignment",
    "skin_creep",
)
STEP, PERIOD = 1e-3, 0.01
MASS, DAMPING, SPRING = 0.1, 18.0, 120.0
SLIDE, NOTICED = 0.22, 1.5e-4


@dataclass(frozen=True)
class Surface:
    """A surface and fingertip with at most one oddity.

    Attributes:
        static, kinetic: coefficients of the ordinary part.
        hidden: name of the oddity, or "none". strength: multiple of its typical size.
        grain: direction of the grain and of the turned normal, rad.
    """

    static: float
    kinetic: float
    hidden: str = "none"
    strength: float = 1.0
    grain: float = 0.0

    def bearable(self, press: float, speed: float, angle: float) -> float:
        """Largest tangential force for a normal force (N), speed (m/s) and direction (rad), N."""
        at_rest = math.exp(-((speed / 1.5e-3) ** 2))
        coefficient = self.kinetic + (self.static - self.kinetic) * at_rest
        if self.hidden == "velocity_weakening":
            coefficient *= 1.0 - 0.75 * self.strength * speed / (speed + 0.012)
        load = press
        if self.hidden == "adhesion":
            pull = 0.06 * self.strength
            load = press + pull + math.sqrt(2.0 * pull * press + pull**2)
        elif self.hidden == "load_dependent_friction":
            share = min(1.0, 0.9 * self.strength)
            load = (1.0 - share) * press + share * math.cbrt(press) ** 2
        elif self.hidden == "anisotropic_friction":
            ratio = math.sqrt(1.0 + 0.3 * self.strength)
            turned = angle - self.grain
            load = press / math.hypot(math.cos(turned) / ratio, math.sin(turned) * ratio)
        return coefficient * load


@dataclass(frozen=True)
class Session:
    """How a probe that serves a diagnosis is carried out, and how well it measures.

    Attributes:
        slips: number. loads: normal forces at which slips are wanted, N.
        force_noise: N at 100 Hz. scatter: relative, of single slips.
        tilt_deg: std of the sensor's own error of direction. gain: std of the tangential gain.
    """

    slips: int = 96
    loads: tuple[float, ...] = (0.35, 0.7, 1.1, 1.6)
    force_noise: float = 0.02
    scatter: float = 0.02
    tilt_deg: float = 2.0
    gain: float = 0.03
    directions: int = 8
    pushes: tuple[float, ...] = field(default=(0.0, 0.15, 0.4))


def draw_surface(hidden: str, seed: int, strength: float = 1.0) -> Surface:
    """Draw coefficients and direction of a surface."""
    rng = np.random.default_rng([seed, 21])
    static = float(rng.uniform(0.45, 1.0))
    kinetic = static * float(rng.uniform(0.75, 0.95))
    return Surface(static, kinetic, hidden, strength, float(rng.uniform(0.0, 2.0 * np.pi)))


def generate_events(surface: Surface, seed: int, session: Session | None = None) -> list[SlipEvent]:
    """Return the slips that the probe's log finds in a simulated session."""
    session = session or Session()
    rng = np.random.default_rng([seed, 22])
    plan = _plan(surface, session, rng)
    traces = [_pull(surface, *row, rng) for row in plan]
    measured, starts = _measure(surface, traces, session, rng)
    memory = lfilter([PERIOD / 2.0], [1.0, PERIOD / 2.0 - 1.0], measured, axis=0)
    found = []
    for trace, start, row in zip(traces, starts, plan, strict=True):
        event = _log(trace, start, measured, memory, float(row[1]), rng)
        if event is not None:
            found.append(event)
    return found


def _plan(
    surface: Surface, session: Session, rng: np.random.Generator
) -> list[tuple[float, float, float, float]]:
    """Pull (N), direction (rad), push while sliding (N) and rest before (s) of every slip."""
    count = session.slips
    loads = rng.permutation(np.resize(session.loads, count))
    angles = rng.permutation(np.resize(np.arange(session.directions), count))
    angles = 2.0 * np.pi * angles / session.directions
    pushes = rng.permutation(np.resize(session.pushes, count))
    rests = rng.uniform(0.1, 2.5, count)
    pulls = 0.9 * surface.static * loads
    return [tuple(map(float, row)) for row in zip(pulls, angles, pushes, rests, strict=True)]


@dataclass(frozen=True)
class _Trace:
    """One pull at 100 Hz: normal and tangential force (T,), path (T,), ramp start, noticed, s."""

    press: Array
    pull: Array
    path: Array
    angle: float
    ramp: float
    noticed: float


def _pull(
    surface: Surface,
    pull: float,
    angle: float,
    push: float,
    rest: float,
    rng: np.random.Generator,
) -> _Trace:
    """Press, load, unload until the fingertip slides, and let it slide."""
    most = pull / surface.static * 1.8 + 0.4
    factor = 1.0 + 0.015 * float(rng.standard_normal())
    press, drive, place, speed, noticed = 0.2, 0.0, 0.0, 0.0, np.inf
    rows, time, ramp = [], 0.0, 0.4 + rest + pull / 1.5
    measured = 0.0
    while time < min(ramp + 12.0, noticed + SLIDE):
        if time < 0.4:
            press = 0.2 + (most - 0.2) * time / 0.4
        elif time > ramp and not math.isfinite(noticed):
            press = max(press - 0.5 * STEP, 0.08)
        drive = min(max((time - 0.4 - rest) * 1.5, 0.0), pull)
        drive += push if math.isfinite(noticed) else 0.0
        net = drive - SPRING * place - DAMPING * speed
        limit = factor * surface.bearable(press, speed, angle)
        if speed <= 1e-7 and net <= limit:
            speed, measured = 0.0, net
        else:
            speed = max(speed + STEP * (net - limit) / MASS, 0.0)
            measured = limit
        place += STEP * speed
        if place > NOTICED and not math.isfinite(noticed):
            noticed = time + 0.03
        time += STEP
        rows.append((press, measured, place))
    table = np.array(rows)[:: round(PERIOD / STEP)]
    return _Trace(table[:, 0], table[:, 1], table[:, 2], angle, ramp, noticed)


def _measure(
    surface: Surface, traces: list[_Trace], session: Session, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Forces (T, 3) of all traces in a row as the sensor tells them, and where each starts."""
    parts = [
        np.column_stack([t.press, t.pull * np.cos(t.angle), t.pull * np.sin(t.angle)])
        for t in traces
    ]
    starts = np.cumsum([0, *[len(part) for part in parts]])[:-1]
    true = np.concatenate(parts)
    gain = 1.0 + session.gain * rng.standard_normal()
    tilt = np.deg2rad(session.tilt_deg) * rng.standard_normal(2)
    if surface.hidden == "normal_misalignment":
        size = np.deg2rad(14.0) * surface.strength
        tilt = tilt + size * np.array([np.cos(surface.grain), np.sin(surface.grain)])
    turned = true @ exp_so3(np.array([0.0, -tilt[1], tilt[0]])).T
    turned = turned * np.array([1.0, gain, gain])
    if surface.hidden == "skin_creep":
        share = 0.22 * surface.strength
        turned = turned + share * (0.5 * _lag(turned, 0.4) + 0.5 * _lag(turned, 5.0))
    noise = session.force_noise * rng.standard_normal(turned.shape)
    spread = np.repeat(
        1.0 + session.scatter * rng.standard_normal(len(parts)), [len(p) for p in parts]
    )
    turned[:, 1:] *= spread[:, None]
    return turned + noise, starts


def _lag(values: Array, time: float) -> Array:
    share = 1.0 - np.exp(-PERIOD / time)
    return np.asarray(lfilter([share], [1.0, share - 1.0], values, axis=0))


def _log(
    trace: _Trace,
    start: int,
    measured: Array,
    memory: Array,
    angle: float,
    rng: np.random.Generator,
) -> SlipEvent | None:
    """What the probe's log makes of one pull."""
    if not np.isfinite(trace.noticed):
        return None
    count = len(trace.press)
    offset = PERIOD * start
    log = SlipLog()
    heading = np.array([0.0, np.cos(angle), np.sin(angle)])
    path = trace.path + 3e-5 * rng.standard_normal(count)
    for k in range(count):
        log.add(offset + PERIOD * k, measured[start + k], path[k] * heading)
    slip = start + min(int(trace.noticed / PERIOD), count - 1)
    attempt = Attempt(
        angle=angle,
        region="body",
        variant="unload",
        began=offset + trace.ramp,
        detected=offset + trace.noticed,
        basis=np.eye(3),
        memory=memory[slip],
    )
    return log.event(attempt)
