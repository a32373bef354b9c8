"""`tactile-dynamics calibrate` on a recording of presses."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from benchmarks.biotac_press_rig import press_fingertips
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.tactile.analytic_force import fit_unit_gain

STORE = get_typestore(Stores.ROS2_JAZZY)
WRENCH = "geometry_msgs/msg/WrenchStamped"


def wrench(stamp_ns: int, frame: str, force: np.ndarray) -> bytes:
    kinds = STORE.types
    vector = kinds["geometry_msgs/msg/Vector3"]
    time = kinds["builtin_interfaces/msg/Time"](
        sec=int(stamp_ns // 10**9), nanosec=int(stamp_ns % 10**9)
    )
    message = kinds[WRENCH](
        header=kinds["std_msgs/msg/Header"](stamp=time, frame_id=frame),
        wrench=kinds["geometry_msgs/msg/Wrench"](
            force=vector(*force.tolist()), torque=vector(0.0, 0.0, 0.0)
        ),
    )
    return bytes(STORE.serialize_cdr(message, WRENCH))


def write_presses(path, gain: float, frame: str = "biotac_ring") -> None:
    """Sixty seconds of presses: the finger at 100 Hz, the reference at 250 Hz."""
    rng = np.random.default_rng(2)

    def force(time: float) -> np.ndarray:
        strength = max(0.0, np.sin(0.8 * time))
        return strength * np.array([0.3 * np.cos(time), 0.2, -1.5])

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        finger = writer.add_connection("/biotac/ring/force", WRENCH, typestore=STORE)
        bench = writer.add_connection("/bench/wrench", WRENCH, typestore=STORE)
        for k in range(15_000):
            stamp = 10**12 + 4_000_000 * k
            true = force(4e-3 * k)
            writer.write(bench, stamp, wrench(stamp, frame, true))
            if k % 5 in (0, 2):
                seen = true / gain + 0.02 * rng.normal(size=3) if true.any() else np.zeros(3)
                writer.write(finger, stamp, wrench(stamp, "biotac_ring", seen))


def test_gain_is_found(tmp_path, capsys):
    write_presses(tmp_path / "bag", gain=1.07)
    arguments = ["calibrate", str(tmp_path / "bag"), "--finger", "ring"]
    assert main([*arguments, "--reference", "/bench/wrench", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["gain"] == pytest.approx(1.07, abs=0.01)
    assert found["std"] < 0.01
    press = np.array([0.0, 0.2, -1.5])
    assert np.array(found["matrix"]) @ press == pytest.approx(1.07 * press, abs=0.02)
    assert main([*arguments, "--reference", "/bench/wrench"]) == 0
    assert "number 3" in capsys.readouterr().out


def test_missing_topic_and_wrong_frame_are_refused(tmp_path, capsys):
    write_presses(tmp_path / "bag", gain=1.0, frame="world")
    arguments = ["calibrate", str(tmp_path / "bag"), "--finger", "ring", "--reference"]
    assert main([*arguments, "/elsewhere"]) == 2
    assert "/elsewhere" in capsys.readouterr().err
    assert main([*arguments, "/bench/wrench"]) == 2
    assert "'world'" in capsys.readouterr().err


def test_calibrated_fingertips_err_less_on_other_presses():
    seen, known = press_fingertips(unit_seed=0, seed=1, seconds=12.0)
    others, true = press_fingertips(unit_seed=0, seed=2, seconds=12.0)
    gains = [fit_unit_gain(*pair).matrix for pair in zip(seen, known, strict=True)]
    calibrated = np.einsum("kij,kni->knj", np.swapaxes(gains, 1, 2), others)
    before, after = (np.linalg.norm(f - true, axis=2).mean() for f in (others, calibrated))
    assert after < 0.85 * before
