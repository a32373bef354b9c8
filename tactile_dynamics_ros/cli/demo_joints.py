"""The demo of an arm without a wrist sensor: error, where, name, payload before and after, live."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactile_dynamics_ros.api.discrepancies import Comparison, Explanation
from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
from tactile_dynamics_ros.api.questions import question_joints
from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.joints.estimate import refit
from tactile_dynamics_ros.core.joints.live import JointMonitor
from tactile_dynamics_ros.core.joints.model import JointsModel
from tactile_dynamics_ros.core.robot.robot_file import load_robot
from tactile_dynamics_ros.recording.joints import JointRecording
from tactile_dynamics_ros.synthetic import joints as hidden
from tactile_dynamics_ros.synthetic.recordings import EPOCH_NS

HIDDEN = "link_cable"
"""What is hidden unless another effect is named: a cable that pulls on a link looks like a payload
where one model of links has to fit recordings with and without it."""
MASS = 2.5
"""Payload, kg."""
_EVERY = 25
"""Samples between answers of the live model: 20 a second."""

Say = Callable[[str], None]


def play(name: str, magnitude: float, seed: int, out: Path, say: Say) -> dict[str, Any]:
    """Play the story and return what was found.

    Args:
        name: of the hidden effect, or "none".
        magnitude: multiple of its typical size.
        seed: of arm, motion and payload.
        out: folder of recordings and report.
        say: prints a line.

    Raises:
        BadInputError: there is no such effect of joints.
    """
    if name not in ("none", *hidden.CATALOGUE, *hidden.OUTSIDE):
        raise BadInputError(f"--hidden {name}: expected one of {', '.join(hidden.CATALOGUE)}")
    started = time.monotonic()
    empty, loaded, payload = _record(name, magnitude, seed, out, say)
    comparison = Comparison.of(question_joints(loaded))
    _say_all(say, comparison.lines())
    explanation = Explanation.of(question_joints(loaded))
    say(explanation.document["sentence"])
    page = explanation.report(out / "explain", f"tactile-dynamics explain {out / 'loaded.mcap'}")
    added = explanation.effects
    weighed = {
        words: EstimateOfJoints.of(loaded, effects, empty)
        for words, effects in (("before", ()), ("with the effects", added))
    }
    say(f"the payload is {payload.mass:.3f} kg; beside the empty arm, in the same motion:")
    masses = {words: _weigh(found, payload) for words, found in weighed.items()}
    _say_all(say, [f"  {words}: {one['text']}" for words, one in masses.items()])
    live = _watch(weighed["before"].found.model, added, loaded)
    say("torque that the live model takes for a touch, RMS over joints, in units of their noise:")
    _say_all(say, [f"  {words}: {error:.2f}" for words, error in live.items()])
    say(f"done in {time.monotonic() - started:.0f} s; open {page}")
    return {
        "hidden": name,
        "truth": {"mass": payload.mass},
        "comparison": comparison.to_json(),
        "explanation": explanation.to_json(),
        "payload": {
            words: found.to_json()["payload"] | masses[words] for words, found in weighed.items()
        },
        "live_error": live,
        "report": str(page),
        "wall_time_s": round(time.monotonic() - started, 1),
    }


def _record(
    name: str, magnitude: float, seed: int, out: Path, say: Say
) -> tuple[JointRecording, JointRecording, hidden.Payload]:
    """Make and write the recordings without and with the payload."""
    urdf, payload = load_robot("allegro_iiwa").urdf, hidden.Payload.draw(MASS, seed)
    effects = {} if name == "none" else {name: magnitude}
    recordings = []
    for words, options in (
        ("empty", hidden.JointOptions(repeat=1)),
        ("loaded", hidden.JointOptions(payload=payload)),
    ):
        made = hidden.generate(urdf, seed, effects, options)
        recording = JointRecording(made.streams, str(out / f"{words}.mcap"), epoch_ns=EPOCH_NS)
        recording.to_bag(out / f"{words}.mcap")
        recordings.append(recording)
    say(f"an arm of seven joints moved for half a minute, twice; recorded {out}/*.mcap")
    say(
        "it differs from its URDF, rubs, and something is hidden in its joints; nobody is told what"
    )
    return recordings[0], recordings[1], payload


def _weigh(found: EstimateOfJoints, truth: hidden.Payload) -> dict[str, Any]:
    """How far a payload is from the truth, whether it is an answer, and both in words."""
    body, std = found.found.payload.body, found.found.payload.std
    off = body.mass - truth.mass
    away = 1e3 * float(np.linalg.norm(body.com - truth.com))
    words = f"{body.mass:.3f} ± {std[0]:.3f} kg, off by {1e3 * off:+.0f} g, centre {away:.1f} mm"
    try:
        found.require_answer()
        answer = True
    except NotIdentifiableError:
        answer = False
    error = f"error {found.found.error:.2f} times the noise" + ": no answer" * (not answer)
    text = f"{words}; {error}"
    return {"off_kg": off, "centre_off_m": 1e-3 * away, "answer": answer, "text": text}


def _watch(model: JointsModel, added: Sequence[str], recording: JointRecording) -> dict[str, float]:
    """RMS of the external torque where nothing touches, over the noise of each joint.

    The live model gets the effects in the middle, fitted to what it measured until then.
    """
    monitor, streams = JointMonitor(model.samples.arm, model.known), recording.streams
    middle = len(streams.time) // 2
    found: tuple[list[Array], list[Array]] = ([], [])
    for k, stamp in enumerate(streams.time):
        if k == middle and added:
            monitor.known = refit(monitor.recent(streams.urdf), added, monitor.known)
        monitor.add(float(stamp), streams.position[k], streams.effort[k])
        told = monitor.latest() if k % _EVERY == 0 else None
        if told is not None:
            found[k >= middle].append(told.external / model.effort_std)
    words = ("before", f"once {', '.join(added) or 'nothing'} was added")
    errors = [float(np.sqrt(np.median(np.mean(np.square(one), axis=1)))) for one in found]
    return dict(zip(words, errors, strict=True))


def _say_all(say: Say, lines: list[str]) -> None:
    for line in lines:
        say(line)
