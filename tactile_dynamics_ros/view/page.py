"""The page itself: a scene with numbers, charts and a verdict beside it. The only user of viser."""

from __future__ import annotations

import html
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from typing import Any

import numpy as np
from viser import ViserServer, uplot

from tactile_dynamics_ros.core.array import Array
from tactile_dynamics_ros.core.rigid_body.rotation import matrix_to_quaternion
from tactile_dynamics_ros.view.gate import Gate
from tactile_dynamics_ros.view.robot import RobotFigure
from tactile_dynamics_ros.view.state import Body, Force, Push, State, error_columns
from tactile_dynamics_ros.view.texts import write_numbers, write_verdict

METRES_PER_NEWTON = 0.02
"""Length of a force's arrow: fingertips press with 1 to 5 N, which is as long as an object."""
_SMALLEST = 5e-4
"""Least semi-axis of an ellipsoid, m, below which nothing could be seen of it."""
_BLUE, _ORANGE, _GREEN, _GREY = (37, 99, 235), (234, 120, 30), (46, 158, 119), (170, 180, 190)

_EYE = np.array([0.42, -0.38, 0.3])
"""Place of the eye from the object, m: a hand fills the picture. Nearer cuts it off."""
_NEARER = 0.7
"""How far the eye of a pushed object is, in that distance: there is no hand. Nearer, pushes of 6 cm
begin outside the picture."""

_SHELLS = (0.25, 0.12)
"""Opacity of the ellipsoids of inertia, a deviation smaller and larger: both are seen, and the
centre of mass inside. More hides it."""
_CLEAR = 0.6
"""Opacity of the object's surface, so that its centre of mass shows inside. More hides it."""
_HEIGHT = 0.002
"""Height above the support at which the outline is drawn, m: on it, the grid would hide it."""
_PUSH_HEIGHT = 0.03
"""Height of the arrows of pushes above the support, m: about where tips push."""

_REGIME, _FAILS = "rgba(122, 94, 168, 0.25)", "rgba(200, 66, 59, 0.12)"
"""Shades where an effect acts and where the model fails: violet and red, both seen if both are."""

CHARTS = {
    "error": "error over noise; red dashes: its floor",
    "load": "vertical force, N",
    "friction_force_n": "friction force, N",
    "mass": "mass, g",
    "com": "centre of mass x, mm",
    "com_x": "centre of mass x, mm",
    "com_y": "centre of mass y, mm",
    "friction": "friction",
}
"""Charts by quantity of the state; the state has them in these units."""


