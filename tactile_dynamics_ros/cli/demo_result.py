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
from tactile_dynamics_ros.cli.demo_findings import Findings
from tactile_dynamics_ros.cli.demo_monitor import NAMES
from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
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
    command: str,
    say: Callable[[str], None],
    found: Findings | None = None,
) -> dict[str, Any]:
    """Estimate from the recording, print live, offline and truth, write the report.

    Args:
        out: directory with `recording`.
        history: live estimates.
        truth: what /robot_sim/reveal said.
        command: that plays the same story again.
        say: prints a line for people.
        found: what was said to be missing from the model; None where nothing was hidden. The
            estimate from the recording includes the effects of its explanation.

    Returns:
        A document for --json.
    """
    recording = Recording.from_bag(out / "recording")
    model, effects = _estimate(recording, found.effects if found else (), say)
    offline = model.to_estimate()
    body = InertialParameters(truth["mass"], np.array(truth["com"]), np.array(truth["inertia_com"]))
    say(_comparison(history, offline, body))
    if effects:
        say(f"offline: with {', '.join(effects)}")
    introduction = _introduce(out, history, body, truth["robot"], truth["object"], say)
    if found:
        told = offline.duration, truth["hidden_effect"]
        introduction.append(Section("What the model misses", found.sentences(*told)))
        for sentence in found.summary(*told):
            say(sentence)
    report = write_estimate_report(
        recording, model, out, history, body, command=command, introduction=introduction
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


def _estimate(
    recording: Recording, effects: Sequence[str], say: Callable[[str], None]
) -> tuple[FittedModel, Sequence[str]]:
    """Return the fit with effects, or of the body alone where that has none, and its effects."""
    try:
        return estimate(recording, create_effects(effects)), effects
    except TactileDynamicsError as error:
        if not effects:
            raise
        say(f"no estimate with {', '.join(effects)} ({error}); of the rigid body alone instead")
        return estimate(recording), ()


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
        command = [sys.executable, "-P", "-m", PORTRAIT, robot, name, str(poses), str(picture)]
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


def _shown(number: float) -> str:
    return f"{number:.2f}" if np.isfinite(number) else "-"


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
        rows.append((label, *(_shown(scale * column[k]) for column in columns), unit))
    return align_rows(rows)
