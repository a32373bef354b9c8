"""Load on a KUKA LBR wrist: force/torque sensor, accelerometer on the load, arm orientation.

One run is three tables, each stamped in microseconds at its own rate: ``<run>_orientations.csv``
(sensor to world), ``<run>_wrench.csv`` (what the load exerts on the sensor) and ``<run>_accel.csv``
(units of g, axes of the IMU). ``0-calibration_fts-accel.csv`` holds static poses with all three.
The body frame is that of the force/torque sensor.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.options import FINITE
from tactile_dynamics_ros.core.rigid_body.rotation import nearest_rotation, skew
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.importers.tables import Table, read_table
from tactile_dynamics_ros.recording.recording import Recording

if TYPE_CHECKING:
    from scipy.spatial.transform import RotationSpline


STANDARD_GRAVITY = 9.80665
GRAVITY_W = np.array([0.0, 0.0, -9.81])
STATIC = "0-calibration"
CALIBRATION_FILE = "0-calibration_fts-accel.csv"
NOISE_FILE = "0-steady-state_wrench.csv"
FORCE, TORQUE, ACCELERATION = ("fx", "fy", "fz"), ("tx", "ty", "tz"), ("ax", "ay", "az")
HOLD_SECONDS, HOLD_RATE, PAUSE_SECONDS = 1.0, 50.0, 1.0


class KukaFtImuImporter(Importer):
    """A wrist force/torque sensor as the one contact "wrist", which carries torque."""

    name = "kuka-ft-imu"
    summary = "wrist force/torque sensor, IMU and orientation tables of one run, or static poses"
    source_help = f"folder and run, such as kuka_ft_imu/1-baseline, or .../{STATIC} (static poses)"

    def add_arguments(self, parser: ArgumentParser) -> None:
        """Add the choices about bias and clocks."""
        parser.add_argument(
            "--tare", action="store_true", help="subtract the wrench bias found on the static poses"
        )
        parser.add_argument(
            "--imu-delay",
            type=FINITE,
            default=0.0,
            metavar="SECONDS",
            help="how late the IMU's stamps are (default 0: as stamped)",
        )

    def read(self, source: Path, options: Namespace) -> Recording:
        """Read one run, or the static poses as a sequence of holds."""
        static = read_table(source.parent / CALIBRATION_FILE)
        calibration = Calibration.from_static_poses(static)
        bias = calibration.wrench_bias if options.tare else np.zeros(6)
        if source.name == STATIC:
            return _static_recording(static, calibration, bias, str(source))
        return _run_recording(source, calibration, bias, options.imu_delay)


@dataclass(frozen=True)
class Calibration:
    """Rotation and biases of the sensors that the static poses tell.

    Attributes:
        R_SI: (3, 3) rotation from IMU axes to those of the force/torque sensor.
        accelerometer_bias: (3,) m/s^2, IMU axes.
        accelerometer_rms: m/s^2 of the fit.
        wrench_bias: (6,) [force N, torque N m] that the sensor reads without load.
        wrench_rms: (2,) N and N m of the fit.
    """

    R_SI: Array
    accelerometer_bias: Array
    accelerometer_rms: float
    wrench_bias: Array
    wrench_rms: Array

    @classmethod
    def from_static_poses(cls, table: Table) -> Calibration:
        """Fit sensor axes and biases to static poses.

        With g_S gravity in sensor axes, the load reads F = m g_S + b_F and
        T = (m c) x g_S + b_T, the accelerometer f_I = -R_SI' g_S + b_f.

        Args:
            table: static poses with wrench, acceleration and orientation.
        """
        gravity_S = np.einsum("nji,j->ni", table.matrices("r"), GRAVITY_W)
        specific = table.columns(*ACCELERATION) * STANDARD_GRAVITY
        affine = np.linalg.lstsq(_with_ones(-gravity_S), specific, rcond=None)[0]
        R_SI = nearest_rotation(affine[:3])
        bias = np.mean(specific + gravity_S @ R_SI, axis=0)
        force, torque = table.columns(*FORCE), table.columns(*TORQUE)
        force_fit = _fit(gravity_S[:, :, None], force)
        torque_fit = _fit(-skew(gravity_S), torque)
        return cls(
            R_SI=R_SI,
            accelerometer_bias=bias,
            accelerometer_rms=float(np.sqrt(np.mean((specific + gravity_S @ R_SI - bias) ** 2))),
            wrench_bias=np.concatenate([force_fit[0][-3:], torque_fit[0][-3:]]),
            wrench_rms=np.array([force_fit[1], torque_fit[1]]),
        )

    def specific_force(self, table: Table) -> Array:
        """Return (N, 3) m/s^2 in the axes of the force/torque sensor."""
        reading = table.columns(*ACCELERATION) * STANDARD_GRAVITY
        return np.asarray((reading - self.accelerometer_bias) @ self.R_SI.T)


def _with_ones(rows: Array) -> Array:
    """Append a column of ones."""
    return np.concatenate([rows, np.ones((len(rows), 1))], axis=1)


def _fit(matrix: Array, readings: Array) -> tuple[Array, float]:
    """Return least-squares parameters with a bias appended, and the RMS that remains."""
    rows = np.concatenate([matrix, np.tile(np.eye(3), (len(matrix), 1, 1))], axis=2)
    flat = rows.reshape(-1, rows.shape[2])
    solution = np.linalg.lstsq(flat, readings.ravel(), rcond=None)[0]
    return solution, float(np.sqrt(np.mean((flat @ solution - readings.ravel()) ** 2)))


def _run_recording(
    source: Path, calibration: Calibration, bias: Array, imu_delay: float
) -> Recording:
    """Return one run; the load's reaction on the sensor is turned to the force on the load."""
    orientations, wrench, accelerations = (
        read_table(source.with_name(f"{source.name}_{kind}.csv"))
        for kind in ("orientations", "wrench", "accel")
    )
    turning = _spline(orientations)
    span = 1e-6 * orientations.column("t")[[0, -1]]
    imu_time, inside_imu = _inside(1e-6 * accelerations.column("t") - imu_delay, span)
    time, inside = _inside(1e-6 * wrench.column("t"), span)
    readings = (wrench.columns(*FORCE, *TORQUE) - bias)[inside]
    R_WS = turning(time - span[0]).as_matrix()
    contact = {
        "time": time,
        "force": -np.einsum("nij,nj->ni", R_WS, readings[:, :3]),
        "torque": -np.einsum("nij,nj->ni", R_WS, readings[:, 3:]),
        "force_std": _force_noise(source.parent),
        "position": [0.0, 0.0, 0.0],
        "rotation": R_WS,
    }
    imu = {
        "time": imu_time,
        "specific_force": calibration.specific_force(accelerations)[inside_imu],
        "rotation": turning(imu_time - span[0]).as_matrix(),
    }
    return Recording.from_arrays({"wrist": contact}, imu=imu, source=str(source))


