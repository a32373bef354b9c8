"""Recordings and effects by name, as the command and Python read them; `read` of Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, overload

from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.core.planar.tip import Stiffness
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.joints import JointRecording
    from tactile_dynamics_ros.recording.pushed import PushedRecording

    AnyRecording: TypeAlias = Recording | PushedRecording | JointRecording


@overload
def read(
    *paths: str | Path,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
    stamps: str | None = None,
    urdf: str | Path | None = None,
    model: Literal["held"],
) -> Recording: ...


@overload
def read(
    *paths: str | Path,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
    stamps: str | None = None,
    urdf: str | Path | None = None,
    model: Literal["pushed"],
) -> PushedRecording: ...


@overload
def read(
    *paths: str | Path, urdf: str | Path | None = None, model: Literal["joints"]
) -> JointRecording: ...


@overload
def read(
    *paths: str | Path,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
    stamps: str | None = None,
    urdf: str | Path | None = None,
    model: str = "auto",
) -> AnyRecording: ...


def read(
    *paths: str | Path,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
    stamps: str | None = None,
    urdf: str | Path | None = None,
    model: str = "auto",
) -> AnyRecording:
    """Read a recording, or several of one object as one.

    Args:
        paths: rosbag2 directories, .mcap, .db3 or ROS 1 .bag files.
        remap: recorded topic names and the name, or names, that they stand for.
        namespace: of the hand whose topics are read.
        world_frame: frame of the poses, z up, if it is neither `world` nor a robot's base.
        any_unit: whether accelerations that look like units of g are taken as they are; `diagnose`
            and `explain` then tell the unit.
        stamps: of a held object, "receive" for the times at which messages were received.
        urdf: of the arm whose joint angles, or torques, were recorded.
        model: "held", "pushed" for an object on a support, "joints" for an arm by its torques, or
            "auto", which decides by the topics.

    Returns:
        A `Recording` of a held object, a `PushedRecording`, or a `JointRecording`.

    Raises:
        BadInputError: one cannot be read, no contact pushes, several are not of one object, or a
            tip presses into the outline only if read another way.
    """
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.kinds import recorded_kind
    from tactile_dynamics_ros.recording.pushed import PushedRecording

    if not paths:
        raise BadInputError("read: expected the path of a recording")
    if model not in ("auto", "held", "pushed", "joints"):
        raise BadInputError(f"read: model {model!r}; expected auto, held, pushed or joints")
    kind = recorded_kind(paths[0], remap) if model == "auto" else model
    if kind == "joints":
        return read_joints(paths, urdf, remap)
    if kind == "pushed":
        pushed = [
            read_pushed_recording(path, remap=remap, namespace=namespace, world_frame=world_frame)
            for path in paths
        ]
        return PushedRecording.join([recording for recording, _ in pushed])
    return Recording.join(
        [
            read_recording(
                path,
                remap=remap,
                namespace=namespace,
                world_frame=world_frame,
                any_unit=any_unit,
                stamps=stamps,
                urdf=None if urdf is None else str(urdf),
            )
            for path in paths
        ]
    )


def read_recording(
    path: str | Path,
    *,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
    stamps: str | None = None,
    urdf: str | None = None,
) -> Recording:
    """Read one recording with contacts that push; see `Recording.from_bag`.

    A bag of a robot with none of the topics of a recording is read as `import bag` reads it.

    Args:
        path: of the recording.
        remap: recorded topic names and the name, or names, that they stand for.
        namespace: of the hand whose topics are read.
        world_frame: frame of the poses, z up.
        any_unit: whether accelerations that look like units of g are taken as they are.
        stamps: "receive" for the times at which messages were received.
        urdf: of the arm whose joint angles were recorded.

    Raises:
        BadInputError: it cannot be read, or no contact pushes.
    """
    from tactile_dynamics_ros.recording import Recording
    from tactile_dynamics_ros.recording.bag_files import recorded_types
    from tactile_dynamics_ros.recording.namespaces import is_of_robot

    if not (remap or namespace or world_frame) and is_of_robot(recorded_types(Path(path))):
        from tactile_dynamics_ros.recording.importers.bag import read_robot_bag

        return read_robot_bag(Path(path), stamps, urdf)
    if urdf is not None:
        raise BadInputError(f"--urdf {urdf}: {path} has other poses; leave it out")
    recording = Recording.from_bag(
        path,
        remap=remap,
        namespace=namespace,
        world_frame=world_frame,
        any_unit=any_unit,
        stamps=stamps or "header",
    )
    if not recording.streams.contacts:
        lines = recording.problem_lines()
        known = next((f", as in {line}" for line in lines if "force" in line), "")
        raise BadInputError(
            f"{recording.source}: no contact has a usable force{known}; expected at least one "
            "/contact/<name>/force that pushes"
        )
    return recording


def read_pushed_recording(
    path: str | Path,
    assume: Sequence[str] = (),
    *,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    stiffness: Stiffness | None = None,
) -> tuple[PushedRecording, list[str]]:
    """Read the recording of an object on a support; see `PushedRecording.from_bag`.

    Args:
        path: of the recording.
        assume: conventions as which it is read.
        remap: recorded topic names and the name, or names, that they stand for.
        namespace: of the topics that are read.
        world_frame: frame of the poses, z up.
        stiffness: of a robot without force sensor, whose commands were recorded.

    Returns:
        The recording, and a sentence on each convention and on forces by a stiffness.

    Raises:
        BadInputError: it cannot be read, or the tip presses into the outline only if signs, units
            or axes are read another way.
    """
    from tactile_dynamics_ros.core.planar.misreading import assumed, check_reading
    from tactile_dynamics_ros.recording.pushed import PushedRecording

    recording = PushedRecording.from_bag(
        path, remap=remap, namespace=namespace, world_frame=world_frame, stiffness=stiffness
    )
    notes = []
    if stiffness is not None:
        notes.append(
            "forces are what the tip stays behind its command times the stiffness: all of them "
            f"together are known to {100.0 * recording.streams.force_doubt:.0f} %"
        )
    for name in assume:
        streams, reading = assumed(recording.streams, name)
        notes.append(f"read as {name}: {reading.change}")
        recording = replace(recording, streams=streams)
    check_reading(recording.streams)
    return recording, notes


def read_joints(
    paths: Sequence[str | Path],
    urdf: str | Path | None = None,
    remap: Mapping[str, str | Sequence[str]] | None = None,
) -> JointRecording:
    """Read the recording of an arm's joint torques.

    Args:
        paths: of it; several of one arm with the same payload are joined.
        urdf: of the arm; that in the bag if None.
        remap: of tables: columns, and what they are.

    Raises:
        BadInputError: one cannot be read, or they are of different joints.
    """
    from tactile_dynamics_ros.recording.joints import JointRecording

    return JointRecording.join([JointRecording.read(path, urdf, remap=remap) for path in paths])


def names_of(named: str | Sequence[str | Effect]) -> list[str]:
    """Return the names of effects given as "a,b", by their names, files, or as they are."""
    from tactile_dynamics_ros.core.effects.registry import expand_files

    if isinstance(named, str):
        named = [name.strip() for name in named.split(",") if name.strip()]
    return expand_files([one if isinstance(one, str) else one.name for one in named])


def effects_of(named: str | Sequence[str | Effect]) -> list[Effect]:
    """Return effects given as "a,b", by their names or files of effects, or as they are.

    Raises:
        BadInputError: a name is unknown or given twice, or a file cannot be read.
    """
    from tactile_dynamics_ros.core.effects import create_effect

    named = names_of(named) if isinstance(named, str) else named
    names = [one for one in named if isinstance(one, str)]
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise BadInputError(f"effects {', '.join(names)}: '{min(repeated)}' is named twice")
    return [create_effect(one) if isinstance(one, str) else one for one in named]
