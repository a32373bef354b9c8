"""How much of zero, gravity and inertia is left in compensated contact wrenches.

The load is estimated from the first half of a recording and taken out of the second half, whose
motion is another. Then pushes of a hand, taps of a hammer and more load are added to the second
half: what the compensator says is held against what was added.
"""

from __future__ import annotations

import argparse
import json
import sys
import time as clock
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

import tactile_dynamics_ros as td
from benchmarks.support.tables import WristOptions, wrist_table
from tactile_dynamics_ros.core.inertia.compensation import (
    Compensated,
    Compensator,
    ContactWrenches,
    Load,
)
from tactile_dynamics_ros.core.inertia.compensation.causal_motion import ImuMotion
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import KnownBody
from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.core.streams.streams import PoseStream, Streams, places_at
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.importers.kuka_ft_imu import KukaFtImuImporter
from tactile_dynamics_ros.synthetic import ScenarioOptions, SensorOptions
from tactile_dynamics_ros.synthetic.recordings import generate

FIRST_SEED = 64000
"""Seeds from here on were not used for tuning."""
KINDS = ("wrist:100", "wrist:250", "wrist:1000", "fingers:100", "fingers:1000")
"""Sensors and the rate of their forces, Hz; poses of fingers come at 100 Hz."""
LEARNT, SCORED = 15.0, 15.0
"""Spans from which the load is estimated and on which it is scored, s."""
SETTLED = 0.5
"""Start of the second half that is not scored, s: the filter of the motion begins there."""
PUSH_N, TAP_N, TAP_S, HEAVIER = 5.0, 20.0, 0.015, 0.2
"""Largest force of a hand that pushes for 1.5 s, and of a hammer's tap, N; how long that is, s; how
much the load grows."""


@dataclass(frozen=True)
class Row:
    """What was measured in one recording.

    Attributes:
        kind: of sensors. rate_hz: of them. seed: of the recording.
        force_removed, torque_removed: share of the wrench of gravity and inertia, RMS.
        force_left_n: RMS of what is left. beyond: share of it beyond two standard deviations.
        push_n, tap_n: RMS of the error of the force while a hand pushes or a hammer taps.
        noticed_s: time until more load is noticed; inf if it never is.
        false: share of the time in which a change of the load is seen where there is none.
        cost_us: CPU time of a pose and a reading.
    """

    kind: str
    rate_hz: float
    seed: int
    force_removed: float
    torque_removed: float
    force_left_n: float
    beyond: float
    push_n: float
    tap_n: float
    noticed_s: float
    false: float
    cost_us: float


def readings(streams: Streams) -> ContactWrenches:
    """What all sensors read at the stamps of the first."""
    contacts = list(streams.contacts.values())
    time = contacts[0].time
    count = len(contacts)
    point, rotation = np.zeros((len(time), count, 3)), np.tile(np.eye(3), (len(time), count, 1, 1))
    force, torque = np.zeros((len(time), count, 3)), np.zeros((len(time), count, 3))
    touches = np.zeros((len(time), count), dtype=bool)
    variance = np.zeros((len(time), 3))
    for k, contact in enumerate(contacts):
        at = np.searchsorted(contact.time, time + 1e-9) - 1
        near = (at >= 0) & (time - contact.time[at] < 0.1)
        places = places_at(contact.pose_time, contact.position, contact.rotation, contact.time)
        point[:, k], rotation[:, k] = (part[at] for part in places)
        force[:, k], torque[:, k] = (near[:, None] * v[at] for v in (contact.force, contact.torque))
        touches[:, k] = near & np.any(contact.force[at] != 0.0, axis=1)
        variance += contact.force_std[at] ** 2
    names = tuple(streams.contacts)
    return ContactWrenches(time, names, point, rotation, force, torque, touches, np.sqrt(variance))


def replay(
    poses: PoseStream,
    seen: ContactWrenches,
    compensator: Compensator,
    feel: Callable[[int], None] = lambda _: None,
) -> tuple[list[Compensated], np.ndarray]:
    """Compensate reading by reading, as it would be live; with the load's change at each."""
    found, changes, k = [], [], 0
    for index, time in enumerate(seen.time):
        while k < len(poses.time) and poses.time[k] <= time:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = poses.rotation[k], poses.position[k]
            compensator.motion.add(float(poses.time[k]), pose)
            feel(k)
            k += 1
        at = slice(index, index + 1)
        one = ContactWrenches(seen.time[at], seen.names, *(part[at] for part in seen[2:]))
        if k == 0:
            continue
        found.append(compensator.compensate(one))
        changes.append(compensator.load_change)
    return found, np.array(changes)


