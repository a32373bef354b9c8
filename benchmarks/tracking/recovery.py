"""How the live chain comes back: from an occlusion, from slip, from a wrong belief."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.tracking.scores import Errors, measure
from benchmarks.tracking.tape import Moment, Tape
from benchmarks.tracking.trackers import LiveChain, Replay, Upset
from tactile_dynamics_ros.core.rigid_body.rotation import exp_so3
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.object_shape import ObjectShape
from tactile_dynamics_ros.core.tracking.vision_tracker import TrackingState

OCCLUSION_S = 0.5
CURTAIN_M = 0.48
AFTER_START_S = 5.0
GOOD_MM, GOOD_DEG, GOOD_S = 2.0, 1.5, 0.3
WRONG_MM, WRONG_DEG = 5.0, 3.0
CONFIDENT = 22.46
"""0.999 quantile of chi squared with six degrees of freedom."""


def recover(tape: Tape, shape: ObjectShape, kind: str) -> dict[str, Any]:
    """Disturb one run and measure how it recovers.

    Args:
        tape: of the run, with a pull for kind "slip".
        shape: of the object.
        kind: "occlusion" (0.5 s, the whole image), "slip" (2 cm) or "wrong_pose" (5 cm, 30 deg).
    """
    aloft = [moment.time for moment in tape.moments if moment.aloft]
    start = aloft[0] + AFTER_START_S
    end, change, upset = start, None, None
    if kind == "occlusion":
        end = start + OCCLUSION_S
        change = _curtain(start, end)
    elif kind == "slip":
        assert tape.slipped is not None
        start, end = tape.slipped
    else:
        upset = Upset(start, _displacement())
    replay = LiveChain(shape, HandKinematics()).run(tape, change, upset)
    errors = measure(tape, shape, replay.fused)
    return {"object": tape.name, "kind": kind, **_judge(errors, replay, start, end)}


def _curtain(start: float, end: float):
    def hide(moment: Moment, depth: np.ndarray) -> np.ndarray:
        return np.full_like(depth, CURTAIN_M) if start <= moment.time < end else depth

    return hide


def _displacement() -> np.ndarray:
    error = np.eye(4)
    error[:3, :3] = exp_so3(np.deg2rad(30.0) * np.array([0.6, -0.48, 0.64]))
    error[:3, 3] = 0.05 * np.array([0.48, 0.64, 0.6])
    return error


def _judge(errors: Errors, replay: Replay, start: float, end: float) -> dict[str, Any]:
    during = (errors.time >= start) & (errors.time < end + 4.0)
    time, position, rotation = (
        values[during] for values in (errors.time, 1e3 * errors.position, errors.rotation)
    )
    rotation = np.rad2deg(rotation)
    states = [(when, state) for when, state, _ in replay.states if start <= when < end + 4.0]
    silent = np.array([_state_at(states, when) is not TrackingState.TRACKING for when in time])
    flagged = errors.flagged[during] | silent
    wrong = (position > WRONG_MM) | (rotation > WRONG_DEG)
    confident = wrong & ~flagged & (errors.nees[during] > CONFIDENT)
    good = (position < GOOD_MM) & (rotation < GOOD_DEG)
    return {
        "recovery_s": _first_lasting(time, good, end) - end,
        "largest_position_mm": float(position.max()),
        "largest_rotation_deg": float(rotation.max()),
        "wrong_s": 0.01 * int(wrong.sum()),
        "flagged_s": 0.01 * int(flagged.sum()),
        "confident_and_wrong_s": 0.01 * int(confident.sum()),
    }


def _state_at(states: list[tuple[float, TrackingState]], when: float) -> TrackingState:
    before = [state for stamp, state in states if stamp <= when]
    return before[-1] if before else TrackingState.TRACKING


def _first_lasting(time: np.ndarray, good: np.ndarray, end: float) -> float:
    """Return the first time after the disturbance from which the pose stays good for a while."""
    count = round(100 * GOOD_S)
    for k in np.flatnonzero(time >= end):
        if len(good) - k >= count and good[k : k + count].all():
            return float(time[k])
    return float("inf")
