"""The probe: press, load along the surface, ramp until slip, again in other directions."""

from __future__ import annotations

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.errors import NotIdentifiableError
from tactile_dynamics_ros.core.friction.estimate import (
    FrictionEstimate,
    SlipEvent,
    estimate_friction,
)
from tactile_dynamics_ros.core.friction.hold import FingertipImpedance, Hold, holding_fingers
from tactile_dynamics_ros.core.friction.probe_config import (
    FrictionProbeConfig,
    ProbeInput,
    ProbePhase,
    probing_angles,
    tangent_basis,
)
from tactile_dynamics_ros.core.friction.slip_detection import SlipFusion, SlipObservation, SlipState
from tactile_dynamics_ros.core.friction.slip_log import Attempt, SlipLog
from tactile_dynamics_ros.core.rigid_body.rotation import align_points
from tactile_dynamics_ros.core.robot.hand_kinematics import HandKinematics
from tactile_dynamics_ros.core.shape.friction_regions import ObjectSurface, SurfacePlace

_RAMPS = (ProbePhase.LOAD, ProbePhase.UNLOAD, ProbePhase.DRAG)
"""Phases in which a slip is waited for, as the force changes; an alarm in any other is ignored."""
_FORCE_FLOOR = 0.2
"""Normal force, N, at which unloading ends without a slip: the least force that fingertips are
tested at. Lower, contact may be lost; higher, slips of rough surfaces do not come."""
_LEAST_PRESS = 0.05
"""Normal force, N, that a ratio is taken over at least, so that noise of a light touch (0.01 to
0.03 N) makes no slip of it. Lower raises false alarms as a finger lets go, higher hides slips at
light touch."""
_STEEPEST = 1.4
"""Ratio of the wanted tangential to normal force at which a dragging ramp gives up: skin friction
is hardly larger (0.4 to 1.2 on household objects), and the network has learnt traction up to 1.25.
Lower: rough surfaces never slip; higher: holding fingers may slip before."""
_REACHED = 0.5
"""Share of the wanted tangential force that must be pushed at the end of loading; with less the
direction counts as unreachable, and the next one is tried. Lower probes with a force that was
hardly there, higher gives up directions that can be probed."""
_MEMORY_TIME = 2.0
"""Time constant, s, of the force that the skin remembers, which goes with each slip: between the
two times of skin creep (0.2 and 4 s). Slips after a rest are then told from those that follow each
other; much shorter or longer, all slips of a probe remember alike and that effect cannot be
found."""


