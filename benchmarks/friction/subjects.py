"""What is probed: objects and regions, where they are grasped, and friction drawn for them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.manipulation.grasp_planner import GraspSite
from tactile_dynamics_ros.core.shape.friction_regions import WHOLE, ObjectSurface
from tactile_dynamics_ros.sim.skin_friction import SurfaceFriction

FOLDER = Path(__file__).resolve().parents[2] / "config" / "objects"


@dataclass(frozen=True)
class Subject:
    """One object, or one region of an object.

    Attributes:
        name: as in the figure.
        file: in config/objects. region: where the index finger has to press.
        mean: of the static coefficient, within what is known of silicone on such a surface.
        height: of the grasp centre in the object frame, m, or None for that of the file.
    """

    name: str
    file: str
    region: str
    mean: float
    height: float | None = None

    @property
    def path(self) -> str:
        """File with its folder."""
        return str(FOLDER / self.file)

    def description(self) -> dict:
        """Content of the file."""
        return dict(yaml.safe_load(Path(self.path).read_text()))

    def surface(self) -> ObjectSurface:
        """Mesh that the probe is told."""
        return ObjectSurface.from_mapping(self.description())

    def site(self) -> GraspSite:
        """Where to grasp so that the index finger meets the region."""
        site = GraspSite.from_mapping(self.description()["grasp"])
        if self.height is None:
            return site
        return replace(site, centre=np.array([*site.centre[:2], self.height]))

    def regions(self) -> dict[str, tuple[Array, Array]]:
        """Boxes of the regions, for the simulator."""
        return {
            part["name"]: (np.array(part["lower"], float), np.array(part["upper"], float))
            for part in self.description().get("regions", ())
        }


SUBJECTS = (
    Subject("9 hole peg", "friction/nine_hole_peg_test.yaml", WHOLE, 0.70),
    Subject("wood block", "friction/wood_block.yaml", WHOLE, 0.80),
    Subject("lego duplo", "friction/lego_duplo.yaml", WHOLE, 0.90),
    Subject("bleach", "friction/bleach_cleanser.yaml", WHOLE, 0.80),
    Subject("bleach label", "friction/bleach_cleanser.yaml", "label", 0.65, 0.05),
    Subject("box of sugar", "friction/sugar_box.yaml", WHOLE, 0.65),
    Subject("cracker box", "friction/cracker_box.yaml", WHOLE, 0.60),
    Subject("mustard", "friction/mustard_bottle.yaml", WHOLE, 0.80),
    Subject("mustard label", "friction/mustard_bottle.yaml", "label", 0.65, 0.02),
    Subject("3D printed", "friction/printed_box.yaml", WHOLE, 0.85),
)
REFERENCES = tuple(
    Subject(f"block {mm} mm", f"friction/reference_block_{mm}mm.yaml", WHOLE, 0.78)
    for mm in (42, 51, 60, 70, 80)
)
"""Blocks of known friction, as wide as what is held: fingertips differ from place to place."""


def draw_friction(subject: Subject, rng: np.random.Generator) -> dict[str, SurfaceFriction]:
    """Draw the friction of all regions: 10 % between objects, kinetic 0.75 to 0.95 of static.

    Source: facts on friction (suggested spread).
    """
    names = [WHOLE, *subject.regions()]
    drawn = {}
    for name in names:
        mean = subject.mean if name == subject.region else rng.uniform(0.5, 0.95)
        static = float(np.clip(mean * (1.0 + 0.1 * rng.standard_normal()), 0.35, 1.2))
        drawn[name] = SurfaceFriction(static, static * float(rng.uniform(0.75, 0.95)))
    return drawn
