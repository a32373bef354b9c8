"""The verbs of the command as functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis, Explanation
from tactile_dynamics_ros.api.estimates import Estimate
from tactile_dynamics_ros.api.questions import question_held
from tactile_dynamics_ros.api.reading import effects_of, read_recording
from tactile_dynamics_ros.api.shapes import Shape
from tactile_dynamics_ros.core.errors import BadInputError

if TYPE_CHECKING:
    from tactile_dynamics_ros.api.checks import Check
    from tactile_dynamics_ros.core.effects.effect import Effect
    from tactile_dynamics_ros.recording import Recording

    Effects = str | Sequence[str | Effect]


def read(
    *paths: str | Path,
    remap: Mapping[str, str | Sequence[str]] | None = None,
    namespace: str | None = None,
    world_frame: str | None = None,
    any_unit: bool = False,
) -> Recording:
    """Read a recording, or several of one object as one.

    Args:
        paths: rosbag2 directories, .mcap, .db3 or ROS 1 .bag files.
        remap: recorded topic names and the name, or names, that they stand for.
        namespace: of the hand whose topics are read.
        world_frame: frame of the poses, z up, if it is neither `world` nor a robot's base.
        any_unit: whether accelerations that look like units of g are taken as they are; `diagnose`
            and `explain` then tell the unit.

    Raises:
        BadInputError: one cannot be read, or no contact pushes.
    """
    from tactile_dynamics_ros.recording import Recording

    if not paths:
        raise BadInputError("read: expected the path of a recording")
    return Recording.join(
        [
            read_recording(
                path,
                remap=remap,
                namespace=namespace,
                world_frame=world_frame,
                any_unit=any_unit,
            )
            for path in paths
        ]
    )


def check(recording: Recording, goal: float = 0.1) -> Check:
    """Tell whether a recording is fit for an estimate, and what to record as well.

    Args:
        recording: what was measured so far.
        goal: wanted standard deviation over the size of a parameter.

    Raises:
        BadInputError: contacts and motion do not overlap.
        NotIdentifiableError: the iteration diverged.
    """
    from tactile_dynamics_ros.api.checks import check_recording

    return check_recording(recording, goal)


def estimate(
    recording: Recording,
    effects: Effects = (),
    *,
    tool: str | Path | None = None,
    prior: str | Path | None = None,
    wrist: Recording | None = None,
    hand: str | Path | None = None,
) -> Estimate:
    """Estimate mass, centre of mass and inertia of a held object, and the parameters of effects.

    Args:
        recording: what was measured.
        effects: of the model: "a,b", names, or `Effect`s.
        tool: file of what was carried as well, such as a gripper: a URDF, or one of
            `Estimate.save`.
        prior: file of `Estimate.save` of the same object, from earlier recordings.
        wrist: of `read_wrist`, from the same bag: what the wrist carried meanwhile.
        hand: file of `Estimate.save` of the hand alone, from such a recording without an object.

    Raises:
        BadInputError: contacts and motion do not overlap, an effect is unknown, a file is no
            body's, or one of wrist and hand is missing.
        NotIdentifiableError: the iteration diverged.
    """
    from tactile_dynamics_ros.core.inertia.estimate import estimate as fit
    from tactile_dynamics_ros.recording.body_files import read_body

    if (wrist is None) != (hand is None):
        raise BadInputError("wrist: expected the recording of the wrist and the file of the hand")
    known = [None if path is None else read_body(path) for path in (tool, prior)]
    share = None
    if wrist is not None and hand is not None:
        from tactile_dynamics_ros.api.wrist import WristShare

        share = WristShare(recording, wrist, read_body(hand))
    return Estimate(recording, fit(recording, effects_of(effects)), *known, share)


def compare(recording: Recording, effects: Effects = ()) -> Comparison:
    """Tell how far the model is from a recording, and where it fails.

    Raises:
        BadInputError: contacts and motion do not overlap, or an effect is unknown.
    """
    return Comparison.of(question_held(recording, effects_of(effects)))


def diagnose(recording: Recording, effects: Effects = ()) -> Diagnosis:
    """Tell which effect is missing from the model of a recording.

    Raises:
        BadInputError: contacts and motion do not overlap, or an effect is unknown.
    """
    return Diagnosis.of(question_held(recording, effects_of(effects)))


def explain(recording: Recording, effects: Effects = ()) -> Explanation:
    """Add missing effects one by one until the model is adequate or nothing helps.

    Raises:
        BadInputError: contacts and motion do not overlap, or an effect is unknown.
    """
    return Explanation.of(question_held(recording, effects_of(effects)))


def shape(
    *clouds: str | Path,
    support: float | str | None = "auto",
    unit: str | None = None,
    number: int = 1,
    align: bool = False,
) -> Shape:
    """Describe an object on a table by superquadrics.

    Args:
        clouds: PLY, PCD, text or npz files in one frame, z up.
        support: height of the table, m; "auto" takes it from the points, None knows nothing of it.
        unit: of the clouds, "m" or "mm"; guessed if None.
        number: of the object; the largest is 1.
        align: whether several clouds are aligned to each other.

    Raises:
        BadInputError: a cloud cannot be read, or there is no such object.
    """
    from tactile_dynamics_ros.core.shape.superquadric.scene import read_scene
    from tactile_dynamics_ros.recording.clouds import read_clouds

    cloud = read_clouds([Path(path) for path in clouds], unit)
    look = cloud.look if len(clouds) > 1 and align else None
    scene = read_scene(cloud.points, support, depth=cloud.depth, look=look)
    if not 1 <= number <= len(scene.objects):
        raise BadInputError(
            f"--object {number}: {len(scene.objects)} objects were found, the largest is 1"
        )
    return Shape(scene, number, tuple(cloud.remarks))
