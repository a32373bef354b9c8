"""One simulated object of the test set: pushed as in paper B, sensed, and filtered."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import Observation
from tactile_dynamics_ros.core.planar.filter.process import Process, PusherMotion
from tactile_dynamics_ros.core.planar.filter.revised import filter_of
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.objects import GRAVITY, PushedObject, draw_object
from tactile_dynamics_ros.synthetic.pushed.sensed import (
    POSE_STD,
    SensedStep,
    giving_way,
    sensed_steps,
)
from tactile_dynamics_ros.synthetic.pushed.sensors import SensorOptions
from tactile_dynamics_ros.synthetic.pushed.transitions import true_parameters

SLOW = pushed.ActionOptions(
    count=4, speed=(0.024, 0.025), duration=5.0, travel=0.125, pauses=0, hard_stop=False, tilt_deg=5
)
FAST = pushed.ActionOptions(count=4, speed=(0.03, 0.2), tilt_deg=5)
SETTINGS = {"slow": (1.0 / 15.0, SLOW), "fast": (0.01, FAST)}
"""Paper B: 15 Hz, 25 mm/s, 5 s per push, normal ±5 deg; and 100 Hz, 30 to 200 mm/s, hard stops."""
STANDS = 1.5e-3
"""m/s below which an object that nothing touches has stopped, as `PushTracker` has it."""
INSIDE = 1.645
"""Standard deviations within which 90 % of normal errors lie."""
DRAWS = 4000
"""Objects that stand for what is known beforehand."""


def simulated(
    seeds: Sequence[int],
    kind: str,
    setting: str,
    action: str = "push",
    things: Mapping[int, PushedObject] | None = None,
) -> list[Any]:
    """Recordings of the test set: tables vary by 8 %, faces are uneven by 10 %, stiction 10 %."""
    rate = 1.0 / SETTINGS[setting][0]
    actions = replace(SETTINGS[setting][1], kind=action)
    options = pushed.PushOptions(
        kind=kind, actions=actions, variation=0.08, stiction=0.1, uneven=0.1,
        sensors=SensorOptions(rate_hz=rate, force_rate_hz=rate), things=things or {},
    )  # fmt: skip
    return pushed.generate(seeds, None, options)


def parameters_of(thing: PushedObject) -> Array:
    """Parameters (4 L,) of links: ln product, ln mass, centre."""
    rows = [
        [np.log(link.mass * link.friction), np.log(link.mass), *link.com] for link in thing.links
    ]
    return np.ravel(rows)


@dataclass(frozen=True, eq=False)
class Population:
    """What is known of a family before any push.

    Attributes:
        values: (DRAWS, 4 L) parameters. offsets: (DRAWS, L) distance of the centre of mass from the
            geometric one, m. joints: (DRAWS,) ln of joint friction.
    """

    values: Array
    offsets: Array
    joints: Array

    @classmethod
    def of(cls, kind: str) -> Population:
        """Draw it, from seeds that nothing else uses."""
        things = [draw_object(seed, kind) for seed in range(900_000, 900_000 + DRAWS)]
        middle = [[link.feet.mean(axis=0) for link in t.links] for t in things]
        com = [[link.com for link in t.links] for t in things]
        joints = np.log([max(t.joint_friction, 1e-3) for t in things])
        offsets = np.linalg.norm(np.array(com) - np.array(middle), axis=2)
        return cls(np.array([parameters_of(t) for t in things]), offsets, joints)

    def prior(self, process: Process) -> tuple[Array, Array]:
        """Mean and covariance of the parameters of a process; the tip's friction is its own."""
        mean, covariance = (np.array(part) for part in process.prior)
        size = self.values.shape[1]
        mean[:size], covariance[:size, :size] = self.values.mean(axis=0), np.cov(self.values.T)
        if len(mean) > size + 1:
            mean[-1], covariance[-1, -1] = self.joints.mean(), self.joints.var()
        return mean, covariance

    def means(self) -> dict[str, float]:
        """The best guess without data of each quantity of each link."""
        return {name: float(np.mean(v)) for name, v in self.quantities().items()}

    def quantities(self) -> dict[str, Array]:
        """Of all draws: m, f, q and the centre's distance, of each link."""
        found = {}
        for k in range(self.offsets.shape[1]):
            q, m = np.exp(self.values[:, 4 * k : 4 * k + 2].T)
            found |= {f"m{k + 1}": m, f"f{k + 1}": q / m, f"q{k + 1}": q * GRAVITY}
            found[f"com{k + 1}"] = self.offsets[:, k]
        return found

    def given_product(self, product: Array) -> dict[str, float]:
        """Best guess of mass and friction where the products (L,), N, are known exactly."""
        all_ = self.quantities()
        found = {}
        for k, value in enumerate(product):
            near = np.argsort(np.abs(np.log(all_[f"q{k + 1}"] / value)))[:150]
            found[f"m{k + 1}"] = float(all_[f"m{k + 1}"][near].mean())
            found[f"f{k + 1}"] = float(all_[f"f{k + 1}"][near].mean())
            found[f"q{k + 1}"] = float(value)
        return found


def truth_of(scene: Any) -> dict[str, float]:
    """Quantities of the object of a scene."""
    found = {}
    for k, link in enumerate(scene.thing.links):
        found |= {f"m{k + 1}": link.mass, f"f{k + 1}": link.friction}
        found[f"q{k + 1}"] = link.mass * link.friction * GRAVITY
        found[f"com{k + 1}"] = float(np.linalg.norm(link.com - link.feet.mean(axis=0)))
    return found


