"""Noise nets on objects that are hidden and that tips lose: do stated errors follow the true?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from benchmarks.planar.trial import INSIDE, SETTINGS, Population, described, follow
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.filter.dual import DualConfig, DualFilter
from tactile_dynamics_ros.core.planar.filter.observation import Observation, SeenPose
from tactile_dynamics_ros.core.planar.filter.patch import PatchProcess
from tactile_dynamics_ros.core.planar.filter.process import PusherMotion
from tactile_dynamics_ros.core.planar.network.noise import NoiseWeights, TouchNoise, shipped_noise
from tactile_dynamics_ros.core.planar.network.noise_features import (
    joined_looks,
    joined_touches,
    lasting,
)
from tactile_dynamics_ros.sim.planar.looking import Told, looked_at, told_of
from tactile_dynamics_ros.synthetic import pushed
from tactile_dynamics_ros.synthetic.pushed.scene import STEP
from tactile_dynamics_ros.synthetic.pushed.sensed import (
    POSE_STD,
    ForceErrors,
    SensedStep,
    force_errors,
    sensed_steps,
)
from tactile_dynamics_ros.synthetic.pushed.transitions import states_at

PERIOD = SETTINGS["slow"][0]
ACTIONS = pushed.ActionOptions(
    count=4, speed=(0.015, 0.06), duration=2.0, travel=0.1, pauses=1, tilt_deg=10
)
GAP = 0.01
"""m that the tip flies to every second object."""
CONSTANT = np.array([1e-3, 1e-3, np.radians(0.5)])
"""Standard deviation of every pose in the row that has none of its own, m and rad: rounded from
what four other recordings had."""
HIDDEN = 0.6
"""Visible share of the near side below which an object counts as hidden."""
LOST = 0.2
"""Change of the pusher's velocity over its speed above which a touch counts as unsteady; so does
one in its first step, or that lasts for a part of the step."""
MOST = 50.0
"""Squared error over its variance up to which the likelihood counts it: poses of other turns."""


@dataclass(frozen=True, eq=False)
class Case:
    """One recording: scene and motion, what was told of its images, true poses there, forces."""

    one: Any
    told: Told
    truth: Array
    measured: ForceErrors


def case_of(seed: int) -> Case:
    """Simulate an object that is pushed while something passes before the camera."""
    actions = replace(ACTIONS, gap=GAP * (seed % 2))
    options = pushed.PushOptions(actions=actions, variation=0.08, stiction=0.1, uneven=0.1)
    (one,) = pushed.generate([seed], None, options)
    truth = states_at(one.scene, one.motion)[3 :: round(PERIOD / STEP), :3]
    link, times = one.scene.thing.links[0], PERIOD * np.arange(len(truth))
    told = told_of(looked_at(link.corners, link.height, times, truth, seed), truth[:, 2])
    return Case(one, told, truth[told.rows], force_errors(one, PERIOD, seed))


def looks(all_: list[Case]) -> dict[str, dict[str, float]]:
    """What is stated of poses, by constant, tracker and nets, against their errors."""
    noise = shipped_noise()
    looked = joined_looks([case.told.looked for case in all_])
    crops = np.concatenate([case.told.crops for case in all_])
    error = np.concatenate([case.told.poses - case.truth for case in all_])
    known = looked.known.all(axis=1)
    nets = {
        "tracker and net from shares": noise.look_factor(looked),
        "tracker and net from crops": noise.crop_factor(looked, crops),
    }
    stated = {"constant": np.broadcast_to(CONSTANT, error.shape), "tracker": looked.std}
    stated |= {name: looked.std * factor[:, [0, 0, 1]] for name, factor in nets.items()}
    hidden = looked.visible < HIDDEN
    found = {}
    for name, std in stated.items():
        found[name] = judged(error[known] / CONSTANT, std[known] / CONSTANT, hidden[known])
        white = np.where(known[:, None], error / std, np.nan)
        parts = np.split(white, np.cumsum([len(case.truth) for case in all_])[:-1])
        together = np.concatenate([lasting(part) for part in parts])
        found[name]["nees_8"] = float(np.nanmean(together**2))
    return found


def judged(error: Array, std: Array, bad: NDArray[np.bool_]) -> dict[str, float]:
    """How well stated standard deviations (N, d) follow errors (N, d).

    Args:
        error: over its usual size; two of place or force first.
        std: the same.
        bad: (N,) where errors should be larger.
    """
    white = error / std
    size, wide = np.linalg.norm(error[:, :2], axis=1), np.linalg.norm(std[:, :2], axis=1)
    return {
        "rank": float(spearmanr(wide, size).statistic) if np.ptp(wide) > 1e-12 else 0.0,
        "inside": float(np.mean(np.abs(white) < INSIDE)),
        "inside_bad": float(np.mean(np.abs(white[bad]) < INSIDE)),
        "nees": float(np.mean(white**2)),
        "nees_bad": float(np.mean(white[bad] ** 2)),
        "ln": float(np.mean(-0.5 * np.minimum(white**2, MOST) - np.log(std))),
        "error": float(np.sqrt(np.mean(size**2))),
        "error_bad": float(np.sqrt(np.mean(size[bad] ** 2))),
        "std": float(np.sqrt(np.mean(wide[~bad] ** 2))),
        "std_bad": float(np.sqrt(np.mean(wide[bad] ** 2))),
        "n": len(error),
        "bad": int(bad.sum()),
    }


def touches(all_: list[Case]) -> dict[str, dict[str, float]]:
    """What is expected of forces by a filter that knows the object, without and with the net."""
    noise = shipped_noise()
    measured = [case.measured for case in all_]
    touched = joined_touches([each for one in measured for each in one.touched])
    error = np.concatenate([one.errors for one in measured])
    size, axes = np.linalg.eigh(np.concatenate([one.granted for one in measured]))
    along = np.einsum("nij,ni->nj", axes, error)
    changed = np.linalg.norm(touched.velocity - touched.before, axis=1)
    slow = np.linalg.norm(touched.velocity, axis=1) + 1e-3
    lost = (touched.since == 0.0) | (touched.share < 0.99) | (changed > LOST * slow)
    found = {}
    for name, own in (
        ("stated", touched.stated),
        ("noise net", touched.stated * noise.touch_factor(touched)),
    ):
        std = np.sqrt(np.maximum(size, 0.0) + own[:, None] ** 2)
        found[name] = judged(along, std, lost)
        found[name]["rank"] = float(spearmanr(own, np.linalg.norm(error, axis=1)).statistic)
        found[name] |= {"std": _rms(own[~lost]), "std_bad": _rms(own[lost])}
    return found


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@dataclass(frozen=True)
class Way:
    """How a filter takes what is seen and measured: which std poses have, and forces.

    Attributes:
        poses: of a case, (N, 3).
        force: whether a net says how good forces are.
        rules: whether forces of unsteady touches are left out.
    """

    poses: Callable[[Case, NoiseWeights], Array]
    force: bool = False
    rules: bool = True


def _constant(case: Case, _: NoiseWeights) -> Array:
    looked = case.told.looked
    return np.where(looked.known[:, [0, 0, 1]], CONSTANT, looked.std)


def _tracker(case: Case, _: NoiseWeights) -> Array:
    return case.told.looked.std


def _shares(case: Case, noise: NoiseWeights) -> Array:
    return noise.look_std(case.told.looked)


def _crops(case: Case, noise: NoiseWeights) -> Array:
    factor = noise.crop_factor(case.told.looked, case.told.crops)
    return case.told.looked.std * factor[:, [0, 0, 1]]


WAYS = {
    "no noise nets": Way(_tracker),
    "net for touch": Way(_tracker, force=True),
    "net for vision": Way(_shares),
    "nets for both": Way(_shares, force=True),
    "no nets, no rules": Way(_tracker, rules=False),
    "nets for both, no rules": Way(_shares, force=True, rules=False),
    "net for vision, from crops": Way(_crops),
    "constant std of poses": Way(_constant),
}
"""By their names in the table."""


class Ungated(DualFilter):
    """Takes forces of starts and stops as they come."""

    def _steady(self, motion: PusherMotion | None, coarse: bool) -> bool:
        return True


def run(case: Case, way: Way) -> dict[str, Any]:
    """What a filter on the mechanics makes of one recording."""
    scene, noise = case.one.scene, shipped_noise()
    corrected = TouchNoise(noise)
    link, std = scene.thing.links[0], way.poses(case, noise)
    image = {int(row): k for k, row in enumerate(case.told.rows)}
    steps = sensed_steps(case.one, PERIOD, scene.seed)
    process = PatchProcess(link.corners, 0.5 * link.height)
    start = steps[0].seen.poses[0].value

    def seen_at(number: int) -> tuple[SeenPose, ...]:
        k = image.get(number + 1)
        return () if k is None else (SeenPose(case.told.poses[k], std[k]),)

    steps = [replace(s, seen=replace(s.seen, poses=seen_at(k))) for k, s in enumerate(steps)]

    def sense(belief: DualFilter, step: SensedStep) -> Observation:
        if step.motion is None:
            corrected.end()
            return step.seen
        measured = step.seen.wrench
        if way.force:
            measured = corrected.measured(step.motion, measured, step.share, belief.state[0])
        return replace(step.seen, wrench=measured if step.steady or not way.rules else None)

    prior = Population.of("single").prior(process)
    make = DualFilter if way.rules else Ungated
    belief = make(process, start, POSE_STD, DualConfig(seed=scene.seed), prior)
    after = follow(belief, steps, "patch", sense)
    visible = {int(r): v for r, v in zip(case.told.rows, case.told.looked.visible, strict=True)}
    hidden = np.array([visible.get(each.number + 1, 0.0) < HIDDEN for each in after])
    error = np.array([each.error for each in after])
    return described(*belief.parameters, process, scene) | {
        "nees": float(np.mean([each.nees for each in after])),
        "place_mm": 1e3 * _rms(np.linalg.norm(error[:, :2], axis=1)),
        "hidden_mm": 1e3 * _rms(np.linalg.norm(error[hidden, :2], axis=1)),
        "yaw_deg": float(np.degrees(_rms(error[:, 2]))),
        "step_ms": 1e3 * float(np.mean([each.seconds for each in after])),
        "step_ms_p99": 1e3 * float(np.quantile([each.seconds for each in after], 0.99)),
    }


def table(found: dict[str, Any]) -> str:
    """Rows of what is stated of poses and of forces, for people."""
    rows = [f"## what is stated of poses and forces, n = {found['n']} recordings", ""]
    keys = ("rank", "inside", "inside_bad", "nees", "nees_bad", "ln", "n", "bad")
    keys += ("error", "error_bad", "std", "std_bad", "nees_8")
    for what in ("poses", "forces"):
        rows += [f"| {what} | {' | '.join(keys)} |", "|---" * (len(keys) + 1) + "|"]
        for name, one in found[what].items():
            cells = [f"{one[key]:.4g}" if key in one else "" for key in keys]
            rows.append(f"| {name} | {' | '.join(cells)} |")
        rows.append("")
    return "\n".join(rows)


POSES = ("place_mm", "hidden_mm", "yaw_deg")
"""What `run` tells of poses."""