class LivePage:
    """A page that shows a state; several browsers may look.

    Args:
        host: address to listen on.
        port: to listen on; 0 takes a free one.
        actions: what buttons do, by their text: each returns the answer in words. None for a page
            that only shows.
    """

    def __init__(
        self, host: str, port: int, actions: Mapping[str, Callable[[], str]] | None = None
    ) -> None:
        self._host, self._gate = host, Gate(host)
        with redirect_stdout(StringIO()), self._gate.guarding():  # viser greets there
            self.server = ViserServer(host=host, port=port, verbose=False, label="tactile dynamics")
        scene = self.server.scene
        scene.set_up_direction("+z")
        scene.add_grid("/support", 2.0, 2.0, cell_size=0.1, section_size=0.5)
        self._robot: RobotFigure | None = None
        self._urdf = ""
        self._drawn: dict[str, Any] = {}
        gui = self.server.gui
        gui.configure_theme(control_layout="fixed", show_logo=False, show_share_button=False)
        self._verdict = gui.add_html("")
        self._numbers = gui.add_html("")
        self.buttons = [self._add_button(*one) for one in (actions or {}).items()]
        self._answer = gui.add_html("")
        self._add: Callable[[str], str] | None = None
        self._offers: dict[str, Any] = {}
        self._charts: dict[str, Any] = {}
        self._content: dict[str, Array] = {}

    @property
    def address(self) -> str:
        """Address for a browser, with the token that lets it in."""
        return f"http://{self._host}:{self.server.get_port()}/?token={self._gate.token}"

    @property
    def nodes(self) -> set[str]:
        """Names of what is drawn in the scene."""
        return set(self._drawn) | ({"/robot"} if self._robot else set())

    def drawn(self, name: str) -> Any:
        """Return a node of the scene."""
        return self._drawn[name]

    def close(self) -> None:
        """Stop serving."""
        with redirect_stdout(StringIO()):
            self.server.stop()

    def show(self, state: State) -> None:
        """Show a state; what has not changed is not sent again."""
        with self.server.atomic():
            self._show_robot(state)
            self._show_object(state)
            self._show_pushes(state)
            for name in [key for key in self._drawn if key.startswith("/contacts/")]:
                if name.split("/")[2] not in state.forces:
                    self._drawn.pop(name).remove()
            for name, force in state.forces.items():
                self._show_force(name, force)
        self._say(self._verdict, write_verdict(state))
        self._say(self._numbers, write_numbers(state))
        self._offer([name for name in state.missing if name not in state.effects])

    def draw_charts(self, state: State) -> None:
        """Draw the histories; less often than the scene, since whole columns are sent."""
        for place, (name, title) in enumerate(CHARTS.items(), 1):
            history = state.histories.get(name)
            if history is None:
                continue
            columns = error_columns(history, state) if name == "error" else tuple(history.columns())
            if name not in self._charts:
                banded = np.any(columns[2] != columns[3])
                said = f"{title} (band: ± one std)" if banded else title
                self._charts[name] = self._add_chart(columns, said, place)
            else:
                self._charts[name].data = columns

    def allow_adding(self, add: Callable[[str], str]) -> None:
        """Offer a button for each effect that a diagnosis names; it asks before it adds.

        Args:
            add: adds the effect of a name to the model and returns the answer in words.
        """
        self._add = add

    def answer(self, text: str) -> None:
        """Show what an action answered."""
        self._say(self._answer, f"<p>{html.escape(text)}</p>")

    def add_time(self, duration: float) -> Any:
        """Add a slider of the time in a recording, s; its `value` is what is chosen."""
        return self.server.gui.add_slider("time, s", 0.0, max(duration, 0.01), 0.01, 0.0, order=-1)

    def add_choice(
        self, text: str, names: Sequence[str], choose: Callable[[list[str]], str]
    ) -> None:
        """Add boxes for names and a button that hands on those that are ticked."""
        gui = self.server.gui
        with gui.add_folder(text, expand_by_default=False):
            boxes = {name: gui.add_checkbox(name, False) for name in names}
            self._add_button("Set", lambda: choose([n for n, box in boxes.items() if box.value]))

    def _offer(self, names: Sequence[str]) -> None:
        """Show the buttons of those effects that can be added, and no others."""
        for name in [name for name in self._offers if name not in names]:
            self._offers.pop(name).remove()
        for name in names if self._add else ():
            if name not in self._offers:
                button = self.server.gui.add_button(
                    f"Add {name} ...", order=self._verdict.order + 0.5
                )
                button.on_click(partial(self._confirm, name))
                self._offers[name] = button

    def _confirm(self, name: str, event: Any) -> None:
        """Ask, on the page of whoever pressed the button, whether an effect is to be added."""
        gui = self.server.gui if event.client is None else event.client.gui
        modal = gui.add_modal(f"Add {name} to the model?")
        with modal:
            gui.add_html("<p>The estimate is made anew with it. Nothing moves.</p>")
            yes, no = gui.add_button("Yes, add it"), gui.add_button("No")
        no.on_click(lambda _: modal.close())

        @yes.on_click
        def _(_: Any) -> None:
            modal.close()
            self.answer(f"adding {name} ...")
            self.answer(self._add(name) if self._add else "")

    def _add_button(self, text: str, action: Callable[[], str]) -> Any:
        button = self.server.gui.add_button(text, color="red" if text.isupper() else None)

        @button.on_click
        def _(_: Any) -> None:
            self.answer(f"{text} ...")
            self.answer(action())

        return button

    def _add_chart(self, columns: tuple[Array, ...], title: str, place: int) -> Any:
        """Add a chart of a value with its band, and of the marks of an error, if it has them."""
        none = {"show": False}
        edge = uplot.Series(label="", stroke="rgba(0,0,0,0)", points=none)
        marks = (
            uplot.Series(label="floor", stroke="#c8423b", dash=(5, 4), points=none),
            uplot.Series(label="regime", stroke="rgba(0,0,0,0)", fill=_REGIME, points=none),
            uplot.Series(label="fails", stroke="rgba(0,0,0,0)", fill=_FAILS, points=none),
        )
        return self.server.gui.add_uplot(
            columns,
            (
                uplot.Series(label="s"),
                uplot.Series(label=title, stroke="rgb(37, 99, 235)", width=2, points=none),
                edge,
                edge,
                *marks[: len(columns) - 4],
            ),
            bands=(uplot.Band(series=(3, 2), fill="rgba(37, 99, 235, 0.18)", dir=-1),),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            legend=uplot.Legend(show=False),
            title=title,
            height=150,
            order=self._answer.order + place / (len(CHARTS) + 1),
        )

    def _say(self, element: Any, text: str) -> None:
        if element.content != text:
            element.content = text

    def _show_robot(self, state: State) -> None:
        if state.urdf != self._urdf:
            self._urdf = state.urdf
            self._robot = RobotFigure(self.server.scene, state.urdf)
        if self._robot is not None:
            self._robot.move(state.joints)

    def _show_object(self, state: State) -> None:
        scene = self.server.scene
        if state.shape is not None:
            corners = state.shape
            faces = np.arange(len(corners)).reshape(-1, 3)
            draw = partial(scene.add_mesh_simple, color=_GREY, opacity=_CLEAR)
            self._replace("/shape", corners, draw, corners, faces)
            if state.shape_pose is not None and state.object_pose is not None:
                moved = state.object_pose @ np.linalg.inv(state.shape_pose)
                _place(self._drawn["/shape"], moved)
        if state.next_view is not None:
            frustum = self._once("/next_view", scene.add_camera_frustum, 0.8, 1.3, scale=0.1)
            _place(frustum, state.next_view)
        if state.object_pose is None:
            return
        if "/object" not in self._drawn:
            near = 1.0 if state.footprint is None else _NEARER
            self._look_at(state.object_pose[:3, 3], near * _EYE)
        frame = self._once("/object", scene.add_frame, axes_length=0.05, axes_radius=0.002)
        _place(frame, state.object_pose)
        if state.body is not None:
            self._show_centre(state.body.com, state.body.com_std)
            self._show_inertia(state.body)
        elif state.centre is not None:
            self._show_centre(*state.centre)
        if state.footprint is not None:
            self._show_footprint("/object", state.footprint)
        if state.second_pose is not None and state.second_footprint is not None:
            _place(self._once("/second", scene.add_frame, show_axes=False), state.second_pose)
            self._show_footprint("/second", state.second_footprint)

    def _look_at(self, point: Array, eye: Array) -> None:
        """Turn the eyes of those who come, and of those who are there, to a point."""
        self.server.initial_camera.look_at = point
        self.server.initial_camera.position = point + eye
        for client in self.server.get_clients().values():
            client.camera.position, client.camera.look_at = point + eye, point

    def _show_centre(self, com: Array, std: Array) -> None:
        """The centre of mass as the ellipsoid of one standard deviation, in the object's frame."""
        name = "/object/centre_of_mass"
        ball = self._once(name, self.server.scene.add_icosphere, 1.0, _ORANGE, opacity=0.6)
        ball.position = com
        ball.scale = tuple(np.maximum(std, _SMALLEST).tolist())

    def _show_inertia(self, body: Body) -> None:
        """Ellipsoids of even density of the object's inertia, a deviation smaller and larger."""
        if body.shells is None:
            return
        turn = np.roll(matrix_to_quaternion(body.shells[2]), 1)
        for name, radii, opacity in zip(("inner", "outer"), body.shells, _SHELLS, strict=False):
            add = self.server.scene.add_icosphere
            shell = self._once(f"/object/inertia_{name}", add, 1.0, _GREY, opacity=opacity)
            shell.position, shell.wxyz = body.com, turn
            shell.scale = tuple(np.maximum(radii, _SMALLEST).tolist())

    def _show_footprint(self, part: str, outline: Array) -> None:
        """The outline of a part of a pushed object on its support, in the frame of the part."""
        corners = np.column_stack([outline, np.full(len(outline), _HEIGHT)])
        sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        add = self.server.scene.add_line_segments
        self._replace(f"{part}/footprint", outline, add, sides, _BLUE, thickness=0.002)

    def _show_pushes(self, state: State) -> None:
        """Arrows of the push that is made and of its rivals; the plan says what it is to tell."""
        names = set()
        for k, push in enumerate(state.pushes):
            name = f"/pushes/{k}"
            names.add(name)
            self._show_push(name, push)
        gone = {key for key in self._drawn if key.startswith("/pushes/")} - names
        for name in gone:
            self._drawn.pop(name).remove()

    def _show_push(self, name: str, push: Push) -> None:
        tip = np.array([*push.point, _PUSH_HEIGHT])
        back = tip - push.length * np.array([*push.direction, 0.0])
        line = np.array([[back, tip]], dtype=np.float32)
        thickness = 0.004 if push.chosen else 0.002
        arrow = self._once(
            name,
            self.server.scene.add_arrows,
            line,
            _ORANGE if push.chosen else _GREY,
            shaft_radius=thickness,
            head_radius=2.5 * thickness,
            head_length=5.0 * thickness,
        )
        arrow.points = line

    def _show_force(self, name: str, force: Force) -> None:
        """An arrow whose head ends in the ellipsoid of one standard deviation of the force."""
        scene = self.server.scene
        tip = force.point + METRES_PER_NEWTON * force.force
        line = np.array([[force.point, tip]], dtype=np.float32)
        arrow = self._once(
            f"/contacts/{name}/force",
            scene.add_arrows,
            line,
            _GREEN,
            shaft_radius=0.002,
            head_radius=0.005,
            head_length=0.012,
        )
        arrow.points = line
        if force.std is None:
            return
        ball = self._once(
            f"/contacts/{name}/uncertainty", scene.add_icosphere, 1.0, _GREEN, opacity=0.35
        )
        ball.position = tip
        size = METRES_PER_NEWTON * force.std
        ball.scale = tuple(np.maximum(size, _SMALLEST).tolist())

    def _once(self, name: str, add: Callable[..., Any], *args: Any, **options: Any) -> Any:
        """Return the node of a name, added if it is not there."""
        if name not in self._drawn:
            self._drawn[name] = add(name, *args, **options)
        return self._drawn[name]

    def _replace(
        self, name: str, content: Array, add: Callable[..., Any], *args: Any, **options: Any
    ) -> None:
        """Draw a node anew if its content is another array than that which is drawn."""
        if self._content.get(name) is not content:
            self._content[name] = content
            self._drawn[name] = add(name, *args, **options)


def _place(node: Any, pose: Array) -> None:
    node.position = pose[:3, 3]
    node.wxyz = np.roll(matrix_to_quaternion(pose[:3, :3]), 1)