def filtered(
    process: Process,
    prior: tuple[Array, Array],
    one: Any,
    setting: str,
    model: str,
    seed: int,
    make: Callable[..., DualFilter] = filter_of,
    config: DualConfig | None = None,
    sense: Callable[[DualFilter, SensedStep], Observation] = lambda _, step: step.usual,
) -> dict[str, Any]:
    """What a filter with a model makes of all pushes of an object, and what it cost.

    Args:
        process: the model.
        prior: mean and covariance of its parameters before any push.
        one: recording.
        setting: one of SETTINGS.
        model: its name.
        seed: of the noise and of the hypotheses.
        make: the filter.
        config: of the filter, but for the seed.
        sense: what the filter is shown of a step.
    """
    steps = sensed_steps(one, SETTINGS[setting][0], seed)
    belief = begun(process, prior, steps, replace(config or DualConfig(), seed=seed), make)
    after = follow(belief, steps, model, sense)
    found = described(*belief.parameters, process, one.scene)
    times = 1e3 * np.array([each.seconds for each in after])
    return found | {"nees": float(np.mean([each.nees for each in after])),
                    "step_ms": float(np.mean(times)),
                    "step_ms_p99": float(np.quantile(times, 0.99))}  # fmt: skip


def begun(
    process: Process,
    prior: tuple[Array, Array],
    steps: Sequence[SensedStep],
    config: DualConfig,
    make: Callable[..., DualFilter] = filter_of,
) -> DualFilter:
    """Return a filter that begins where parts are first seen."""
    start = np.concatenate([pose.value for pose in steps[0].seen.poses])
    return make(process, start, POSE_STD, config, prior)


@dataclass(frozen=True, eq=False)
class After:
    """What is believed after a touched step.

    Attributes:
        number: of the step.
        nees: squared error of the poses over their covariance and freedom.
        error: (3 L,) of the poses, m and rad. seconds: of processor time.
    """

    number: int
    nees: float
    error: Array
    seconds: float


def follow(
    belief: DualFilter,
    steps: Sequence[SensedStep],
    model: str,
    sense: Callable[[DualFilter, SensedStep], Observation] = lambda _, step: step.usual,
    watch: Callable[[SensedStep], None] = lambda _: None,
) -> list[After]:
    """Let a filter take all steps.

    Args:
        belief: the filter.
        steps: of a recording.
        model: its name.
        sense: what the filter is shown of a step.
        watch: is called after each step.
    """
    found = []
    for k, step in enumerate(steps):
        began = time.process_time()
        if step.motion is not None and model == "patch":
            step = giving_way(steps[max(k - 1, 0) : k + 2], step)
        motion = step.motion
        if motion is None and belief.process.links == 1 and _moves(belief):
            period = steps[0].period
            motion = PusherMotion(np.zeros(3), np.zeros(3), period, touching=False)
        belief.step(motion, sense(belief, step))
        if step.motion is not None:
            error = (belief.state[0] - step.truth).reshape(-1, 6)[:, :3].ravel()
            spent = time.process_time() - began
            found.append(After(k, _nees(belief, step.truth), error, spent))
        watch(step)
    return found


def _moves(belief: DualFilter) -> bool:
    rates = belief.state[0][3:6] * [1.0, 1.0, 0.03]
    return bool(np.abs(rates).max() > STANDS)


def _nees(belief: DualFilter, truth: Array) -> float:
    """Squared error of the poses of all links in units of its covariance, over its freedom."""
    mean, covariance = belief.state
    rows = [6 * k + axis for k in range(len(truth) // 6) for axis in range(3)]
    off = (mean - truth)[rows]
    return float(off @ np.linalg.solve(covariance[np.ix_(rows, rows)], off)) / len(rows)


def described(mean: Array, covariance: Array, process: Process, scene: Any) -> dict[str, Any]:
    """Estimates of each quantity, and by how many std each number is off."""
    truth, std = true_parameters(scene), np.sqrt(np.diag(covariance))
    values: dict[str, float] = {}
    z: dict[str, list[float]] = {}
    for k, link in enumerate(scene.thing.links):
        a = 4 * k
        ratio = np.sqrt(max(covariance[a, a] + covariance[a + 1, a + 1]
                            - 2 * covariance[a, a + 1], 1e-12))  # fmt: skip
        q, m = np.exp(mean[a : a + 2])
        values |= {f"m{k + 1}": m, f"f{k + 1}": q / m, f"q{k + 1}": q * GRAVITY}
        own, middle = slice(a + 2, a + 4), link.feet.mean(axis=0)
        values[f"com{k + 1}"] = _distance(mean[own] - middle, covariance[own, own])
        off = (mean - truth)[a : a + 4]
        z |= {f"q{k + 1}": [off[0] / std[a]], f"m{k + 1}": [off[1] / std[a + 1]]}
        z |= {f"f{k + 1}": [(off[0] - off[1]) / ratio]}
        z |= {f"com{k + 1}": list(off[2:4] / std[a + 2 : a + 4])}
    return {"values": {n: float(v) for n, v in values.items()},
            "z": {n: [float(each) for each in v] for n, v in z.items()}}  # fmt: skip


def _distance(mean: Array, covariance: Array) -> float:
    """Expected length, m, of a vector (2,): that of its mean is too short where it is unknown."""
    unit = np.random.default_rng(0).standard_normal((DRAWS, 2))
    away = mean + unit @ np.linalg.cholesky(covariance).T
    return float(np.mean(np.linalg.norm(away, axis=1)))
