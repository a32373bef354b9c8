"""A minute of pressing the simulated hand's fingertips against a known force, and what it yields.

Usage: python -m benchmarks.biotac_press_rig [--unit-seed 0] [--seed 0] [--out DIR]

Every fingertip is pressed for a minute on the part of its skin that the grasps of this hand use, in
all directions that friction lets one press, and a force sensor reads the force. The presses are
written to a rosbag2 recording, from which `tactile-dynamics calibrate` finds the gains of `gains`
in config/allegro_iiwa.yaml.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from tactile_dynamics_ros.core.contact.robot_description import FINGERS, sensor_frame
from tactile_dynamics_ros.core.tactile.estimators import create_force_estimator
from tactile_dynamics_ros.core.tactile.unit_gain import UnitGain, fit_unit_gain
from tactile_dynamics_ros.sim.sensors.biotac import BioTacArray
from tactile_dynamics_ros.sim.sensors.biotac.skin import OUTER_RADIUS, outward_normal

Array = NDArray[np.float64]

ALONG = np.array([3.8e-3, 3.4e-3, 3.8e-3, 4.0e-3])
AROUND = np.deg2rad([8.0, 0.0, -8.0, -44.0])
"""Where this hand's grasps touch the skin: along the finger (m) and around it."""

REST, REFERENCE_STD = 60, 0.01
_WRENCH = "geometry_msgs/msg/WrenchStamped"


def press_fingertips(unit_seed: int, seed: int, seconds: float = 60.0) -> tuple[Array, Array]:
    """Return estimated and known forces (4, N, 3) of the hand's fingertips, sensor frames, N."""
    array = BioTacArray(len(FINGERS), seed=seed + 50_000, unit_seed=unit_seed)
    rng = np.random.default_rng([seed, 11])
    force, point = _presses(round(100 * seconds), rng)
    raw = np.stack([array.measure(force[:, k], point[:, k]) for k in range(force.shape[1])], axis=1)
    found = np.zeros_like(force)
    for finger, counts in enumerate(raw):
        estimator = create_force_estimator()
        estimator.tare(counts[: REST - 5])
        found[finger] = [estimator.estimate(frame)[0] for frame in counts]
    known = force + REFERENCE_STD * rng.standard_normal(force.shape)
    return found[:, REST:], known[:, REST:]


def calibrate_units(unit_seed: int) -> list[UnitGain]:
    """Gains of the four fingertips of a hand from a minute of presses of its own."""
    pressed = press_fingertips(unit_seed, seed=unit_seed)
    return [fit_unit_gain(*pair) for pair in zip(*pressed, strict=True)]


def _presses(frames: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return forces (4, T, 3) N and contact points (4, T, 3) m: rolling, pressing, dragging."""
    along = np.clip(ALONG[:, None] + 1.0e-3 * _waves(frames, 0.25, rng), -14e-3, 6.6e-3)
    around = AROUND[:, None] + 0.2 * _waves(frames, 0.25, rng)
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
    frequency = rate_hz * rng.uniform(0.05, 1.0, (len(FINGERS), 4, 1))
    phase = rng.uniform(0.0, 2 * np.pi, frequency.shape)
    return np.asarray(np.sin(2 * np.pi * frequency * time + phase).sum(axis=1) / np.sqrt(2.0))


def write_presses(path: Path, found: Array, known: Array) -> None:
    """Write estimated and known forces (4, N, 3) as a recording."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for k, finger in enumerate(FINGERS):
            for topic, forces in ((f"/biotac/{finger}/force", found), (f"/rig/{finger}", known)):
                connection = writer.add_connection(topic, _WRENCH, typestore=store)
                for row, force in enumerate(forces[k]):
                    stamp = 10**9 + 10_000_000 * row
                    writer.write(connection, stamp, _message(store, stamp, finger, force))


def _message(store: object, stamp: int, finger: str, force: Array) -> bytes:
    kinds = store.types  # type: ignore[attr-defined]
    vector = kinds["geometry_msgs/msg/Vector3"]
    time = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    message = kinds[_WRENCH](
        header=kinds["std_msgs/msg/Header"](stamp=time, frame_id=sensor_frame(finger)),
        wrench=kinds["geometry_msgs/msg/Wrench"](
            force=vector(*force), torque=vector(0.0, 0.0, 0.0)
        ),
    )
    return bytes(store.serialize_cdr(message, _WRENCH))  # type: ignore[attr-defined]


def main() -> int:
    """Press, record, calibrate with the command, print the parameter."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--unit-seed", type=int, default=0, help="which hand (0)")
    parser.add_argument("--seed", type=int, default=0, help="of presses and noise (0)")
    parser.add_argument("--out", type=Path, default=Path("out/presses"), help="new recording")
    arguments = parser.parse_args()
    write_presses(arguments.out, *press_fingertips(arguments.unit_seed, arguments.seed))
    print("    gains:")
    for finger in FINGERS:
        words = ["calibrate", str(arguments.out), "--finger", finger]
        words += ["--reference", f"/rig/{finger}", "--json"]
        command = [sys.executable, "-m", "tactile_dynamics_ros.cli.main", *words]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        numbers = [f"{value:.4f}" for row in json.loads(done.stdout)["matrix"] for value in row]
        first, last = finger == FINGERS[0], finger == FINGERS[-1]
        row = ", ".join(numbers) + ("]" if last else ",")
        print(f"      {'[' if first else ' '}{row}  # {finger}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