def _spline(orientations: Table) -> RotationSpline:
    """Return the smooth orientation R_WS over seconds since its first stamp."""
    from scipy.spatial.transform import Rotation, RotationSpline

    time = 1e-6 * orientations.column("t")
    if len(time) < 4 or np.any(np.diff(time) <= 0.0):
        raise BadInputError(f"{orientations.source}: expected four or more increasing stamps")
    return RotationSpline(time - time[0], Rotation.from_matrix(orientations.matrices("r")))


def _inside(time: Array, span: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the times within a span and which ones they are."""
    inside = (time >= span[0]) & (time <= span[1])
    return time[inside], inside


def _force_noise(folder: Path) -> float | None:
    """Return the force sensor's standard deviation at rest in N, if it was measured."""
    path = folder / NOISE_FILE
    if not path.exists():
        return None
    force = read_table(path).columns(*FORCE)
    return float(np.sqrt(np.mean(np.diff(force, axis=0) ** 2) / 2.0))


def _static_recording(
    table: Table, calibration: Calibration, bias: Array, source: str
) -> Recording:
    """Return the static poses as holds of a second each, a pause between them.

    Each reading is repeated; its stated noise grows with the square root of the repetitions, so
    that a hold weighs as much as the one reading.
    """
    repeats = round(HOLD_SECONDS * HOLD_RATE)
    poses = len(table.values)
    within = np.arange(repeats) / HOLD_RATE
    starts = np.arange(poses) * (HOLD_SECONDS + PAUSE_SECONDS)
    time = (starts[:, None] + within).ravel()
    R_WS = np.repeat(table.matrices("r"), repeats, axis=0)
    readings = np.repeat(table.columns(*FORCE, *TORQUE) - bias, repeats, axis=0)
    spread = np.sqrt(repeats)
    contact = {
        "time": time,
        "force": -np.einsum("nij,nj->ni", R_WS, readings[:, :3]),
        "torque": -np.einsum("nij,nj->ni", R_WS, readings[:, 3:]),
        "force_std": spread * calibration.wrench_rms[0],
        "position": [0.0, 0.0, 0.0],
        "rotation": R_WS,
    }
    imu = {
        "time": time,
        "specific_force": np.repeat(calibration.specific_force(table), repeats, axis=0),
        "specific_force_std": spread * calibration.accelerometer_rms,
        "rotation": R_WS,
    }
    return Recording.from_arrays({"wrist": contact}, imu=imu, source=source)
