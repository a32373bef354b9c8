"""A recording at one of its times, for the page."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.api.discrepancies import Comparison
from tactile_dynamics_ros.api.verbs import diagnose, estimate
from tactile_dynamics_ros.core.errors import TactileDynamicsError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import inertia_vector
from tactile_dynamics_ros.core.streams.streams import nearest_samples
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.view.state import KEPT, Body, Force, History, Quantity, State

_NEAR = 0.1
"""Distance of a sample, s, up to which it is shown for a time: twice the period of slow loggers.
Smaller makes arrows flicker on them, larger shows forces that are gone."""


_PLACES = 3
"""Places shown of those where the model fails, worst first: a phone shows no more at a glance."""


class Playback:
    """States of a recording over time.

    Args:
        recording: with a pose of the object.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        streams = recording.streams
        times = [contact.time for contact in streams.contacts.values()]
        if streams.pose is not None:
            times.append(streams.pose.time)
        self.start = min(float(time[0]) for time in times if len(time))
        self.stop = max(float(time[-1]) for time in times if len(time))
        self._state = State()
        self._effects: tuple[str, ...] = ()
        self._estimate()
        self._add_load()

    @property
    def duration(self) -> float:
        """Length of the recording, s."""
        return self.stop - self.start

    def close(self) -> None:
        """Nothing is open."""

    def at(self, seconds: float) -> State:
        """Return the state at a time from the start, s; the estimate is that of all of it."""
        time, state, streams = self.start + seconds, self._state, self.recording.streams
        pose = streams.pose
        if pose is not None and len(pose.time):
            k = int(nearest_samples(pose.time, np.array([time]))[0])
            state.object_pose = np.eye(4)
            state.object_pose[:3, :3], state.object_pose[:3, 3] = pose.rotation[k], pose.position[k]
        state.forces = {}
        for name, contact in streams.contacts.items():
            k = int(nearest_samples(contact.time, np.array([time]))[0])
            place = int(nearest_samples(contact.pose_time, np.array([time]))[0])
            if abs(contact.time[k] - time) > _NEAR or not np.any(contact.force[k]):
                continue
            std = None if contact.force_std is None else contact.force_std[k]
            state.forces[name] = Force(contact.position[place], contact.force[k], std)
        return state

    def diagnose(self) -> str:
        """Find out which effect is missing; return the sentence."""
        try:
            found = diagnose(self.recording, effects=self._effects)
        except TactileDynamicsError as error:
            return str(error)
        document, state = found.to_json(), self._state
        state.verdict, state.floor = str(document["sentence"]), document["error"]["noise_floor"]
        state.fits = found.verdict == "adequate"
        state.missing = tuple(filter(None, dict.fromkeys((found.effect, *document["group"]))))
        state.regimes = tuple(found.findings.regimes)
        return state.verdict

    def add(self, name: str) -> str:
        """Add an effect to the model and estimate anew; return how the error changes."""
        before, state = self._state.error, self._state
        self._effects = (*self._effects, name)
        if not self._estimate():
            self._effects = self._effects[:-1]
            said, _ = state.remark, self._estimate()
            return f"{name} is not added: {said}"
        state.missing, state.verdict, state.fits = (), "", True
        return f"{name} is added: error {before or np.nan:.2f} -> {state.error:.2f}"

    def _estimate(self) -> bool:
        """Estimate with the effects of the model, and show where it fails; return success."""
        state = self._state
        try:
            asked = estimate(self.recording, effects=self._effects)
            found, compared = asked.to_json(), Comparison.of(asked.question)
        except TactileDynamicsError as error:
            state.remark, state.good = str(error), False
            return False
        mass, com = found["mass"], found["com"]
        inertia = [inertia_vector(found["inertia_com"][key]) for key in ("value", "std")]
        centre = np.array(com["value"]), np.array(com["std"])
        state.body = Body(Quantity(mass["value"], mass["std"]), *centre, *inertia)
        error, state.effects = found["error"]["whitened_rms"], self._effects
        state.error, state.good = error, asked.fits
        state.remark = f"The model fits: error {error:.2f} times the noise."
        if asked.question.misfit:
            state.remark = f"Note: {asked.question.misfit}."
        places = compared.document["fails_where"][:_PLACES]
        state.fails = tuple(f"{one['channel']} {one['condition']}" for one in places)
        time, errors = compared.error_over_time()
        state.failing = compared.answer.intervals
        state.regimes = tuple(compared.regime_spans())
        history = state.histories["error"] = History(whole=True)
        for k in np.unique(np.linspace(0, len(time) - 1, min(len(time), KEPT)).astype(int)):
            history.add(time[k], errors[k])
        return True

    def _add_load(self) -> None:
        """The vertical force of all contacts over the whole recording, for its chart."""
        for time in np.linspace(self.start, self.stop, KEPT):
            forces = self.at(time - self.start).forces.values()
            load = sum(float(force.force[2]) for force in forces)
            std = sum(float(force.std[2]) ** 2 for force in forces if force.std is not None) ** 0.5
            self._state.note("load", time, load, std)
