"""What the demo leaves: estimates beside the truth, what was found, and the report."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread

from tactile_dynamics_ros.api.result import align_rows
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.discrepancy.verdict.wording import join_names
from tactile_dynamics_ros.core.effects import create_effects
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.batch.fitted_model import FittedModel
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import (
    PARAMETER_NAMES,
    InertialEstimate,
)
from tactile_dynamics_ros.core.inertia.batch.knowledge import beside_rivals, say_rivals
from tactile_dynamics_ros.core.inertia.estimate import estimate, estimate_rivals
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.rigid_body.rotation import quaternion_to_matrix
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.topics import OBJECT_POSE
from tactile_dynamics_ros.report.estimate_report import write_estimate_report
from tactile_dynamics_ros.report.estimates import PARAMETERS, SHOWN_PARAMETERS, EstimateHistory
from tactile_dynamics_ros.report.measurements import draw_summary
from tactile_dynamics_ros.report.page import Picture, Section
from tactile_dynamics_ros.report.style import house_style

Document = dict[str, Any]

_NOTHING = "nothing is missing"
_UNKNOWN = "something is missing that is not in the catalogue"


@dataclass(frozen=True)
class Findings:
    """What was said to be missing from the model of a rigid body.

    Attributes:
        live: document of the diagnosis of the running nodes; None if none came.
        seconds: span of the measurements of that diagnosis, s.
        offline: document of the explanation of the whole recording; None if there is none.
    """

    live: Document | None
    seconds: float
    offline: Document | None

    @property
    def law(self) -> Document | None:
        """The law that was learnt live, if one was."""
        return self.live.get("law") if self.live else None

    @property
    def effects(self) -> list[str]:
        """Effects of the explanation, after the file of the law that was learnt live."""
        learnt = [*self.law["beside"], self.law["file"]] if self.law else []
        return learnt + (self.offline["effects"] if self.offline else [])

    def summary(self, whole: float, hidden: Mapping[str, Any]) -> list[str]:
        """Return how live and offline go together, and what was hidden, a sentence each.

        Args:
            whole: span of the measurements of the recording, s.
            hidden: the hidden effect, as robot_sim reveals it.
        """
        return [self._agreement(whole), self._reveal(hidden)]

    def sentences(self, whole: float, hidden: Mapping[str, Any]) -> list[str]:
        """Return the whole story for the report; arguments as those of `summary`."""
        story = []
        if self.live:
            story.append(f"Live, from the first {self.seconds:.0f} s: {self.live['sentence']}")
        if self.offline:
            story.append(f"From all {whole:.0f} s of the recording: {self.offline['sentence']}")
            story += doubts(self.offline)
        return story + self.summary(whole, hidden)

    def _agreement(self, whole: float) -> str:
        if self.live is None or self.live["verdict"] == "none":
            return "Live there was no diagnosis."
        if self.offline is None:
            return "The recording could not be explained; see what was said live."
        said, found = _said_live(self.live), _said_offline(self.offline)
        if self.law:
            return f"With the law learnt live, in all {whole:.0f} s of the recording: {found}."
        alike = _named(self.live) == _named(self.offline) and self.offline["verdict"] == "adequate"
        if said == found or (alike and _named(self.live)):
            return f"Live and offline agree: {said}."
        return (
            f"Live, from the first {self.seconds:.0f} s: {said}; offline, from all {whole:.0f} s: "
            f"{found}. {_why_unlike(self.live, self.offline)}"
        )

    def _reveal(self, hidden: Mapping[str, Any]) -> str:
        name = hidden["name"]
        live = self.live is not None and name in _named(self.live)
        offline = self.offline is not None and name in _named(self.offline)
        where = [word for word, found in (("live", live), ("offline", offline)) if found]
        values = ", ".join(f"{key} {_value(entry)}" for key, entry in hidden["parameters"].items())
        named = f"named {join_names(where, 'and')}" if where else "named neither live nor offline"
        if self.law:
            named += f"; the law learnt live has the form {self.law['form']}"
        return f"Hidden effect: {name} ({values}); {named}."


def doubts(document: Document) -> list[str]:
    """Return a sentence for each effect of an explanation that others could stand for.

    Args:
        document: of an explanation.
    """
    return [
        f"This recording cannot tell {name} from "
        f"{join_names([other for other in group if other != name])}: mass, centre of mass and "
        f"inertia are those with {name}, their intervals hold the others too."
        for name, group in document["groups"].items()
    ]


def _named(document: Document) -> set[str]:
    """Return the effects that a document names, alone or among others, without their regimes."""
    groups = document.get("groups", {}).values()
    names = [document.get("effect"), *document.get("group", ()), *document.get("effects", ())]
    names += [name for group in groups for name in group]
    return {name.partition("[")[0] for name in names if name}


def _said_live(document: Document) -> str:
    if document["verdict"] == "ambiguous":
        return join_names(document["group"])
    kinds = {"adequate": _NOTHING, "convention": "the recording is to be read otherwise"}
    return document["effect"] or kinds.get(document["verdict"], _UNKNOWN)


def _said_offline(document: Document) -> str:
    named = [join_names(document["groups"].get(n, [n])) for n in document["effects"]]
    if document["verdict"] == "adequate":
        return join_names(named, "and") or _NOTHING
    if not named:
        return _UNKNOWN
    return f"{join_names(named, 'and')}, and something else remains"


def _why_unlike(live: Document, offline: Document) -> str:
    """Return how two answers that differ go together."""
    if _named(live) & _named(offline):
        return "They have a name in common; a longer motion determines more of it."
    return "Both ask the same question; offline has more of the motion, and counts."


def _value(entry: Mapping[str, Any]) -> str:
    numbers = np.ravel(entry["value"])
    text = ", ".join(f"{number:.3g}" for number in numbers)
    return f"{f'({text})' if len(numbers) > 1 else text} {entry['unit']}".strip()


PORTRAIT = "tactile_dynamics_ros.sim.portrait"
FEWEST_ESTIMATES = 10


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
    groups = found.offline["groups"] if found and found.offline else {}
    rivals = estimate_rivals(recording, effects, groups)
    alone = model.to_estimate()
    offline = beside_rivals(alone, tuple(rivals.values()))
    body = InertialParameters(truth["mass"], np.array(truth["com"]), np.array(truth["inertia_com"]))
    say(_comparison(history, offline, body))
    if offline.not_excited:
        say(
            "* undetermined by this recording: value and std depend on what was presumed beforehand"
        )
    if not offline.converged:
        say("offline the iteration did not converge; these are its last values, and no answer")
    if effects:
        say(f"offline: with {', '.join(effects)}")
    if rivals:
        say(say_rivals(alone, join_names(effects, "and"), rivals))
    introduction = _introduce(out, history, body, truth["robot"], truth["object"], say)
    if found:
        told = offline.duration, truth["hidden_effect"]
        introduction.append(Section("What the model misses", found.sentences(*told)))
        for sentence in found.summary(*told):
            say(sentence)
    report = write_estimate_report(
        recording, model, out, history, body, command, introduction, estimate=offline
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
            say(f"the report has no picture of the hand: {error}")
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
    """Mass, centre of mass and inertia about it, (10,) in the order of PARAMETER_NAMES."""
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
    missing = np.full(PARAMETERS, np.nan)
    live, live_std = (
        (history.value[-1], history.std[-1]) if len(history.time) else (missing, missing)
    )
    columns = (live, live_std, _values(offline.inertia), offline.parameter_std, _values(truth))
    for k, (label, scale, unit) in enumerate(SHOWN_PARAMETERS):
        shown = [_shown(scale * column[k]) for column in columns]
        if PARAMETER_NAMES[k] in offline.not_excited:
            shown[2] += " *"
        rows.append((label, *shown, unit))
    return align_rows(rows)
