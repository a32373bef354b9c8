"""A mapping for a load on one sensor: wrench and pose of a wrist, or a table of static poses."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.recording.importers.fields import UNITS
from tactile_dynamics_ros.recording.importers.guess.answers import Answers, Question
from tactile_dynamics_ros.recording.importers.guess.geometry import Mounting, scale_of
from tactile_dynamics_ros.recording.importers.guess.groups import Group
from tactile_dynamics_ros.recording.importers.guess.orientations import (
    Judged,
    Reading,
    choose_reading,
    readings_of,
)
from tactile_dynamics_ros.recording.importers.guess.sources import (
    Source,
    beside,
    choose_group,
    rows_are_separate,
    rows_jump,
)
from tactile_dynamics_ros.recording.importers.guess.times import TimeColumn, find_change
from tactile_dynamics_ros.recording.importers.guess.torques import (
    lever_of,
    read_acceleration,
    torque_size,
)
from tactile_dynamics_ros.recording.importers.guess.weight import Measured, Windows

_LONGEST_LEVER, _SURE_LEVER = 0.6, 1.5
"""Distance, m, of a load's centre of mass from its sensor that is usual, and one that is none:
torques that ask for more are in smaller units, and between them it is asked."""

_SAME_UNIT = 0.05
"""Share by which the first moment of torques in a unit may differ from what turning shows in
the forces: N cm and lbf in are 12 % apart."""
_OTHER_LOAD = 0.02
"""Share by which the mass steps where it is said that the load changes: a zero that steps alone
leaves 0.3 %, and who hands over something lighter is told of the zero."""


@dataclass(frozen=True)
class WristGuess:
    """Builds the mapping of one sensor and one pose.

    Attributes:
        poses: table of the orientation.
        forces: table of the force; may be the same.
        answers: to questions.
        note: takes label and text of what was understood.
    """

    poses: Source
    forces: Source
    answers: Answers
    note: Callable[[str, str], None]

    def mapping(self) -> dict[str, Any]:
        """Return the mapping.

        Raises:
            Question: neither names nor numbers tell something.
        """
        turn = self.poses.turn(self.answers)
        force = self._force()
        torque = beside(self.forces.groups.torque, force)
        if self.poses.time is None or self.forces.time is None:
            return self._without_time(turn, force, torque)
        position = self.poses.position(turn, self.answers)
        judged, timed = self._settle_clock(turn, position, force, torque)
        timed._note_change(judged)
        pose_time = timed.poses.time
        if pose_time is not None and rows_are_separate(pose_time, judged.rotation):
            return timed._static(force, torque, judged)
        return timed._moving(position, force, torque, judged)

    def _force_unit(self) -> str:
        return self.answers.get("force_unit") or self._force().unit or "N"

    def _force(self) -> Group:
        groups = self.forces.groups.force
        if len(groups) == 1:
            return groups[0]
        return choose_group(groups, "wrench", "several forces are in the table", self.answers)

    def _settle_clock(
        self, turn: Group, position: Group | None, force: Group, torque: Group | None
    ) -> tuple[Judged, WristGuess]:
        """Return the reading that agrees, and the guess with clocks in the units that agree.

        Raises:
            Question: the units of time or length contradict each other.
        """
        assert self.poses.time is not None and self.forces.time is not None
        tried = []
        for unit in self.poses.time.units:
            timed = self._with_unit(unit)
            timed._require_overlap()
            tried.append((timed._judge(turn, position, force, torque), timed))
        if len(tried) > 1:
            agreeing = [p for p in tried if p[0].agrees and p[0].weighing.agreement is not None]
            if len(agreeing) != 1:
                units = self.poses.time.units
                column = self.poses.time.columns[0]
                self.answers.choose(
                    "time_unit", units, f"column '{column}' may be in {' or in '.join(units)}"
                )
            tried = agreeing
        judged, timed = tried[0]
        if position is not None:
            _require_agreement(judged)
        timed.note("time", timed.poses.describe_time())
        if timed.forces is not timed.poses:
            timed.note("time of forces", timed.forces.describe_time())
        return judged, timed

    def _with_unit(self, unit: str) -> WristGuess:
        """Return the guess with the clock in one of its units."""
        assert self.poses.time is not None and self.forces.time is not None
        poses = replace(self.poses, time=_read_as(self.poses.time, unit))
        if self.forces is self.poses:
            return replace(self, poses=poses, forces=poses)
        return replace(
            self,
            poses=poses,
            forces=replace(self.forces, time=_read_as(self.forces.time, unit)),
        )

    def _require_overlap(self) -> None:
        assert self.poses.time is not None and self.forces.time is not None
        pose, force = self.poses.time.values, self.forces.time.values
        if pose[-1] < force[0] or force[-1] < pose[0]:
            raise Question(
                f"the poses last from {pose[0]:.6g} to {pose[-1]:.6g} s and the forces from "
                f"{force[0]:.6g} to {force[-1]:.6g} s, so that they do not overlap: which clock is "
                "right? Name columns, units and delay in a yaml file (docs/recordings.md)"
            )

    def _judge(
        self, turn: Group, position: Group | None, force: Group, torque: Group | None
    ) -> Judged:
        """Return the reading of the orientation that agrees with gravity."""
        read = self.forces.table.columns(*force.columns)
        about = None if torque is None else self.forces.table.columns(*torque.columns)
        place = None
        if position is not None:
            factor = UNITS["length"][self.poses.length_unit(position, self.answers)]
            place = factor * self.poses.table.columns(*position.columns)
        clock = [None if s.time is None else s.time.values for s in (self.poses, self.forces)]

        windows, changes = Windows(), list[float | None]()

        def measured_under(reading: Reading, rotation: Array) -> Measured:
            put = place
            if put is not None and reading.inside:
                put = -(rotation @ put[..., None])[..., 0]
            found = Measured(read, clock[1], rotation, clock[0], put, about, windows=windows)
            if not changes:
                changes.append(find_change(found))
            return replace(found, change=changes[0])

        readings = readings_of(turn, self.poses.table)
        readings = [r for r in readings if place is not None or not r.inside]
        return choose_reading(readings, self.poses.table, measured_under, self.answers, force.label)

    def _moving(
        self, position: Group | None, force: Group, torque: Group | None, judged: Judged
    ) -> dict[str, Any]:
        """Return the mapping of samples with stamps."""
        assert self.forces.time is not None
        motion = self._motion(position, judged)
        contact = {**self.forces.place, "time": self.forces.time.entry}
        contact |= self._wrench(judged, force, torque)
        if judged.weighing.axes == "sensor":
            frame = "object"
            contact["position"] = [0.0, 0.0, 0.0]
            contact["rotation"] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        else:
            frame = "world"
            contact["pose"] = self._place(motion)
        found = {"contact_frame": frame, **motion, "contacts": {"wrist": contact}}
        return found | self._mounting(judged).world()

    def _place(self, motion: dict[str, Any]) -> dict[str, Any]:
        """Return where a sensor is whose forces are in axes of the world.

        Raises:
            Question: no position is known.
        """
        if "object_pose" not in motion:
            raise Question(
                "the forces fit in the axes of the world only, and no position is in the table: "
                "name both in a yaml file (docs/recordings.md)"
            )
        return copy.deepcopy(dict(motion["object_pose"]))

    def _motion(self, position: Group | None, judged: Judged) -> dict[str, Any]:
        """Return the section of the object's pose, or of its IMU where no position is known."""
        groups = self.poses.groups.acceleration
        if position is not None or not groups:
            return {"object_pose": self._pose(position, judged)}
        group = groups[0]
        if len(groups) > 1:
            lacking = "no position is in the table"
            group = choose_group(groups, "acceleration", lacking, self.answers)
        entry = read_acceleration(group, self.poses.table, judged.rotation)
        self.note("position", "none")
        self.note("acceleration", f"{group.label} in {entry['unit']}, of an IMU in these axes")
        assert self.poses.time is not None
        section: dict[str, Any] = {**self.poses.place, "time": self.poses.time.entry}
        return {"object_imu": section | self._orientation(judged) | {"specific_force": entry}}

    def _mounting(self, judged: Judged) -> Mounting:
        return Mounting.of(judged.scene, judged.weighing)

    def _signs(self, mounting: Mounting) -> tuple[Array, Array]:
        """Signs (3,) of forces and of torques, turned round if the user says what is read."""
        given, found = self.answers.get("reads"), np.sign(np.sum(mounting.force))
        if given is None:
            return mounting.force, mounting.torque
        self.answers.choose("reads", ("load", "object"), "")
        factor = found if given == "object" else -found
        return factor * mounting.force, factor * mounting.torque

    def _note_change(self, judged: Judged) -> None:
        """Say when something changes at once, and what the load was before and is after."""
        change, sides = judged.scene.measured.change, judged.weighing.sides
        if change is None or self.forces.time is None:
            return
        masses, factor = [abs(side.mass) for side in sides], UNITS["force"][self._force_unit()]
        steps = factor * (sides[1].bias - sides[0].bias)
        other = np.ptp(masses) > _OTHER_LOAD * min(masses)
        what = (
            " and then ".join(f"{factor * mass:.3g} kg" for mass in masses)
            if other
            else (f"the zero of the sensor steps by ({', '.join(f'{s:.3g}' for s in steps)}) N")
        )
        time = change - float(self.forces.time.values[0])
        self.note("change", f"something changes at once at t = {time:.2f} s: {what}")

    def _pose(self, position: Group | None, judged: Judged) -> dict[str, Any]:
        """Return the section of the object's pose."""
        assert self.poses.time is not None
        section: dict[str, Any] = {**self.poses.place, "time": self.poses.time.entry}
        if position is None:
            section["position"] = {"constant": [0.0, 0.0, 0.0]}
            self.note("position", "none: taken to stay at one place")
        else:
            unit = self.poses.length_unit(position, self.answers)
            section["position"] = {"columns": list(position.columns), "unit": unit}
            if judged.reading.inside:
                section["position"]["inverse"] = True
            self.note("position", f"{position.label} in {unit}")
        section |= self._orientation(judged)
        return section

    def _orientation(self, judged: Judged) -> dict[str, Any]:
        columns = judged.reading.entry["columns"]
        self.note("orientation", f"{columns[0]} .. {columns[-1]}: {judged.reading.label}")
        return {judged.reading.key: judged.reading.entry}

    def _wrench(self, judged: Judged, force: Group, torque: Group | None) -> dict[str, Any]:
        """Return the fields of force and torque, turned to what acts on the object."""
        unit = self._force_unit()
        unit = Answers({"force_unit": unit}).choose("force_unit", UNITS["force"], "")
        mounting = self._mounting(judged)
        signs = self._signs(mounting)
        mass = abs(judged.weighing.mass) * UNITS["force"][unit]
        about = f"; about {mass:.3g} kg" if judged.weighing.seen else ""
        reads = (
            "acts on the object" if signs[0][0] > 0.0 else "is the load on the sensor, sign turned"
        )
        self.note(
            "force",
            f"{force.label} in {unit}, axes of the {judged.weighing.axes}; it {reads}{about}",
        )
        fields: dict[str, Any] = {
            "force": {"columns": list(force.columns), "unit": unit, "scale": scale_of(signs[0])}
        }
        if torque is not None:
            found = self._torque_unit(judged, torque, UNITS["force"][unit])
            self.note("torque", f"{torque.label} in {found}, about the sensor's origin")
            columns = list(torque.columns)
            fields["torque"] = {"columns": columns, "unit": found, "scale": scale_of(signs[1])}
        for label, text in mounting.words.items():
            self.note(label, text)
        return fields | mounting.sensor()

    def _torque_unit(self, judged: Judged, torque: Group, force_factor: float) -> str:
        """Return the unit of the torque.

        Raises:
            Question: the load would be farther away than usual, but not absurdly far.
        """
        if self.answers.get("torque_unit") is not None:
            return self.answers.choose("torque_unit", UNITS["torque"], "")
        if torque.unit in UNITS["torque"]:
            return torque.unit
        told = torque_size(judged.scene, judged.weighing)
        if told is not None:
            size, std = (force_factor * part for part in told)
            near = max(_SAME_UNIT * size, 3.0 * std)
            fitting = {f: u for u, f in reversed(UNITS["torque"].items()) if abs(f - size) < near}
            if len(fitting) == 1:
                return next(iter(fitting.values()))
        found = lever_of(judged.scene, judged.weighing)
        if found is None:
            return "N m"
        lever = found / force_factor
        if lever <= _LONGEST_LEVER:
            return "N m"
        if lever > _SURE_LEVER and lever * UNITS["torque"]["N mm"] <= _LONGEST_LEVER:
            return "N mm"
        return self.answers.choose(
            "torque_unit",
            ("N m", "N mm", "N cm"),
            f"in N m the torques of {torque.label} put the load {lever:.2g} m from the sensor",
        )

    def _without_time(self, turn: Group, force: Group, torque: Group | None) -> dict[str, Any]:
        """Return the mapping of a table in which no column is time.

        Raises:
            Question: the rows seem to follow each other in time.
        """
        if self.forces is not self.poses:
            raise Question("no column of one table is a time; name it with --say time=COLUMN")
        rate = self.answers.get("rate_hz")
        if rate is not None:
            stamps = np.arange(len(self.poses.table.values)) / float(rate)
            clock = TimeColumn({"rate_hz": float(rate)}, ("s",), stamps, ("row",))
            timed = replace(self.poses, time=clock)
            return replace(self, poses=timed, forces=timed).mapping()
        judged = self._judge(turn, None, force, torque)
        if self.answers.get("time") != "none" and not rows_jump(judged.rotation):
            raise Question(
                "no column is a time, and the rows follow each other closely: how many are there "
                "per second? Answer with --say rate_hz=100, or --say time=none if each row is a "
                "pose of its own"
            )
        return self._static(force, torque, judged)

    def _static(self, force: Group, torque: Group | None, judged: Judged) -> dict[str, Any]:
        """Return the mapping of a table of static poses."""
        rows = len(self.poses.table.values)
        self.note("rows", f"{rows} static poses, one per row, whatever their times")
        section: dict[str, Any] = dict(self.poses.place)
        section |= self._orientation(judged)
        section |= self._wrench(judged, force, torque)
        found: dict[str, Any] = {"static_poses": section}
        if judged.weighing.axes == "world":
            found["contact_frame"] = "world"
        return found | self._mounting(judged).world()


def _read_as(time: TimeColumn, unit: str) -> TimeColumn:
    return time.read_as(unit) if len(time.units) > 1 and unit in time.units else time


def _require_agreement(judged: Judged) -> None:
    """Check that weight and acceleration tell the same mass, where both are seen.

    Raises:
        Question: they do not.
    """
    ratio = judged.weighing.agreement
    if not judged.agrees:
        raise Question(
            f"weight and acceleration tell masses that differ by a factor of {ratio:.2g}: the "
            "unit of time or of the position is another one; "
            "answer with --say time_unit=ms (or s, us, ns) or --say position_unit=mm (or cm, m)"
        )
