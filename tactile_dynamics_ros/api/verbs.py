"""The verbs of the command as functions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, overload

from tactile_dynamics_ros.api.discrepancies import Comparison, Diagnosis, Explanation
from tactile_dynamics_ros.api.estimates import Estimate
from tactile_dynamics_ros.api.questions import (
    Question,
    question_held,
    question_joints,
    question_pushed,
)
from tactile_dynamics_ros.api.reading import effects_of, names_of, read
from tactile_dynamics_ros.api.shapes import Shape
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.joints import JointRecording
from tactile_dynamics_ros.recording.pushed import PushedRecording

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tactile_dynamics_ros.api.checks import Check
    from tactile_dynamics_ros.api.joint_checks import JointCheck
    from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints
    from tactile_dynamics_ros.api.pushed_checks import PushedCheck
    from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
    from tactile_dynamics_ros.core.effects.effect import Effect

    Effects: TypeAlias = str | Sequence[str | Effect]
    AnyRecording: TypeAlias = Recording | PushedRecording | JointRecording
    Source: TypeAlias = AnyRecording | str | Path


def _recorded(source: Source, any_unit: bool = False) -> AnyRecording:
    """Return a recording, read if it is given by its path.

    Args:
        source: recording or path of one.
        any_unit: see `read`.

    Raises:
        BadInputError: it cannot be read, or is neither.
    """
    if isinstance(source, Recording | PushedRecording | JointRecording):
        return source
    if isinstance(source, str | Path):
        return read(source, any_unit=any_unit)
    raise BadInputError(
        f"recording: {type(source).__name__}; expected a path, or what `read` returns (it takes "
        "several paths)"
    )


@overload
def check(recording: Recording, goal: float = 0.1) -> Check: ...


@overload
def check(recording: PushedRecording, goal: float = 0.1) -> PushedCheck: ...


@overload
def check(recording: JointRecording, goal: float = 0.1) -> JointCheck: ...


@overload
def check(recording: Source, goal: float = 0.1) -> Check | PushedCheck | JointCheck: ...


def check(recording: Source, goal: float = 0.1) -> Check | PushedCheck | JointCheck:
    """Tell whether a recording is fit for an estimate, and what to record as well.

    Args:
        recording: what was measured so far, or the path of the recording.
        goal: wanted standard deviation over the size of a parameter.

    Raises:
        BadInputError: the path cannot be read, or contacts and motion do not overlap.
        NotIdentifiableError: the iteration diverged, or a pushed object slides too little.
    """
    recorded = _recorded(recording)
    if isinstance(recorded, PushedRecording):
        from tactile_dynamics_ros.api.pushed_checks import check_pushes

        return check_pushes(recorded, goal)
    if isinstance(recorded, JointRecording):
        from tactile_dynamics_ros.api.joint_checks import check_joints

        return check_joints(recorded, goal)
    from tactile_dynamics_ros.api.checks import check_recording

    return check_recording(recorded, goal)


@overload
def estimate(
    recording: Recording,
    effects: Effects = (),
    *,
    tool: str | Path | None = None,
    prior: str | Path | None = None,
    wrist: Recording | str | Path | None = None,
    hand: str | Path | None = None,
    shape: str | Path | None = None,
    shape_pose: NDArray[np.float64] | None = None,
) -> Estimate: ...


@overload
def estimate(
    recording: PushedRecording, effects: Effects = (), *, prior: str | Path | None = None
) -> EstimateOfPushes: ...


@overload
def estimate(
    recording: JointRecording,
    effects: Effects = (),
    *,
    without: JointRecording | str | Path | None = None,
    known_load: float | None = None,
) -> EstimateOfJoints: ...


@overload
def estimate(
    recording: Source,
    effects: Effects = (),
    *,
    tool: str | Path | None = None,
    prior: str | Path | None = None,
    wrist: Recording | str | Path | None = None,
    hand: str | Path | None = None,
    without: JointRecording | str | Path | None = None,
    known_load: float | None = None,
    shape: str | Path | None = None,
    shape_pose: NDArray[np.float64] | None = None,
) -> Estimate | EstimateOfPushes | EstimateOfJoints: ...


def estimate(
    recording: Source,
    effects: Effects = (),
    *,
    tool: str | Path | None = None,
    prior: str | Path | None = None,
    wrist: Recording | str | Path | None = None,
    hand: str | Path | None = None,
    without: JointRecording | str | Path | None = None,
    known_load: float | None = None,
    shape: str | Path | None = None,
    shape_pose: NDArray[np.float64] | None = None,
) -> Estimate | EstimateOfPushes | EstimateOfJoints:
    """Estimate a held object, a pushed one, or payload and friction of an arm by its torques.

    Args:
        recording: what was measured, or the path of the recording.
        effects: of the model: "a,b", names, or, of held objects, `Effect`s.
        tool: file of what was carried as well, such as a gripper: a URDF, or one of
            `Estimate.save`.
        prior: file of `Estimate.save` of the same object, from earlier recordings.
        wrist: of `read_wrist`, from the same bag: what the wrist carried meanwhile; or the path of
            the bag, with the default robot.
        hand: file of `Estimate.save` of the hand alone, from such a recording without an object.
        without: of an arm by its torques: the recording without the payload, or its path.
        known_load: likewise: the payload's mass, kg, if it was weighed; tells gains of drives.
        shape: mesh, cloud, yaml file of the object or JSON of `shape`: its inertia is then one of a
            body that fills it, with a density whose spread the recording decides.
        shape_pose: (4, 4) of the shape's axes in the frame of the object's pose; the same if None.

    Raises:
        BadInputError: a path cannot be read, contacts and motion do not overlap, an effect is
            unknown, a file is no body's, one of wrist and hand is missing, any of them, a shape or
            a tool is given for a pushed object, or a shape beside any of them.
        NotIdentifiableError: the iteration diverged, or a pushed object slides too little.
    """
    recorded = _recorded(recording)
    if isinstance(recorded, JointRecording):
        if tool or wrist or hand or prior:
            raise BadInputError("tool, wrist, hand, prior: not for an arm by its torques")
        from tactile_dynamics_ros.api.joint_estimates import EstimateOfJoints

        return EstimateOfJoints.of(recorded, names_of(effects), without, known_load)
    if without is not None or known_load is not None:
        raise BadInputError("without, known_load: for an arm by its joint torques; leave them out")
    if isinstance(recorded, PushedRecording):
        if tool or wrist or hand or shape:
            raise BadInputError(
                "tool, wrist, hand, shape: not for an object on a support; leave them out"
            )
        return _estimate_pushed(recorded, effects, prior)
    from tactile_dynamics_ros.core.inertia.estimate import estimate as fit
    from tactile_dynamics_ros.recording.yaml_files import read_body

    if shape is not None:
        if tool or prior or wrist or hand:
            raise BadInputError("shape: of the recording alone; leave out tool, prior and wrist")
        return _with_shape(recorded, effects, shape, shape_pose)
    if (wrist is None) != (hand is None):
        raise BadInputError("wrist: expected the recording of the wrist and the file of the hand")
    carried, known = (None if path is None else read_body(path) for path in (tool, prior))
    share = None
    if wrist is not None and hand is not None:
        from tactile_dynamics_ros.api.wrist import WristShare, read_wrist

        measured = read_wrist(wrist) if isinstance(wrist, str | Path) else wrist
        share = WristShare(recorded, measured, read_body(hand))
    return Estimate(recorded, fit(recorded, effects_of(effects)), carried, known, share)


def _with_shape(
    recording: Recording,
    effects: Effects,
    shape: str | Path,
    pose: NDArray[np.float64] | None,
) -> Estimate:
    from tactile_dynamics_ros.core.inertia.estimate import estimate as fit
    from tactile_dynamics_ros.core.inertia.shape_prior import ShapePrior
    from tactile_dynamics_ros.recording.shape_files import read_solid

    known = ShapePrior(read_solid(shape, pose))
    return Estimate(recording, fit(recording, effects_of(effects), shape=known), shape=known)


def _estimate_pushed(
    recording: PushedRecording, effects: Effects, prior: str | Path | None
) -> EstimateOfPushes:
    from tactile_dynamics_ros.api.pushed_estimates import EstimateOfPushes
    from tactile_dynamics_ros.recording.pushed.known_files import read_known

    known = None if prior is None else read_known(prior)
    return EstimateOfPushes.of(recording, names_of(effects), known)


def _question(recording: AnyRecording, effects: Effects) -> Question:
    if isinstance(recording, JointRecording):
        return question_joints(recording, names_of(effects))
    if isinstance(recording, PushedRecording):
        return question_pushed(recording, names_of(effects))
    return question_held(recording, effects_of(effects))


def compare(recording: Source, effects: Effects = ()) -> Comparison:
    """Tell how far the model is from a recording, and where it fails.

    Args:
        recording: what was measured, or the path of the recording.
        effects: of the model: "a,b", names, or, of held objects, `Effect`s.

    Raises:
        BadInputError: the path cannot be read, contacts and motion do not overlap, or an effect is
            unknown.
    """
    return Comparison.of(_question(_recorded(recording), effects))


def diagnose(recording: Source, effects: Effects = ()) -> Diagnosis:
    """Tell which effect is missing from the model of a recording.

    Args:
        recording: what was measured, or the path of the recording.
        effects: of the model: "a,b", names, or, of held objects, `Effect`s.

    Raises:
        BadInputError: the path cannot be read, contacts and motion do not overlap, or an effect is
            unknown.
    """
    return Diagnosis.of(_question(_recorded(recording, any_unit=True), effects))


def explain(recording: Source, effects: Effects = ()) -> Explanation:
    """Add missing effects one by one until the model is adequate or nothing helps.

    Args:
        recording: what was measured, or the path of the recording.
        effects: of the model: "a,b", names, or, of held objects, `Effect`s.

    Raises:
        BadInputError: the path cannot be read, contacts and motion do not overlap, or an effect is
            unknown.
    """
    return Explanation.of(_question(_recorded(recording, any_unit=True), effects))


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
