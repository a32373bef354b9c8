"""The shape of an object on a table as people, programs and notebooks take it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.api.result import Result, Rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tactile_dynamics_ros.core.shape.superquadric.scene import Scene


@dataclass(frozen=True, repr=False)
class Shape(Result):
    """Parts, size and pose of one object of a scene.

    Attributes:
        scene: what stands on the table.
        number: of the object; the largest is 1.
        notes: sentences on how the clouds were read.
    """

    scene: Scene
    number: int = 1
    notes: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the document of `shape`."""
        said = self.scene.to_json(self.number - 1)
        return said | {"remarks": [*self.notes, *said["remarks"]]}

    @property
    def meshes(self) -> list[Any]:
        """Surface of each part as a `trimesh.Trimesh`, world frame, m."""
        return [part.shape.mesh() for part in self.scene.objects[self.number - 1].parts]

    def headline(self) -> str:
        """Return the parts in words."""
        first, *others = [part["words"] for part in self.to_json()["parts"]]
        return f"{first}" + "".join(f"; beside it {words}" for words in others)

    def lines(self) -> list[str]:
        """Return parts, table, noise, places and the next view."""
        said, table = self.to_json(), self.scene.support
        lines = [
            self.headline(),
            "support: " + ("unknown" if table is None else f"{1e3 * table:.1f} mm"),
            f"noise {1e3 * said['noise_m']:.2f} mm, {100 * said['outliers']:.0f} % strays, "
            f"{100 * said['entropy']:.0f} % of the surface unseen",
        ]
        for part in said["parts"]:
            x, y = (f"{1e3 * part[k]:.1f} ± {1e3 * part['std'][k]:.1f}" for k in "xy")
            lines.append(f"{part['words'].split(',')[0]}: at x {x}, y {y} mm")
        lines.append(_next_view(said["next_view"]))
        return [*lines, *said["remarks"]]

    def rows(self) -> Rows:
        """Return size and place of each part."""
        body = []
        for part in self.to_json()["parts"]:
            size = " x ".join(f"{1e3 * length:.1f}" for length in part["extents_m"])
            place = ", ".join(f"{1e3 * part[k]:.1f} ± {1e3 * part['std'][k]:.1f}" for k in "xy")
            body.append((part["words"].split(",")[0], size, place))
        return [("part", "size, mm", "x, y, mm"), *body]

    def draw(self) -> Figure:
        """Draw the points and the surface."""
        from tactile_dynamics_ros.report.shapes import draw_shape

        points = self.scene.objects[self.number - 1].points
        return draw_shape(points, [(mesh.vertices, mesh.faces) for mesh in self.meshes])


def _next_view(view: dict[str, Any] | None) -> str:
    if view is None:
        return "another look would add little"
    place = ", ".join(f"{value:.3f}" for value in view["position"])
    return f"look next from ({place}) m: it would show {100 * view['gain']:.0f} % more"
