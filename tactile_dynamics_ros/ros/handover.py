"""What a weighing hands over, and what was weighed."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.client import Client
from rclpy.task import Future

from tactile_dynamics_ros.core.configuration import parameter
from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.rigid_body.inertial_parameters import (
    InertialParameters,
    KnownBody,
    com_inertia_jacobian,
)
from tactile_dynamics_ros.core.rigid_body.rotation import rpy_to_matrix
from tactile_dynamics_ros.core.weighing.arm import SerialArm
from tactile_dynamics_ros.recording.bag_writer import write_bag
from tactile_dynamics_ros.recording.recording import Recording
from tactile_dynamics_ros.ros.arm_motion import Taken
from tactile_dynamics_ros.ros.payload_services import Driver, driver_of
from tactile_dynamics_ros.ros.shell import Shell


@dataclass(frozen=True)
class HandoverConfig:
    """To whom the payload is handed, and what is refused."""

    controller: str = parameter("", "of the arm: ur, franka, xarm, doosan or other")
    service: str = parameter("", "name of the driver's service; empty: its usual one")
    maximum_mass: float = parameter(
        0.0, "heaviest payload that the arm may carry; 0 hands nothing over", "kg", 0.0
    )
    mass_share: float = parameter(
        0.05, "widest standard deviation of the mass, as a share of it", "", 1e-4, 1.0
    )
    com_std: float = parameter(
        0.01, "widest standard deviation of the centre of mass along any axis", "m", 1e-5, 1.0
    )
    transition_time: float = parameter(
        1.0, "time over which the controller goes to it, where it can", "s", 0.0, 60.0
    )
    flange_xyz: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "origin of object/pose in the flange", "m"
    )
    flange_rpy: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), "axes of object/pose in the flange, roll, pitch, yaw", "rad"
    )
    patience: float = parameter(5.0, "time for the driver's answer", "s", 0.1, 60.0)


class Call(NamedTuple):
    """A service of the driver, and the client of it."""

    driver: Driver
    client: Client


class Handover:
    """Hands payloads to an arm's controller, unless they are in doubt.

    Args:
        node: that asks the driver.
        config: to whom, and what is refused.
    """

    def __init__(self, node: Shell, config: HandoverConfig) -> None:
        self._node, self.config = node, config
        self._waiting: list[tuple[float, Future]] = []
        self._driver: Driver | None = None
        self._calls: list[Call] = []
        if config.controller:
            driver = self._driver = driver_of(config.controller)
            name = config.service or driver.service
            folder = name.rpartition("/")[0]
            # In a group of its own: the answer comes while the call that asked for it still runs.
            self._group = MutuallyExclusiveCallbackGroup()
            self._calls = [self._call(one, f"{folder}/{one.service}") for one in driver.before]
            self._calls.append(self._call(driver, name))
            self._calls += [self._call(one, f"{folder}/{one.service}") for one in driver.after]
        node.every(0.1, self._give_up, always=True)

    @property
    def takes_tool(self) -> bool:
        """Whether the controller has to be given the tool together with the load."""
        return self._driver is None or self._driver.takes_tool

    @property
    def clients(self) -> list[Client]:
        """The services of the driver that are asked, in their order."""
        return [call.client for call in self._calls]

    def require_controller(self) -> Driver:
        """Return the driver.

        Raises:
            NotIdentifiableError: none is named.
        """
        if self._driver is None:
            raise NotIdentifiableError("nothing handed over: parameter controller is not set")
        return self._driver

    async def give(self, body: KnownBody) -> tuple[bool, str]:
        """Hand a body over; return whether the controller has taken it, and a sentence.

        Args:
            body: in the frame of the estimate.

        Raises:
            NotIdentifiableError: it is not to be handed over, or the driver is not there.
        """
        payload, known = self.payload(body)
        self._require_driver()
        taken, said = False, ""
        assert self._driver is not None
        for number, call in enumerate(self._calls):
            answer = await self._ask(call, payload, known)
            taken, said = _said(call, answer, _describe(payload, known))
            if not taken and number >= len(self._driver.before):
                break
        return taken, said

    def payload(self, known_body: KnownBody) -> tuple[InertialParameters, bool]:
        """Return the payload in the flange's frame, and whether its inertia is known.

        Args:
            known_body: in the frame of the estimate.

        Raises:
            NotIdentifiableError: it is not to be handed over, and why.
        """
        config, driver = self.config, self.require_controller()
        to_com = com_inertia_jacobian(known_body.phi)
        std = np.sqrt(np.diag(to_com @ known_body.covariance @ to_com.T))
        body = InertialParameters.from_dynamic_parameters(known_body.phi)
        open_ones = [name for name in known_body.undetermined if not name.startswith("inertia")]
        reasons = [f"{name} is undetermined" for name in open_ones]
        if std[0] > config.mass_share * body.mass:
            reasons.append(f"mass {body.mass:.3g} ± {std[0]:.2g} kg is wider than mass_share")
        if std[1:4].max() > config.com_std:
            reasons.append(f"centre of mass ± {1e3 * std[1:4].max():.2g} mm is wider than com_std")
        if body.mass > config.maximum_mass:
            reasons.append(
                f"{body.mass:.3g} kg is more than maximum_mass = {config.maximum_mass:g} kg"
            )
        moments = np.diag(body.inertia_com)
        known = not any(name.startswith("inertia") for name in known_body.undetermined)
        known = known and bool(np.all(std[[4, 6, 9]] < moments))
        if driver.needs_inertia and not known:
            reasons.append("its inertia is not known, and this controller needs it")
        if reasons:
            raise NotIdentifiableError(f"nothing handed over: {'; '.join(reasons)}")
        turn = rpy_to_matrix(np.array(config.flange_rpy))
        place = turn @ body.com + np.array(config.flange_xyz)
        return InertialParameters(body.mass, place, turn @ body.inertia_com @ turn.T), known

    def _call(self, driver: Driver, name: str) -> Call:
        return Call(
            driver, self._node.create_client(driver.load(), name, callback_group=self._group)
        )

    def _require_driver(self) -> None:
        """Check that all services of the driver are there, before any is called.

        Raises:
            NotIdentifiableError: one is not.
        """
        for call in self._calls:
            if not call.client.service_is_ready():
                name = call.client.srv_name
                text = f"nothing handed over: {name} is not there; is the driver running?"
                raise NotIdentifiableError(text)

    async def _ask(self, call: Call, body: InertialParameters, known: bool) -> Any:
        """Return the driver's answer; None if none comes in time.

        Args:
            call: what is asked.
            body: the payload.
            known: whether its inertia is known.
        """
        request = call.client.srv_type.Request()
        call.driver.fill(request, body, known, self.config.transition_time)
        answer = call.client.call_async(request)
        self._waiting.append((time.monotonic() + self.config.patience, answer))
        return await answer

    def _give_up(self) -> None:
        """End waiting for answers that do not come."""
        now = time.monotonic()
        for deadline, answer in self._waiting:
            if now > deadline and not answer.done():
                answer.set_result(None)
        self._waiting = [entry for entry in self._waiting if not entry[1].done()]


def _said(call: Call, response: Any, text: str) -> tuple[bool, str]:
    """Return whether the driver has taken the payload, and a sentence."""
    if response is None:
        return False, f"{call.client.srv_name} did not answer; it may have {text}"
    taken, said = call.driver.said(response)
    return taken, f"handed over: {text}" if taken else f"refused by the driver: {said or text}"


def _describe(body: InertialParameters, known: bool) -> str:
    centre = ", ".join(f"{1e3 * value:.1f}" for value in body.com)
    text = f"{body.mass:.4g} kg, centre ({centre}) mm in the flange's frame"
    return text if known else f"{text}, without inertia"


COMMAND = (sys.executable, "-P", "-m", "tactile_dynamics_ros.cli.main")


@dataclass(frozen=True)
class Weighed:
    """Answers about one body.

    Attributes:
        document: what `estimate --json` prints.
        file: what `estimate --save` wrote.
        doubts: why the numbers are not to be used; empty if nothing speaks against them.
    """

    document: dict[str, Any]
    file: Path
    doubts: tuple[str, ...]


def new_folder(parent: str) -> Path:
    """Return a new folder, made, for what one weighing leaves.

    Raises:
        BadInputError: it cannot be made.
    """
    folder = Path(parent) / f"{datetime.now():%Y%m%d-%H%M%S}"
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise BadInputError(f"folder {folder} cannot be made: {error.strerror}") from error
    return folder


def keep(taken: Taken, arm: SerialArm, sign: float, path: Path) -> Path:
    """Write a motion's measurements as a recording of one object on a wrist sensor.

    The object's frame is the sensor's; the arm's joints say how it moves.

    Args:
        taken: during the motion.
        arm: whose tip is the sensor.
        sign: -1 where the sensor reads what acts on it, 1 where it reads what it applies.
        path: file to write.

    Raises:
        BadInputError: too little was measured.
    """
    if len(taken.joint_time) < 2 or len(taken.wrench_time) < 2:
        raise BadInputError("weighing: hardly any joints or wrenches came during the motion")
    pose, wrench = arm.tip_poses(np.array(taken.positions)), sign * np.array(taken.wrenches)
    recording = Recording.from_arrays(
        {
            "wrist": {
                "time": np.array(taken.wrench_time),
                "force": wrench[:, :3],
                "torque": wrench[:, 3:],
                "position": np.zeros(3),
                "rotation": np.eye(3),
            }
        },
        {
            "time": np.array(taken.joint_time),
            "position": pose[:, :3, 3],
            "rotation": pose[:, :3, :3],
        },
        contact_frame="object",
        source=str(path),
    )
    return write_bag(recording.streams, path)


def ask(files: Sequence[Path], file: Path, tool: Path | None = None) -> Weighed:
    """Estimate and compare, as a person does with the command.

    Args:
        files: recordings of the same body.
        file: where its numbers are kept.
        tool: file of what is carried as well and taken out; None for nothing.

    Raises:
        NotIdentifiableError: the recordings do not tell the mass, or the model does not fit.
    """
    document = save(files, file, tool)
    compared = _verb("compare", *map(str, files))
    doubts = (
        [] if compared["adequate"] else [f"the model does not fit (p = {compared['p_value']:.1g})"]
    )
    if document["undetermined"]:
        doubts.append(f"undetermined: {', '.join(document['undetermined'])}")
    return Weighed(document, file, tuple(doubts))


def save(files: Sequence[Path], file: Path, tool: Path | None = None) -> dict[str, Any]:
    """Estimate a body and keep its numbers; arguments as of `ask`. Return the document."""
    taken_out = [] if tool is None else ["--tool", str(tool)]
    return _verb("estimate", *map(str, files), *taken_out, "--save", str(file))


def advise(file: Path) -> list[str]:
    """Return what `check` would record as well, one sentence each."""
    advice: list[str] = _verb("check", str(file))["advice"]
    return advice


def _verb(*words: str) -> dict[str, Any]:
    done = subprocess.run([*COMMAND, *words, "--json"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines()
        said = lines[-1].removeprefix("error: ") if lines else "it ended without a word"
        raise NotIdentifiableError(f"{words[0]} {' '.join(words[1:2])}: {said}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document
