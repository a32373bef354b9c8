"""An estimate as a block of a simulator or robot, without what the recording does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tactile_dynamics_ros.core.errors import BadInputError, NotIdentifiableError
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import InertialEstimate
from tactile_dynamics_ros.export import blocks

FORMATS: dict[str, blocks.Writer] = {
    "urdf": blocks.urdf,
    "sdf": blocks.sdf,
    "mjcf": blocks.mjcf,
    "ur": blocks.ur,
    "franka": blocks.franka,
}
"""Writer of each format."""
_WITHOUT_INERTIA = ("ur",)
"""Formats that take mass and centre of mass without an inertia."""
_ON_FLANGE = ("ur", "franka")
"""Formats of robots, whose numbers are in the axes of the flange."""


@dataclass(frozen=True)
class Export:
    """A block and what it does not have.

    Attributes:
        text: the block.
        left_out: what the estimate has and the block has not, one sentence each.
        doubts: what speaks against using the numbers, one sentence each; the block has them too.
    """

    text: str
    left_out: tuple[str, ...]
    doubts: tuple[str, ...] = ()


def export(
    estimate: InertialEstimate,
    form: str,
    source: str = "",
    name: str = "object",
    doubts: Sequence[str] = (),
) -> Export:
    """Write an estimate as a block of a simulator or robot.

    Args:
        estimate: what was found.
        form: of FORMATS.
        source: the recording, for the comment.
        name: of the link or model.
        doubts: sentences on why the numbers should not be used; they begin the comment.

    Raises:
        BadInputError: there is no such format.
        NotIdentifiableError: the recording does not tell what the format needs.
    """
    if form not in FORMATS:
        raise BadInputError(f"export {form}: expected one of {', '.join(FORMATS)}")
    open_inertia = any(one.startswith("inertia") for one in estimate.not_excited)
    _require_known(estimate, form)
    left_out = _left_out(estimate, open_inertia)
    remarks = [f"WARNING: {doubt}" for doubt in doubts] + _remarks(estimate, source, form)
    remarks += [f"left out: {line}" for line in left_out]
    text = FORMATS[form](estimate.inertia, name, remarks, not open_inertia)
    return Export(text + "\n", tuple(left_out), tuple(doubts))


def _require_known(estimate: InertialEstimate, form: str) -> None:
    """Check that the recording tells what the format needs.

    Raises:
        NotIdentifiableError: it does not.
    """
    needed = [
        name
        for name in estimate.not_excited
        if form not in _WITHOUT_INERTIA or not name.startswith("inertia")
    ]
    if not needed:
        return
    hint = ""
    if all(name.startswith("inertia") for name in needed):
        hint = f"; {', '.join(_WITHOUT_INERTIA)} takes mass and centre of mass alone"
    raise NotIdentifiableError(
        f"export {form}: this recording does not tell {', '.join(needed)}, and a presumed value is "
        f"no estimate; turn and shake the object about all axes{hint}"
    )


def _remarks(estimate: InertialEstimate, source: str, form: str) -> list[str]:
    """Return what a reader of the block should know."""
    std = estimate.parameter_std
    centre = ", ".join(f"{1e3 * one:.2g}" for one in std[1:4])
    moments = ", ".join(f"{one:.2g}" for one in std[[4, 6, 9]])
    lines = [
        f"estimated from {source or 'a recording'}: {estimate.duration:.1f} s, error "
        f"{estimate.error.whitened_rms:.2f} times the sensor noise",
        f"standard deviations: mass {std[0]:.2g} kg, centre of mass {centre} mm, moments of "
        f"inertia {moments} kg m^2",
        "frame: that of the object's pose in the recording; inertia about the centre of mass",
    ]
    if form in _ON_FLANGE:
        lines.append("valid only if that frame is the robot's flange")
    return lines


def _left_out(estimate: InertialEstimate, open_inertia: bool) -> list[str]:
    """Return what the block cannot hold."""
    lines = ["inertia, which this recording does not tell"] if open_inertia else []
    if estimate.effects:
        lines.append(f"effects of the model: {', '.join(estimate.effects)}")
    return [*lines, "friction, which this recording does not measure"]
