"""Calibration of the simulated hand's fingertips: ten minutes of warming up, a minute of pressing.

Usage: python -m benchmarks.biotac_press_rig [--unit-seed 0] [--seed 0] [--seconds 60] [--out DIR]

From switching on, the fingertips warm up untouched. Then every one is pressed for a minute on the
part of its skin that the grasps of this hand use, in all directions that friction lets one press,
and a force sensor reads the force. Both are written to rosbag2 recordings, from which
`tactile-dynamics calibrate` finds `drift` and `gains` of config/allegro_iiwa.simulated.yaml.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.core.tactile.analytic_force import create_force_estimator, fit_unit_gain
from tactile_dynamics_ros.core.tactile.calibration import fit_thermal_drift
from tactile_dynamics_ros.core.tactile.fingertip import FingertipConfig
from tactile_dynamics_ros.recording.cdr import BIOTAC_RAW
from tactile_dynamics_ros.ros.conversions import biotac_to_message, wrench_to_message
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray, BioTacConfig
from tactile_dynamics_ros.sim.sensors.biotac.sensor import OUTER_RADIUS, outward_normal

ROBOT = load_robot()


ALONG = np.array([3.8e-3, 3.4e-3, 3.8e-3, 4.0e-3])
AROUND = np.deg2rad([8.0, 0.0, -8.0, -44.0])
"""Where grasps of the right hand touch the skin: along the finger (m) and around it; those of the
left hand mirror them."""

REST, REFERENCE_STD = 3000, 0.01
WARM_UP, WARM_UP_PERIOD = 600.0, 0.1
COLD_START = 10.0
_TARE = 60
_WRENCH = "geometry_msgs/msg/WrenchStamped"
_IMAGE = "sensor_msgs/msg/Image"


def warm_up(unit_seed: int, seed: int) -> NDArray[np.uint16]:
    """Return frames (N, 4, 44) of the untouched fingertips from switching on, ten a second."""
    config = BioTacConfig(cold_start=COLD_START)
    array = BioTacArray(len(ROBOT.fingers), config, seed=seed + 60_000, unit_seed=unit_seed)
    free = np.zeros((len(ROBOT.fingers), 3))
    steps = range(round(WARM_UP / WARM_UP_PERIOD))
    return np.array([array.measure(free, free, dt=WARM_UP_PERIOD) for _ in steps])


def press_fingertips(
    unit_seed: int,
    seed: int,
    seconds: float = 60.0,
    tips: Sequence[FingertipConfig] | None = None,
    left: bool = False,
) -> tuple[Array, Array]:
    """Return estimated and known forces (4, N, 3) of the hand's fingertips, sensor frames, N.

    Args:
        unit_seed: which hand.
        seed: of presses and noise.
        seconds: of pressing, after half a minute of rest.
        tips: configurations of the four fingertips.
        left: whether they are pressed where a left hand's touch.
    """
    tips = tips or [FingertipConfig()] * len(ROBOT.fingers)
    array = BioTacArray(len(ROBOT.fingers), seed=seed + 50_000, unit_seed=unit_seed)
    rng = np.random.default_rng([seed, 11])
    force, point = _presses(REST + round(100 * seconds), rng, -1.0 if left else 1.0)
    raw = np.stack([array.measure(force[:, k], point[:, k]) for k in range(force.shape[1])])
    estimator = create_force_estimator(config=tips)
    estimator.tare(raw[:_TARE])
    found = np.stack([estimator.estimate(frame)[0] for frame in raw], axis=1)
    known = force + REFERENCE_STD * rng.standard_normal(force.shape)
    return found[:, REST:], known[:, REST:]


@lru_cache(maxsize=32)
def calibrate_units(unit_seed: int) -> tuple[FingertipConfig, ...]:
    """Configurations of a hand's fingertips, from warming up and presses of its own."""
    frames = warm_up(unit_seed, seed=unit_seed)
    drifts = [fit_thermal_drift(frames[:, k]).slope for k in range(len(ROBOT.fingers))]
    tips = [FingertipConfig(drift=tuple(map(float, drift))) for drift in drifts]
    pressed = press_fingertips(unit_seed, unit_seed, tips=tips)
    gains = [fit_unit_gain(*pair).matrix for pair in zip(*pressed, strict=True)]
    return tuple(tip.with_gain(tuple(gain.ravel())) for tip, gain in zip(tips, gains, strict=True))


