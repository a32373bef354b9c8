"""`tactile-dynamics view [BAG]`: a page in the browser, of running nodes or of a recording."""

from __future__ import annotations

import json
import math
import time
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from threading import Lock
from typing import TYPE_CHECKING, Any

from tactile_dynamics_ros.cli.live import StopRequest
from tactile_dynamics_ros.cli.recordings import (
    add_recording_arguments,
    model_of,
    read_pushed,
    read_recording,
)
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError, require_extra
from tactile_dynamics_ros.core.options import PORT

if TYPE_CHECKING:
    from rclpy.node import Node

    from tactile_dynamics_ros.view.live import LiveSource
    from tactile_dynamics_ros.view.page import LivePage
    from tactile_dynamics_ros.view.state import State

_PERIOD = 0.1
"""Time between pictures, s: fluent for a person, and a tenth of a core at most. Twice as often
costs twice that."""
_CHARTS_EVERY = 10
"""Pictures from one drawing of the charts to the next: whole columns are sent, and numbers of a
minute do not change faster than once a second."""
_DISCOVER_EVERY = 10
"""Pictures from one look for new contacts to the next."""

SERVICES = {
    "Diagnose": ("model_check/diagnose", 300.0),
    "Probe friction": ("friction_probe/probe", 10.0),
    "Explore": ("explorer/explore", 10.0),
}
"""Buttons: service and time for its answer, s."""


def add_parser(verbs: _SubParsersAction[Any]) -> None:
    """Add the verb."""
    parser = verbs.add_parser("view")
    add_recording_arguments(parser, optional=True)
    add_page_arguments(parser)
    parser.set_defaults(run=run)


def add_page_arguments(parser: ArgumentParser) -> None:
    """Add where the page is and what it may do."""
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="to listen on (127.0.0.1: only this machine reaches it)",
    )
    parser.add_argument("--port", type=PORT, default=8080, metavar="N", help="to listen on (8080)")
    parser.add_argument(
        "--control",
        action="store_true",
        help="with buttons that call services and change effects; without, the page only shows",
    )


def run(args: Namespace) -> int:
    """Serve the page until Ctrl-C."""
    require_viser()
    with StopRequest() as stop:
        if args.bag:
            _play(args, stop)
        else:
            _watch(args, stop)
    return 0


def require_viser() -> None:
    """Check that the page's library is there.

    Raises:
        MissingExtraError: it is not.
    """
    require_extra("viser", "view", "the page")


@contextmanager
def served(args: Namespace, actions: Mapping[str, Callable[[], str]] | None) -> Iterator[LivePage]:
    """A page at the address of the arguments.

    Raises:
        BadInputError: the address cannot be listened on.
    """
    from tactile_dynamics_ros.view.page import LivePage

    try:
        if args.port:
            _require_free(args.host, args.port)
        page = LivePage(args.host, args.port, actions)
    except OSError as error:
        raise BadInputError(f"--port {args.port} of {args.host}: {error.strerror}") from error
    said = json.dumps({"page": page.address}) if args.json else f"page: {page.address}"
    print(said, flush=True)
    try:
        yield page
    finally:
        page.close()


def _require_free(host: str, port: int) -> None:
    """Check that nobody listens there; viser would take the next port without a word."""
    import socket

    with socket.create_server((host, port)):
        pass


def _play(args: Namespace, stop: StopRequest) -> None:
    """Show a recording with a slider for its time."""
    from tactile_dynamics_ros.view.playback import Playback
    from tactile_dynamics_ros.view.push_playback import PushPlayback

    args.bag = [args.bag] if isinstance(args.bag, str) else args.bag
    if model_of(args) == "pushed":
        playback: Playback | PushPlayback = PushPlayback(read_pushed(args))
    else:
        playback = Playback(read_recording(args))
    with served(args, {"Diagnose": playback.diagnose}) as page:
        page.allow_adding(playback.add)
        moment = page.add_time(playback.duration)
        count = 0
        while not stop.requested:
            state = playback.at(moment.value)
            page.show(state)
            if count % _CHARTS_EVERY == 0:
                page.draw_charts(state)
            count += 1
            time.sleep(_PERIOD)
    playback.close()


def _watch(args: Namespace, stop: StopRequest) -> None:
    """Show what nodes publish until somebody stops it."""
    from tactile_dynamics_ros.cli.topics import short_lived_node
    from tactile_dynamics_ros.view.live import LiveSource

    with short_lived_node(args.namespace or "") as node:
        source = LiveSource(node)
        control = Control(node, source.state) if args.control else None
        with served(args, control.actions() if control else None) as page:
            follow(page, source, lambda: stop.requested, control)