def _stack(found: Sequence[Compensated]) -> Compensated:
    return Compensated(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _with_wrench(seen: ContactWrenches, force: np.ndarray, at: np.ndarray) -> ContactWrenches:
    """Readings while the world applies a force (N, 3) at a point (N, 3) as well, world axes.

    The sensors bear it: an equal share each, with the moment on the one that measures torque.
    """
    share = force[:, None] / len(seen.names)
    if len(seen.names) > 1:
        return seen._replace(force=seen.force - share)
    moment = np.cross(at - seen.point[:, 0], force)
    return seen._replace(force=seen.force - share, torque=seen.torque - moment[:, None])


def measure(kind: str, rate: float, seed: int, streams: Streams) -> Row:
    """Learn from the first half, score on the second."""
    poses = streams.pose
    assert poses is not None
    middle = float(poses.time[0]) + LEARNT
    known = td.estimate(Recording(cut_streams(streams, -np.inf, middle), kind)).known()
    load = Load.of_body(known, tuple(streams.contacts))
    later = cut_streams(streams, middle, np.inf)
    assert later.pose is not None
    later_poses, seen = later.pose, readings(later)

    def compensated(changed: ContactWrenches) -> tuple[Compensated, np.ndarray]:
        compensator = Compensator()
        compensator.load = load
        found, changes = replay(later_poses, changed, compensator)
        return _stack(found), changes

    began = clock.process_time()
    plain, clean_changes = compensated(seen)
    cost = (clock.process_time() - began) / len(seen.time)
    scored = plain.time > plain.time[0] + SETTLED
    since = seen.time - seen.time[0]
    away = np.array([0.8, -0.5, 0.33]) / np.linalg.norm([0.8, -0.5, 0.33])
    push = PUSH_N * np.sin(np.pi * np.clip((since - 4.0) / 1.5, 0.0, 1.0))[:, None] * away
    tap = TAP_N * ((since % 2.0 > 1.0) & (since % 2.0 < 1.0 + TAP_S))[:, None] * away
    place = seen.point[:, 0] + 0.1
    errors = []
    for added in (push, tap):
        found, changes = compensated(_with_wrench(seen, added, place))
        truth = (np.swapaxes(found.rotation, 1, 2) @ added[-len(found.time) :, :, None])[..., 0]
        during = scored & (np.abs(added[-len(found.time) :]).sum(axis=1) > 0.0)
        off = found.wrench[:, 3:] - truth
        errors.append(float(np.sqrt(np.mean(np.sum(off[during] ** 2, axis=1)))))
    begins = 6.0
    specific_force = np.array([0.0, 0.0, -9.81]) - _acceleration(seen.time, seen.point[:, 0])
    more = (HEAVIER * known.phi[0] * (since > begins))[:, None] * specific_force
    _, changes = compensated(_with_wrench(seen, more, seen.point[:, 0]))
    noticed = (changes != 0.0) & (since[-len(changes) :] > begins)
    return Row(
        kind,
        rate,
        seed,
        **_left(plain, scored, _carried(plain, seen, load)),
        push_n=errors[0],
        tap_n=errors[1],
        noticed_s=float(since[-len(changes) :][noticed][0] - begins) if noticed.any() else np.inf,
        false=float(np.mean(clean_changes[scored] != 0.0)),
        cost_us=1e6 * cost,
    )


def _left(plain: Compensated, scored: np.ndarray, whole: np.ndarray) -> dict[str, float]:
    """Fields of a row: what is left of the wrench (N, 6) of gravity and inertia where scored."""
    left, of_load = (
        [float(np.sqrt(np.mean(np.sum(part[scored] ** 2, axis=1)))) for part in _parts(wrench)]
        for wrench in (plain.wrench, whole)
    )
    beyond = np.abs(plain.wrench[scored]) > 2.0 * plain.std[scored]
    return {
        "force_removed": 1.0 - left[1] / of_load[1],
        "torque_removed": 1.0 - left[0] / of_load[0],
        "force_left_n": left[1],
        "beyond": float(np.mean(beyond)),
    }


def _acceleration(time: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Acceleration (N, 3) of places (N, 3), from a fifth of a second before and after."""
    step = float(np.median(np.diff(time)))
    window = 2 * round(0.2 / step) + 1
    return np.asarray(savgol_filter(place, window, 4, deriv=2, delta=step, axis=0))


def _parts(wrench: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return wrench[:, :3], wrench[:, 3:]


def _carried(plain: Compensated, seen: ContactWrenches, load: Load) -> np.ndarray:
    """Wrench (N, 6) of gravity and inertia alone, where the compensated one is."""
    one = len(seen.names) == 1
    count = len(plain.time)
    point = seen.point[-count:, 0] if one else plain.position
    force, torque = seen.force[-count:], seen.torque[-count:]
    moment = np.cross(seen.point[-count:] - point[:, None], force) + torque
    world = np.concatenate([moment.sum(axis=1), force.sum(axis=1)], axis=1).reshape(-1, 2, 3)
    own = (np.swapaxes(plain.rotation, 1, 2)[:, None] @ world[..., None])[..., 0].reshape(-1, 6)
    zeros = [theta for effect, theta in load.effects if effect.name == "force_bias"]
    if one and zeros:
        bias = np.zeros(6)
        bias[3 : 3 + min(3, len(zeros[0]))] = zeros[0][:3]
        bias[:3] = zeros[0][3:6] if len(zeros[0]) >= 6 else 0.0
        own = own - bias
    return np.asarray(own)


def recordings(
    seeds: Sequence[int], kinds: Sequence[str]
) -> Iterator[tuple[str, float, int, Streams]]:
    """A wrist sensor whose zero is off, and four fingers, each with the rate of its forces."""
    for seed in seeds:
        for kind, rate in ((name, float(hz)) for name, hz in (k.split(":") for k in kinds)):
            if kind == "wrist":
                options = WristOptions(
                    duration=LEARNT + SCORED, rate_hz=rate, bias_n=4.0, bias_nm=0.1
                )
                yield kind, rate, seed, wrist_table(seed, options)[0].streams()
            else:
                sensors = SensorOptions(force_rate_hz=rate, pose_rate_hz=100.0)
                scenario = ScenarioOptions(duration=LEARNT + SCORED)
                yield kind, rate, seed, generate(seed, {}, scenario, sensors).streams


def real(folder: Path) -> Iterator[Row]:
    """The payload on a KUKA arm: learnt on one run, scored on another."""
    importer, asked = KukaFtImuImporter(), Namespace(tare=False, imu_delay=0.0084)
    names = ("1-baseline", "2-vibrations", "3-vibrations-contact")
    first, *others = (importer.read(folder / name, asked).streams for name in names)
    for name, run in zip(names[1:], others, strict=True):
        yield _across(f"KUKA, {names[0]} to {name}", first, run)


def _across(kind: str, first: Streams, second: Streams) -> Row:
    found = td.estimate(Recording(first, kind)).found
    effects = {name: effect.to_json() for name, effect in found.effects.items()}
    body = KnownBody(
        found.inertia.dynamic_parameters, found.covariance, kind, (), effects, 1, found.lasting
    )
    load = Load.of_body(body, tuple(first.contacts))
    compensator = Compensator()
    compensator.load = load
    seen, imu = readings(second), second.imu
    assert imu is not None and imu.rotation is not None
    compensator.motion = motion = ImuMotion()
    poses = PoseStream(imu.time, np.zeros((len(imu.time), 3)), imu.rotation, None)
    began = clock.process_time()
    answers, changes = replay(
        poses, seen, compensator, lambda k: motion.feel(imu.time[k], imu.specific_force[k])
    )
    cost = (clock.process_time() - began) / len(seen.time)
    plain = _stack(answers)
    scored = plain.time > plain.time[0] + SETTLED
    return Row(
        kind,
        1.0 / float(np.median(np.diff(seen.time))),
        0,
        **_left(plain, scored, _carried(plain, seen, load)),
        push_n=np.nan,
        tap_n=np.nan,
        noticed_s=np.nan,
        false=float(np.mean(changes[scored] != 0.0)),
        cost_us=1e6 * cost,
    )


def table(rows: Sequence[Row]) -> list[str]:
    """Lines of Markdown, one per kind and rate."""
    head = (
        "| sensors | Hz | n | force removed | torque removed | left | beyond 2 std | push | tap |"
        " more load noticed | seen where none is | CPU |"
    )
    lines = [head, "|---|" + "---:|" * 11]
    for kind, rate in dict.fromkeys((row.kind, round(row.rate_hz)) for row in rows):
        own = [row for row in rows if (row.kind, round(row.rate_hz)) == (kind, rate)]

        def worst(name: str, own: Sequence[Row] = own) -> float:
            return max(getattr(row, name) for row in own)

        def least(name: str, own: Sequence[Row] = own) -> float:
            return min(getattr(row, name) for row in own)

        lines.append(
            f"| {kind} | {rate} | {len(own)} | {100 * least('force_removed'):.1f} % "
            f"| {100 * least('torque_removed'):.1f} % | {worst('force_left_n'):.2f} N "
            f"| {100 * worst('beyond'):.0f} % | {worst('push_n'):.2f} N | {worst('tap_n'):.2f} N "
            f"| {worst('noticed_s'):.2f} s | {100 * worst('false'):.1f} % "
            f"| {np.median([row.cost_us for row in own]):.0f} us |"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, each figure the worst of its recordings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--start", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--seeds", type=int, default=5, help="recordings of each kind")
    parser.add_argument("--data", type=Path, help="folder that holds kuka_ft_imu, scored too")
    parser.add_argument("--json", action="store_true", help="print only JSON on stdout")
    parser.add_argument("--kinds", nargs="+", default=KINDS, help="sensors and their rate, Hz")
    options = parser.parse_args(arguments)
    rows = []
    seeds = range(options.start, options.start + options.seeds)
    for kind, rate, seed, streams in recordings(seeds, options.kinds):
        rows.append(measure(kind, rate, seed, streams))
        print(rows[-1], file=sys.stderr)
    if options.data is not None:
        rows += real(options.data / "kuka_ft_imu")
    if options.json:
        print(
            json.dumps(
                [
                    {k: v if isinstance(v, str) else float(v) for k, v in vars(row).items()}
                    for row in rows
                ]
            )
        )
    else:
        print("\n".join(table(rows)))
    return 0