def _presses(frames: int, rng: np.random.Generator, side: float) -> tuple[Array, Array]:
    """Return forces (4, T, 3) N and contact points (4, T, 3) m: rolling, pressing, dragging."""
    along = np.clip(ALONG[:, None] + 1.0e-3 * _waves(frames, 0.25, rng), -14e-3, 6.6e-3)
    around = side * AROUND[:, None] + 0.2 * _waves(frames, 0.25, rng)
    ring = OUTER_RADIUS * np.sqrt(1.0 - (along / OUTER_RADIUS) ** 2)
    point = np.stack([along, ring * np.sin(around), -ring * np.cos(around)], axis=-1)
    normal = outward_normal(point)
    drag = np.stack([_waves(frames, 0.5, rng) for _ in range(3)], axis=-1)
    drag -= np.sum(drag * normal, axis=-1, keepdims=True) * normal
    drag *= 0.6 / np.maximum(np.linalg.norm(drag, axis=-1, keepdims=True), 1.0)
    press = 1.5 + 1.0 * np.clip(_waves(frames, 0.5, rng) / 1.4, -1.0, 1.0)
    press *= np.clip((np.arange(frames) - REST) / 30.0, 0.0, 1.0)
    return press[..., None] * (normal + drag), point


def _waves(frames: int, rate_hz: float, rng: np.random.Generator) -> Array:
    """Return smooth random curves (4, T) of about unit amplitude."""
    time = 0.01 * np.arange(frames)
    frequency = rate_hz * rng.uniform(0.05, 1.0, (len(ROBOT.fingers), 4, 1))
    phase = rng.uniform(0.0, 2 * np.pi, frequency.shape)
    return np.asarray(np.sin(2 * np.pi * frequency * time + phase).sum(axis=1) / np.sqrt(2.0))


def write_presses(path: Path, found: Array, known: Array) -> None:
    """Write estimated and known forces (4, N, 3) as a recording."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for k, finger in enumerate(ROBOT.fingers):
            for topic, forces in ((f"/biotac/{finger}/force", found), (f"/rig/{finger}", known)):
                connection = writer.add_connection(topic, _WRENCH, typestore=store)
                for row, force in enumerate(forces[k]):
                    stamp = 10**9 + 10_000_000 * row
                    wrench = np.concatenate([np.zeros(3), force])
                    message = wrench_to_message(wrench, 1e-9 * stamp, ROBOT.sensor_frame(finger))
                    writer.write(connection, stamp, message)


def write_frames(path: Path, frames: NDArray[np.uint16], period: float) -> None:
    """Write raw counts (N, 4, 44) as a recording."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(BIOTAC_RAW, _IMAGE, typestore=store)
        for row, counts in enumerate(frames):
            stamp = 10**9 + round(1e9 * period) * row
            writer.write(connection, stamp, biotac_to_message(counts, 1e-9 * stamp, "biotac"))


def _calibrate(*words: str) -> Any:
    """Return what the command prints."""
    command = [sys.executable, "-m", "tactile_dynamics_ros.cli.main", "calibrate", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def _print_rows(name: str, rows: Sequence[Sequence[float]], digits: int) -> None:
    print(f"    {name}:")
    for finger, row in zip(ROBOT.fingers, rows, strict=True):
        numbers = ", ".join(f"{value:.{digits}f}" for value in row)
        start, end = (
            "[" if finger == ROBOT.fingers[0] else " ",
            "]" if finger == ROBOT.fingers[-1] else ",",
        )
        print(f"      {start}{numbers}{end}  # {finger}")


def main() -> int:
    """Warm up, press, record, calibrate with the command, print the parameters."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unit-seed", type=int, default=0, help="which hand (0)")
    parser.add_argument("--seed", type=int, default=0, help="of presses and noise (0)")
    parser.add_argument("--seconds", type=float, default=60.0, help="of pressing (60)")
    parser.add_argument("--out", type=Path, default=Path("out/rig"), help="folder of recordings")
    parser.add_argument("--left", action="store_true", help="pressed as those of a left hand")
    arguments = parser.parse_args()
    warming, presses = arguments.out / "warm_up", arguments.out / "presses"
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_frames(warming, warm_up(arguments.unit_seed, arguments.seed), WARM_UP_PERIOD)
    found = _calibrate(str(warming), "--drift")
    drifts = [found[finger]["drift"] for finger in ROBOT.fingers]
    tips = [FingertipConfig(drift=tuple(drift)) for drift in drifts]
    pressed = press_fingertips(
        arguments.unit_seed, arguments.seed, arguments.seconds, tips, arguments.left
    )
    write_presses(presses, *pressed)
    gains = []
    for finger in ROBOT.fingers:
        words = str(presses), "--finger", finger, "--reference", f"/rig/{finger}"
        gains.append(np.ravel(_calibrate(*words)["matrix"]).tolist())
    _print_rows("drift", drifts, 2)
    _print_rows("gains", gains, 4)
    return 0


if __name__ == "__main__":
    sys.exit(main())
