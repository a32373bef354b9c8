"""Fits of objects in plain words: what they are, and what no fit can say of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_dynamics_ros.core.shape.superquadric.parts import TableObject
from tactile_dynamics_ros.core.shape.superquadric.recovery import Recovery
from tactile_dynamics_ros.core.shape.superquadric.superquadric import Superquadric

_MISFIT = 0.01
"""Misfit, as a share of the size, from which it is said that no superquadric describes an object:
hexagons leave 0.006 to 0.009, a bag with dents of a tenth of its size 0.013 to 0.025. Lower remarks
on objects that are described well enough to grasp, higher keeps quiet about ones that are not."""
_DEEP = 0.1
"""Depth below a part's top, as a share of its height, from which a point lies inside and not on a
rounded edge; never less than five standard deviations of the camera. Lower takes the misfit of
tops for a hole, higher overlooks flat trays."""
_WITHIN = 0.95
"""Share of the half width within which a point lies over the middle of a part and not at its sides:
the wall of a cup of 8 cm may be 2 mm thick. Nearer to 1 points of the sides count as the inside,
lower overlooks steep cups whose bottom no camera sees."""
_INSIDE = 0.05
"""Share of points deep inside from which an object is said to be open or hollow. Strays of a
simulated camera, a tenth of all points, put 1 to 3 % there; lower remarks on them, higher overlooks
the inside of a cup seen from the side."""
_OPEN = 0.5
"""Share of the points over the middle that lie deep, from which the top is open: of a closed body
nearly all lie on its top, of cups and trays hardly any. Halfway, anything between does as well."""


def describe(part: Recovery) -> str:
    """Return a part in plain words, with its size in mm."""
    size = 1e3 * part.shape.extents()
    spread = 2e3 * np.array([part.std[f"a{axis}"] for axis in "xyz"])
    lengths = " x ".join(f"{value:.0f}" for value in size)
    most = max(spread[:2] if part.foot_std else spread)
    height = f", its height ± {spread[2]:.0f}" if part.foot_std else ""
    return f"{kind(part.shape)} {lengths} mm, ± {max(most, 0.1):.1f}{height}"


def kind(shape: Superquadric) -> str:
    """Return the name of a kind of shape."""
    (e1, e2), (k1, k2) = shape.exponents, shape.taper
    upright = e1 < 0.5
    if abs(k1) > 0.6:
        return "a wedge" if upright else "a rounded wedge"
    if k2 < -0.3:
        return "a body with a six-sided outline" if e2 < 0.5 else "a body with pointed ends"
    if k2 > 0.3:
        return "a waisted body"
    round_section = 0.7 < e2 < 1.4
    even = abs(np.log(shape.semi_axes[0] / shape.semi_axes[1])) < 0.1
    if upright:
        if round_section:
            return "a cylinder" if even else "an elliptic cylinder"
        return "a box" if e2 <= 0.7 else "a prism"
    if round_section:
        return "a ball" if even and e1 > 0.7 else "a rounded body"
    return "a rounded box"


def remarks_of(found: TableObject) -> list[str]:
    """Return what a fit cannot say, in plain sentences."""
    size = float(np.ptp(found.points, axis=0).max())
    remarks = []
    if len(found.parts) > 1:
        remarks.append(
            "nothing was seen where its parts meet: their lengths toward each other are the least "
            "that explain the points"
        )
    if found.misfit > _MISFIT * size:
        remarks.append(
            f"no superquadric describes it: surfaces are {1e3 * found.misfit:.1f} mm off (RMS) "
            "beyond the camera's noise; it may be deformable, or of another kind"
        )
    over, deep = _over_middle(found)
    inside = float(deep.mean())
    if inside > _INSIDE and deep.sum() > _OPEN * over.sum():
        remarks.append(
            f"its top is open: {100 * inside:.0f} % of its points lie below the rim, inside; what "
            "is reported is its outside"
        )
    elif inside > _INSIDE:
        remarks.append(
            f"{100 * inside:.0f} % of its points lie inside the surface: it may be open, hollow or "
            "deformed"
        )
    return remarks


def _over_middle(found: TableObject) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points (N,) lie over the middle of a part, and which deep below its top."""
    over = np.zeros(len(found.points), dtype=bool)
    on_top = over.copy()
    for part in found.parts:
        shape = part.shape
        local = shape.to_body(found.points)
        share = np.minimum(shape.gauge(local * [1.0, 1.0, 0.0]), 1.0)
        within = share < _WITHIN
        top = shape.semi_axes[2] * (1.0 - share ** (2.0 / shape.exponents[0])) ** (
            0.5 * shape.exponents[0]
        )
        over |= within
        least = max(2.0 * _DEEP * shape.semi_axes[2], 5.0 * found.floor)
        on_top |= within & (local[:, 2] > top - least)
    return over, over & ~on_top
