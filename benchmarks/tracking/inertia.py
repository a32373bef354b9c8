"""The inertial estimate from each tracker's poses and the same contact forces."""

from __future__ import annotations

import time
from collections import defaultdict
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from benchmarks.inertia.in_hand import contact_stream
from benchmarks.inertia.scores import Score
from benchmarks.tracking.tape import Tape
from benchmarks.tracking.trackers import Track
from tactile_dynamics_ros.core.contact.contact_state import Contact
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.inertia.estimate import estimate as estimate_body
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import InertialParameters
from tactile_dynamics_ros.core.streams.streams import ContactStream, PoseStream, Streams
from tactile_dynamics_ros.core.tracking.hand_error import carry_contacts
from tactile_dynamics_ros.sim.objects import load_object

_RATE_HZ = 100.0


def estimate_with_each(tape: Tape, tracks: dict[str, Track]) -> dict[str, Any]:
    """Return the errors of the inertial estimate by tracker, and with the true poses.

    Contacts go with the fused pose, as in the nodes and in recordings.
    """
    truth = load_object(tape.name).inertia
    contacts = _contacts(tape)
    found: dict[str, Any] = {"object": tape.name}
    for label, track in {"true_pose": _true_track(tape), **tracks}.items():
        streams = Streams(_poses(track), contacts)
        if label == "fused":
            streams = carry_contacts(streams, _poses(tracks["kinematic_only"]))
        found[label] = _score(streams, truth)
    return found


def _score(streams: Streams, truth: InertialParameters) -> dict[str, Any]:
    began = time.process_time()
    try:
        estimate = estimate_body(streams).to_estimate()
    except TactileDynamicsError as error:
        return {"error": str(error)}
    score = Score.of(truth, estimate.inertia.dynamic_parameters, time.process_time() - began)
    return {
        "trace_error": score.trace_error,
        "distance": score.distance,
        "mass_percent": score.mass_percent,
        "com_mm": score.com_mm,
    }


def _poses(track: Track) -> PoseStream:
    """As a stream at 100 Hz; images in between are bridged by splines."""
    stamps = np.array(track.time)
    pose = np.array(track.pose)
    spread = np.array([np.eye(6) if c is None else c for c in track.covariance])
    if np.median(np.diff(stamps)) < 1.5 / _RATE_HZ:
        return PoseStream(stamps, pose[:, :3, 3], pose[:, :3, :3], spread)
    grid = np.arange(stamps[0], stamps[-1], 1.0 / _RATE_HZ)
    position = CubicSpline(stamps, pose[:, :3, 3])(grid)
    rotation = RotationSpline(stamps, Rotation.from_matrix(pose[:, :3, :3]))(grid).as_matrix()
    return PoseStream(grid, position, rotation, np.full((len(grid), 6, 6), np.median(spread, 0)))


def _true_track(tape: Tape) -> Track:
    track = Track()
    for moment in tape.moments:
        if moment.aloft:
            track.add(moment.time, moment.truth, 1e-10 * np.eye(6), False)
    return track


def _contacts(tape: Tape) -> dict[str, ContactStream]:
    rows: dict[str, list[tuple[float, Contact]]] = defaultdict(list)
    for moment in tape.moments:
        if moment.aloft:
            for finger, contact in moment.contacts.items():
                rows[finger].append((moment.touch_time, contact))
    return {finger: contact_stream(finger, found) for finger, found in rows.items()}