class FrictionProbe:
    """State machine of one probe; call `start`, then `update` at 50 to 500 Hz.

    Args:
        kinematics: kinematic model of the robot.
        surface: surface of the object.
        config: forces, ramps, limits.

    Attributes:
        phase: what it does. outcome: why it ended early, or "".
        events: slips so far. tried: attempts so far. false_alarms: slips that were not confirmed.
        unreachable: attempts in which the tangential force did not build up.
        slips: the running detector. slip_state: what it says.
        wanted: (2,) normal and tangential force, N. path: of the fingertip along the pull, m.
    """

    def __init__(
        self,
        kinematics: HandKinematics,
        surface: ObjectSurface,
        config: FrictionProbeConfig | None = None,
    ) -> None:
        self.config = config or FrictionProbeConfig()
        self.phase = ProbePhase.IDLE
        self.outcome = ""
        self.events: list[SlipEvent] = []
        self.tried = self.false_alarms = self.unreachable = 0
        self.slips = SlipFusion(self.config.slip)
        self.slip_state = SlipState(False, 0.0, -np.inf, 0.0)
        self.wanted, self.path = np.zeros(2), 0.0
        self._kinematics, self._surface = kinematics, surface
        self._fingers, self._arm_dof = kinematics.fingers, kinematics.robot.arm_dof
        self._holders = holding_fingers(kinematics.robot, self.config.finger)
        self._own = kinematics.robot.owned[self.config.finger]
        self._opposed = kinematics.robot.reference
        self._impedance = FingertipImpedance(kinematics, self.config.finger, self.config.impedance)
        self._hold = Hold(kinematics, self._holders, self.config.impedance.stiffness_scale)

    @property
    def done(self) -> bool:
        """Whether the probe has ended, well or not."""
        return self.phase in (ProbePhase.DONE, ProbePhase.FAILED)

    @property
    def running(self) -> bool:
        """Whether the probe commands the hand."""
        return not self.done and self.phase is not ProbePhase.IDLE

    def estimates(self) -> dict[str, FrictionEstimate]:
        """Friction by region from the slips so far."""
        return estimate_friction(self.events, self.config.estimate)

    def start(self, seen: ProbeInput, targets: Array) -> None:
        """Take over a hand that holds the object.

        Args:
            seen: now.
            targets: (J,) joint targets that are commanded now, rad.

        Raises:
            NotIdentifiableError: the object is not held; says which finger does not touch.
        """
        self._check_held(seen)
        own = seen.contacts[self.config.finger]
        self._begin, self._last = seen.time, seen.time
        self._targets = np.array(targets, dtype=float)
        self._before = self._targets.copy()
        self._place = self._locate(seen, own.point)
        self._normal = seen.object_pose[:3, :3] @ self._place.normal
        pose = self._kinematics.sensor_pose(self.config.finger, seen.positions)
        self._basis = tangent_basis(self._normal, pose[:3, 0])
        self._start_pose = np.array(seen.object_pose)
        self._held_place = np.append(self._place.point, 1.0)
        held = [seen.contacts[f] for f in self._holders]
        normals = [
            seen.object_pose[:3, :3] @ self._locate(seen, contact.point).normal for contact in held
        ]
        points = np.stack([contact.point for contact in held])
        forces = np.stack([contact.force for contact in held])
        probing = (own.point, own.force)
        self._grip_from = np.einsum("ki,ki->k", forces, np.stack(normals))
        self._hold.begin(seen.positions, targets, points, np.stack(normals), forces, probing)
        self._impedance.begin(seen.positions, targets, own.force)
        self._point_in_tip = self._kinematics.in_sensor_frame(
            self.config.finger, seen.positions, own.point
        )
        self._pushed = np.array(own.force)
        self._memory = self.components(own.force)
        self._tips_from = self._holding_tips(seen.positions)
        self.wanted = np.array([own.force @ self._normal, 0.0])
        self._direction = self._basis[0]
        self._angles = probing_angles(self.config.directions)
        self._log = SlipLog()
        self.slips.reset()
        self._tangential, self._press = self.config.tangential, self.config.press
        self.events, self.outcome, self.tried = [], "", 0
        self.false_alarms = self.unreachable = 0
        self._touched = seen.time
        self._enter(ProbePhase.BRACE, seen.time)

    def stop(self, reason: str) -> None:
        """End the probe: the hand goes back to the grip that it had before."""
        if self.running and self.phase is not ProbePhase.RESTORE:
            self.outcome = reason
            self._leave_at = self._targets.copy()
            self._enter(ProbePhase.RESTORE, self._last)

    def halt(self, reason: str) -> None:
        """End the probe at once: the hand stays where it is told to be now."""
        if self.running:
            self.outcome = reason
            self._enter(ProbePhase.FAILED, self._last)

    def update(self, seen: ProbeInput) -> Array:
        """Return joint targets (J,), rad."""
        dt = min(max(seen.time - self._last, 1e-4), 0.05)
        self._last = seen.time
        if not self.running:
            return self._targets.copy()
        self._guard(seen)
        if self.phase is ProbePhase.RESTORE:
            self._restore(seen.time)
        else:
            self._act(dt, seen)
        return self._targets.copy()

    def _check_held(self, seen: ProbeInput) -> None:
        weak = [
            finger
            for finger in self._fingers
            if finger not in seen.contacts
            or np.linalg.norm(seen.contacts[finger].force) < self.config.least_force
        ]
        if seen.time - seen.touch_time > self.config.stale_time:
            age = seen.time - seen.touch_time
            raise NotIdentifiableError(f"friction probe: the last touch is {age:.2f} s old")
        if weak:
            raise NotIdentifiableError(
                f"friction probe: the object is not held, {', '.join(weak)} "
                f"press{'es' if len(weak) == 1 else ''} with less than "
                f"{self.config.least_force} N; grasp it first"
            )

    def _guard(self, seen: ProbeInput) -> None:
        """Stop where going on would not be safe."""
        config = self.config
        if seen.time - seen.touch_time > config.stale_time:
            self.stop(f"touch is stale ({seen.time - seen.touch_time:.2f} s old)")
            return
        strongest = max((float(np.linalg.norm(c.force)) for c in seen.contacts.values()), default=0)
        if strongest > config.force_limit:
            self.stop(f"a finger pressed with {strongest:.1f} N")
        own = seen.contacts.get(config.finger)
        if own is not None and float(own.force @ self._normal) > config.lost_force:
            self._touched = seen.time
        if seen.time - self._touched > config.lost_time:
            self.stop(f"{config.finger} lost contact")
        moved = float(np.linalg.norm((seen.object_pose - self._start_pose) @ self._held_place))
        if moved > config.most_motion:
            self.stop(f"the object moved by {1e3 * moved:.1f} mm")

    def _act(self, dt: float, seen: ProbeInput) -> None:
        own = seen.contacts.get(self.config.finger)
        measured = np.zeros(3) if own is None else own.force
        point = self._contact_place(seen.positions)
        split = self.components(measured)
        observation = self._observation(seen, point, split)
        state = self.slip_state = self.slips.update(seen.time, observation)
        self._log.add(seen.time, split, point)
        self._step_phase(dt, seen, state.slipping and self._elapsed(seen.time) > 0.08)
        wanted = self._force()
        finger = self._impedance.command(dt, seen.positions, wanted, measured)
        share = min(1.0, (seen.time - self._begin) / self.config.brace_time)
        self._memory += dt / _MEMORY_TIME * (split - self._memory)
        self._pushed += min(1.0, dt / 0.03) * (measured - self._pushed)
        probing = (self._kinematics_point(seen.positions), wanted)
        grip = self._grip_from + share * (self._grip(self.wanted[0]) - self._grip_from)
        self._targets[self._arm_dof :] = self._hold.command(dt, seen.positions, grip, probing)
        self._targets[self._own] = finger

    def _observation(self, seen: ProbeInput, point: Array, measured: Array) -> SlipObservation:
        """Signals that may be used: while the load builds up, skin moves without any slip."""
        self.path = float(point @ self._direction)
        ratio = float(np.linalg.norm(measured[1:]) / max(measured[0], _LEAST_PRESS))
        if self.phase is ProbePhase.LOAD and seen.vibration is not None:
            return SlipObservation(seen.vibration, ratio=ratio)
        return SlipObservation(seen.vibration, seen.electrodes, self.path, ratio)

    def _step_phase(self, dt: float, seen: ProbeInput, slipping: bool) -> None:
        """Move the wanted normal and tangential force, and go on to the next phase."""
        config, elapsed = self.config, self._elapsed(seen.time)
        if self.phase in (ProbePhase.BRACE, ProbePhase.PRESS):
            settled = self._ramp(0, self._press, config.press_rate * dt)
            settled &= self._ramp(1, 0.0, config.press_rate * dt)
            least = config.brace_time if self.phase is ProbePhase.BRACE else 0.15
            if settled and elapsed > least:
                self._begin_load(seen)
        elif self.phase in _RAMPS and slipping:
            self._note_slip(seen)
        elif self.phase is ProbePhase.LOAD:
            if self._ramp(1, self._tangential, config.load_rate * dt) and elapsed > 0.1:
                if self._pushed @ self._direction < _REACHED * self._tangential:
                    self.unreachable += 1
                    self._next(seen.time)
                    return
                drag = config.variant == "drag" or (config.variant == "both" and self.tried % 2)
                self._ramp_began = seen.time
                self._enter(ProbePhase.DRAG if drag else ProbePhase.UNLOAD, seen.time)
        elif self.phase is ProbePhase.UNLOAD:
            if self._ramp(0, _FORCE_FLOOR, self._unload_rate() * dt):
                self._next(seen.time)
        elif self.phase is ProbePhase.DRAG:
            most = _STEEPEST * self.wanted[0]
            if self._ramp(1, min(most, 2.0), config.slow_rate * dt):
                self._next(seen.time)
        elif self.phase is ProbePhase.SLIDE and elapsed > config.slide_time:
            self._close_slip(seen)

    def _begin_load(self, seen: ProbeInput) -> None:
        if self._finished(seen.time):
            self.stop("")
            return
        self._impedance.anchor = self._impedance.tip(seen.positions)
        angle = self._angles[self.tried % len(self._angles)]
        self._direction = np.cos(angle) * self._basis[0] + np.sin(angle) * self._basis[1]
        self._angle = float(angle)
        self.slips.reset(self._expected_ratio())
        self._log.clear()
        self._loaded = seen.time
        self._enter(ProbePhase.LOAD, seen.time)

    def _note_slip(self, seen: ProbeInput) -> None:
        self._slip_phase = self.phase
        self._detected = seen.time
        self._memory_at_slip = self._memory.copy()
        self.wanted[1] += self.config.slide_push * (self.tried // 2 % 3)
        self._slid_from = self._contact_place(seen.positions)
        self._place = self._locate(seen, self._kinematics_point(seen.positions))
        self._enter(ProbePhase.SLIDE, seen.time)

    def _close_slip(self, seen: ProbeInput) -> None:
        """Turn the log into a slip event and aim the next slip by what was learned.

        Where the fingertip has not gone on along the pull, it was no slip, and the ramp goes on.
        """
        slid = (self._contact_place(seen.positions) - self._slid_from) @ self._direction
        if slid < self.config.least_slide:
            self.false_alarms += 1
            self.slips.reset(self._expected_ratio())
            self._enter(self._slip_phase, seen.time)
            return
        unloading = self._slip_phase is ProbePhase.UNLOAD
        event = self._log.event(
            Attempt(
                self._angle,
                self._place.region,
                "unload" if unloading else "drag",
                self._ramp_began if self._slip_phase is not ProbePhase.LOAD else self._loaded,
                self._detected,
                np.vstack([self._normal, self._basis]),
                self._memory_at_slip,
            )
        )
        if event is not None:
            self.events.append(event)
        guess = self._expected_ratio()
        if guess is not None:
            most = 0.45 * self.config.impedance.most_force
            self._tangential = float(np.clip(guess * self.config.slip_normal, 0.25, most))
            press = 1.35 * self._tangential / guess + 0.15
            self._press = float(np.clip(press, 0.6, self.config.press))
        self._next(seen.time)

    def _next(self, time: float) -> None:
        self.tried += 1
        self._impedance.anchor = None
        self._enter(ProbePhase.PRESS, time)

    def _finished(self, time: float) -> bool:
        config = self.config
        if time - self._begin > config.time_limit - 1.0 or self.tried >= config.most_slips:
            return True
        if len(self.events) < config.fewest_slips or self.tried % 2:
            return False
        found = self.estimates().get(self._place.region)
        return found is not None and 2.0 * found.repeatable < config.width

    def _restore(self, time: float) -> None:
        share = min(1.0, self._elapsed(time) / self.config.restore_time)
        self._targets = self._leave_at + share * (self._before - self._leave_at)
        if share >= 1.0:
            failed = bool(self.outcome) or not self.estimates()
            if failed and not self.outcome:
                self.outcome = f"only {len(self.events)} slips in {self.tried} attempts"
            self._enter(ProbePhase.FAILED if failed else ProbePhase.DONE, time)

    def _unload_rate(self) -> float:
        """Fast far from the slip that is expected, slow near it."""
        guess = self._expected_ratio()
        if guess is None:
            return self.config.slow_rate
        near = self.wanted[0] * guess < 1.2 * self.wanted[1]
        return self.config.slow_rate if near else self.config.fast_rate

    def _expected_ratio(self) -> float | None:
        """Ratio of the forces at which slips were seen so far."""
        return float(np.median([event.ratio for event in self.events])) if self.events else None

    def _ramp(self, which: int, goal: float, step: float) -> bool:
        """Move a wanted force towards a goal; return whether it is there."""
        self.wanted[which] += float(np.clip(goal - self.wanted[which], -step, step))
        return bool(abs(self.wanted[which] - goal) < 1e-9)

    def _force(self) -> Array:
        return np.asarray(self.wanted[0] * self._normal + self.wanted[1] * self._direction)

    def components(self, force: Array) -> Array:
        """Normal force, and the tangential one in the two directions of the basis."""
        return np.array([force @ self._normal, *(self._basis @ force)])

    def _grip(self, press: float) -> Array:
        """Wanted normal forces of the holding fingers; the thumb opposes all others."""
        thumb = max(self.config.grip, 1.3 * press)
        rest = 0.5 * max(thumb - press, 0.4)
        return np.array([thumb if f == self._opposed else rest for f in self._holders])

    def _kinematics_point(self, positions: Array) -> Array:
        pose = self._kinematics.sensor_pose(self.config.finger, positions)
        return np.asarray(pose[:3, :3] @ self._point_in_tip + pose[:3, 3])

    def _contact_place(self, positions: Array) -> Array:
        """Contact point of the probing finger as a frame fixed to the holding tips sees it, m."""
        turn, shift = align_points(self._holding_tips(positions), self._tips_from)
        return np.asarray(turn @ self._kinematics_point(positions) + shift)

    def _holding_tips(self, positions: Array) -> Array:
        sensors = self._kinematics.locate(positions).sensors
        return np.asarray(sensors[[self._fingers.index(f) for f in self._holders], :3, 3])

    def _locate(self, seen: ProbeInput, point: Array) -> SurfacePlace:
        pose = seen.object_pose
        return self._surface.locate(np.asarray((point - pose[:3, 3]) @ pose[:3, :3]))

    def _enter(self, phase: ProbePhase, time: float) -> None:
        self.phase, self._since = phase, time

    def _elapsed(self, time: float) -> float:
        return time - self._since
