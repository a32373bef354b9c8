"""What the demo leaves: the offline estimate beside the live one and the truth, and the report."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread
from numpy.typing import NDArray

from tactile_dynamics_ros.api.text_table import align_rows
from tactile_dynamics_ros.cli.demo_monitor import NAMES
from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.core.inertia.estimate import estimate
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.topics import OBJECT_POSE
from tactile_dynamics_ros.report.estimate_report import write_estimate_report
from tactile_dynamics_ros.report.history import EstimateHistory
from tactile_dynamics_ros.report.page import Picture, Section
from tactile_dynamics_ros.report.style import house_style
from tactile_dynamics_ros.report.summary import draw_summary

PORTRAIT = "tactile_dynamics_ros.sim.portrait"
FEWEST_ESTIMATES = 10

Array = NDArray[np.float64]


def summarise_demo(
    out: Path,
    history: EstimateHistory,
    truth: dict[str, Any],
    hidden: str,
    say: Callable[[str], None],
    effects: Sequence[str] = (),
) -> dict[str, Any]:
    """Estimate from the recording, print live, offline and truth, write the report.

    Args:
        out: directory with `recording`.
        history: live estimates.
        truth: what /robot_sim/reveal said.
        hidden: the hidden effect that was asked for, or "none".
        say: prints a line for people.
        effects: found to be missing; the estimate from the recording includes them.

    Returns:
        A document for --json.
    """
    recording = Recording.from_bag(out / "recording")
    model = estimate(recording, create_effects(effects))
    offline = model.to_estimate()
    body = InertialParameters(truth["mass"], np.array(truth["com"]), np.array(truth["inertia_com"]))
    say(_comparison(history, offline, body))
    if effects:
        say(f"offline: with {', '.join(effects)}")
    effect = truth["hidden_effect"]
    if hidden != "none":
        say(f"hidden effect: {effect['name']}, {effect['parameters']}")
    report = write_estimate_report(
        recording,
        model,
        out,
        history,
        body,
        command=f"tactile-dynamics demo --object {truth['object']}",
        introduction=_introduce(out, history, body, truth["robot"], truth["object"], say),
    )
    live = history.value[-1].tolist() if len(history.time) else None
    return {
        "recording": str(out / "recording"),
        "report": str(report),
        "live": {"value": live, "std": history.std[-1].tolist() if live else None},
        "offline": offline.to_json(),
        "truth": truth,
        "error": _errors(offline, body),
    }


def _introduce(
    out: Path,
    history: EstimateHistory,
    truth: InertialParameters,
    robot: str,
    name: str,
    say: Callable[[str], None],
) -> list[Section]:
    """Return a section that shows the hand with the object, none where it cannot be drawn."""
    if len(history.time) < FEWEST_ESTIMATES:
        return []
    middle = 0.5 * float(history.time[0] + history.time[-1])
    with house_style(), tempfile.TemporaryDirectory() as scratch:
        poses, picture = Path(scratch) / "poses.npz", Path(scratch) / "hand.png"
        positions, object_pose = read_poses(out / "recording", middle)
        np.savez(poses, positions=positions, object_pose=object_pose)
        command = [sys.executable, "-m", PORTRAIT, robot, name, str(poses), str(picture)]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=120)
        except subprocess.SubprocessError as error:
            say(f"the report lacks the picture of the hand: {error}")
            return []
        portrait = (255 * imread(picture)[:, :, :3]).astype(np.uint8)
        figure = draw_summary(portrait, history, truth)
    text = "The hand in the middle of the motion, and the live estimates; dashed: the truth."
    shown = Picture("summary", figure, "hand holding the object, and estimates over time", text)
    return [Section("From grasp to estimate", (), [shown])]


def read_poses(recording: Path, time: float) -> tuple[Array, Array]:
    """Return joint positions (J,) and object pose (4, 4) nearest to a time in a recording, s."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    nearest: dict[str, tuple[float, Any]] = {}
    with Reader(recording) as reader:
        wanted = [c for c in reader.connections if c.topic in ("/joint_states", OBJECT_POSE)]
        for connection, _, raw in reader.messages(connections=wanted):
            message: Any = store.deserialize_cdr(raw, connection.msgtype)
            stamp = message.header.stamp
            gap = abs(stamp.sec + 1e-9 * stamp.nanosec - time)
            if gap < nearest.get(connection.topic, (np.inf, None))[0]:
                nearest[connection.topic] = (gap, message)
    joints, pose = nearest["/joint_states"][1], nearest[OBJECT_POSE][1].pose.pose
    matrix = np.eye(4)
    q, p = pose.orientation, pose.position
    matrix[:3, :3] = quaternion_to_matrix(np.array([q.x, q.y, q.z, q.w]))
    matrix[:3, 3] = [p.x, p.y, p.z]
    return np.array(joints.position), matrix


def _values(body: InertialParameters) -> Array:
    """Mass, centre of mass and inertia about it, (10,) in the order of NAMES."""
    tensor = body.inertia_com
    rows, columns = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
    return np.array([body.mass, *body.com, *tensor[rows, columns]])


def _errors(estimate: InertialEstimate, truth: InertialParameters) -> dict[str, float]:
    mass = abs(estimate.inertia.mass - truth.mass) / truth.mass
    return {
        "mass_percent": 100.0 * float(mass),
        "com_mm": 1e3 * float(np.linalg.norm(estimate.inertia.com - truth.com)),
    }


def _comparison(
    history: EstimateHistory, offline: InertialEstimate, truth: InertialParameters
) -> str:
    """Return a table of live estimate, offline estimate and truth."""
    rows = [("", "live", "std", "offline", "std", "truth", "unit")]
    missing = np.full(len(NAMES), np.nan)
    live, live_std = (
        (history.value[-1], history.std[-1]) if len(history.time) else (missing, missing)
    )
    columns = (live, live_std, _values(offline.inertia), offline.parameter_std, _values(truth))
    for k, (_, label, scale, unit) in enumerate(NAMES):
        rows.append((label, *(f"{scale * column[k]:.2f}" for column in columns), unit))
    return align_rows(rows)