def follow(
    page: LivePage,
    source: LiveSource,
    stop: Callable[[], bool],
    control: Control | None = None,
) -> None:
    """Show what nodes publish on a page.

    Args:
        page: to show it on.
        source: of their messages; nobody else may spin its node.
        stop: asked ten times a second.
        control: offers the effects of the model, once it is known what is estimated.
    """
    count = 0
    while not stop():
        if count % _DISCOVER_EVERY == 0:
            source.discover()
            if control and source.state.remark:
                control.add_effects(page)
                control = None
        source.read()
        page.show(source.state)
        if count % _CHARTS_EVERY == 0:
            page.draw_charts(source.state)
        count += 1
        time.sleep(_PERIOD)


class Control:
    """What the buttons of a page do: one at a time, except stopping.

    Args:
        node: that calls services.
        state: of the page, which says what is estimated.
    """

    def __init__(self, node: Node, state: State) -> None:
        from std_msgs.msg import Bool

        from tactile_dynamics_ros.ros.names import EMERGENCY_STOP
        from tactile_dynamics_ros.ros.shell import LATCHED

        self._node, self._message, self._state = node, Bool, state
        self._stop = node.create_publisher(Bool, EMERGENCY_STOP, LATCHED)
        self._lock = Lock()
        self._asked: tuple[str, ...] = ()

    def actions(self) -> dict[str, Callable[[], str]]:
        """Return what each button does."""
        calls = {text: self._caller(*service) for text, service in SERVICES.items()}
        calls["Reset the estimate"] = lambda: self._caller(f"{self._estimator}/reset", 10.0)()
        return {"STOP": self._halt, "Allow motion again": self._release, **calls}

    def add_effects(self, page: LivePage) -> None:
        """Add the choice of the effects of the model, and buttons for those that are missing.

        Args:
            page: to add them to.
        """
        from tactile_dynamics_ros.core.effects import EFFECT_NAMES
        from tactile_dynamics_ros.core.planar.effects.registry import PUSHED_EFFECT_NAMES

        names = PUSHED_EFFECT_NAMES if self._state.pushed else EFFECT_NAMES
        page.add_choice("Effects of the model", names, self._set_effects)
        page.allow_adding(self.add)

    def add(self, name: str) -> str:
        """Add an effect to the model; return how the error of a pushed object changes with it."""
        from tactile_dynamics_ros.cli.demo_change import REFITTED

        state = self._state
        before, others = state.error, state.effects
        said = self._set_effects([*others, name])
        if not self._state.pushed or name not in self._asked:
            return said
        until = time.monotonic() + REFITTED
        while time.monotonic() < until and self._asked == (*others, name):
            if name in state.fitted and state.error is not None:
                before = state.without if state.without and not others else before
                return f"{name} is added: error {before or math.nan:.2f} -> {state.error:.2f}"
            if name in state.effects and state.refused:
                return f"{name} is in the model, without a fit: {state.refused}"
            time.sleep(_PERIOD)
        return f"{said}; no fit with it after {REFITTED:.0f} s"

    @property
    def _estimator(self) -> str:
        return "property_estimator" if self._state.pushed else "inertial_estimator"

    def _halt(self) -> str:
        self._stop.publish(self._message(data=True))
        return "stopped: all nodes that command motion stay as they are"

    def _release(self) -> str:
        self._stop.publish(self._message(data=False))
        return "motion is allowed again; it begins at the next call"

    def _caller(self, service: str, timeout: float) -> Callable[[], str]:
        from tactile_dynamics_ros.cli.topics import call_trigger

        return lambda: self._alone(lambda: _words(*call_trigger(self._node, service, timeout)))

    def _set_effects(self, names: list[str]) -> str:
        from tactile_dynamics_ros.cli.topics import set_parameter

        def change() -> str:
            set_parameter(self._node, self._estimator, "effects", names, 10.0)
            self._asked = tuple(names)
            return f"effects of the model: {', '.join(names) or 'none'}"

        return self._alone(change)

    def _alone(self, action: Callable[[], str]) -> str:
        if not self._lock.acquire(blocking=False):
            return "something else is being asked; wait for its answer"
        try:
            return action()
        except TactileDynamicsError as error:
            return str(error)
        finally:
            self._lock.release()


def _words(success: bool, message: str) -> str:
    """Return a service's answer as a sentence: that of its document, if it is one."""
    try:
        return str(json.loads(message)["sentence"])
    except (ValueError, KeyError, TypeError):
        return message if success else f"not done: {message}"
