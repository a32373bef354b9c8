"""A recording of pushes with one more push that was only simulated: what it would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.planar.actions.candidate import Candidate, path_of
from tactile_dynamics_ros.core.planar.actions.information import (
    STIFFNESS,
    Belief,
    PredictedObject,
)
from tactile_dynamics_ros.core.planar.mechanics.linkage import placed, turned
from tactile_dynamics_ros.core.planar.mechanics.pusher import Tip
from tactile_dynamics_ros.core.planar.mechanics.simulation import StepConfig, simulate
from tactile_dynamics_ros.core.planar.streams import PushContact, PushedStreams

_STEP = 2e-3
"""s of the simulation: an impact of a stiff tip takes ten of them."""
_PAUSE = 1.0
"""s between the recording and the push: they are two sessions for the estimator."""
_TOUCH = 1e-3
"""N from which a contact is measured: a thirtieth of the noise of a pad."""


def continued(
    streams: PushedStreams,
    thing: PredictedObject,
    belief: Belief,
    push: Candidate,
    random: np.random.Generator,
) -> PushedStreams:
    """Append a push of the believed object, at the rates and with the noise of the recording.

    Forces are means over the time between samples, as sensors send them.

    Args:
        streams: of one part.
        thing: the object.
        belief: what is known of it.
        push: in the object's frame, from its last pose on.
        random: of the noise.
    """
    config = StepConfig(step=_STEP, rounds=3)
    tip = Tip(
        thing.outline,
        np.full(1, thing.push_height),
        np.full(1, thing.tip_friction),
        stiffness=np.full(1, STIFFNESS),
    )
    body = thing.linkage(belief.mean[None], np.full(1, thing.com_height))
    motion = simulate(body, tip, np.zeros((1, 1, 3)), path_of(push, _STEP)[None], config)
    link, (name, contact) = streams.links[0], next(iter(streams.contacts.items()))
    start, last = float(link.time[-1]) + _PAUSE, link.pose[-1]
    place = placed(motion.pose[0, :, 0, :2], last)
    pose = np.column_stack([place, motion.pose[0, :, 0, 2] + last[2]])
    seen = slice(None, None, _every(link.time))
    pose = pose[seen] + link.presumed_pose_std * random.normal(size=(len(pose[seen]), 3))
    longer = replace(
        link,
        time=np.append(link.time, start + motion.time[seen]),
        pose=np.concatenate([link.pose, pose]),
    )
    force = np.pad(turned(motion.wrench[0, :, :2], last[2]), ((0, 0), (0, 1)))
    touched = np.linalg.norm(force, axis=1) > _TOUCH
    every = _every(contact.time)
    measured = np.flatnonzero(touched)[::every]
    force = uniform_filter1d(force, every, axis=0)  # at instants the tip's ringing is aliased
    way = turned(push.normal[None], last[2:])[0]
    more = _measured(contact, start + motion.time[measured], force[measured], random)
    point = np.column_stack(
        [placed(motion.point[0, :, :2], last)[measured], np.full(len(measured), thing.push_height)]
    )
    point[:, :2] += contact.presumed_point_std * random.normal(size=(len(measured), 2))
    normal = np.tile(np.append(way, 0.0), (len(measured), 1))
    contact = replace(
        more,
        pose_time=np.append(contact.pose_time, start + motion.time[measured]),
        point=np.concatenate([contact.point, point]),
        normal=np.concatenate([contact.normal, normal]),
    )
    sessions = streams.session_starts or (float(link.time[0]),)
    return replace(
        streams,
        links=(longer,),
        contacts={name: contact},
        pusher_time=None,
        pusher_yaw=None,
        session_starts=(*sessions, start),
    )


def _measured(
    contact: PushContact, time: Array, force: Array, random: np.random.Generator
) -> PushContact:
    noisy = force + contact.presumed_force_std * random.normal(size=force.shape)
    torque = contact.torque
    if torque is not None:
        torque = np.concatenate([torque, np.zeros_like(noisy)])
    return replace(
        contact,
        time=np.append(contact.time, time),
        force=np.concatenate([contact.force, noisy]),
        torque=torque,
    )


def _every(time: Array) -> int:
    """Steps of the simulation between samples."""
    return max(1, round(float(np.median(np.diff(time))) / _STEP))
