"""`tactile-dynamics view [BAG]`: a page in the browser, of running nodes or of a recording."""

from __future__ import annotations

import json
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
    "Reset the estimate": ("inertial_estimator/reset", 10.0),
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
        if isinstance(playback, Playback):
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
        control = Control(node) if args.control else None
        with served(args, control.actions() if control else None) as page:
            source = LiveSource(node)
            if control:
                control.add_effects(page, source.state)
            follow(page, source, lambda: stop.requested)


def follow(page: LivePage, source: LiveSource, stop: Callable[[], bool]) -> None:
    """Show what nodes publish on a page.

    Args:
        page: to show it on.
        source: of their messages; nobody else may spin its node.
        stop: asked ten times a second.
    """
    count = 0
    while not stop():
        if count % _DISCOVER_EVERY == 0:
            source.discover()
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
    """

    def __init__(self, node: Node) -> None:
        from std_msgs.msg import Bool

        from tactile_dynamics_ros.ros.names import EMERGENCY_STOP
        from tactile_dynamics_ros.ros.shell import LATCHED

        self._node, self._message = node, Bool
        self._stop = node.create_publisher(Bool, EMERGENCY_STOP, LATCHED)
        self._lock = Lock()

    def actions(self) -> dict[str, Callable[[], str]]:
        """Return what each button does."""
        calls = {text: self._caller(*service) for text, service in SERVICES.items()}
        return {"STOP": self._halt, "Allow motion again": self._release, **calls}

    def add_effects(self, page: LivePage, state: State) -> None:
        """Add the choice of the effects of the model, and buttons for those that are missing.

        Args:
            page: to add them to.
            state: of the model.
        """
        from tactile_dynamics_ros.core.effects import EFFECT_NAMES

        page.add_choice("Effects of the model", EFFECT_NAMES, self._set_effects)
        page.allow_adding(lambda name: self._set_effects([*state.effects, name], state))

    def _halt(self) -> str:
        self._stop.publish(self._message(data=True))
        return "stopped: all nodes that command motion stay as they are"

    def _release(self) -> str:
        self._stop.publish(self._message(data=False))
        return "motion is allowed again; it begins at the next call"

    def _caller(self, service: str, timeout: float) -> Callable[[], str]:
        from tactile_dynamics_ros.cli.topics import call_trigger

        return lambda: self._alone(lambda: _words(*call_trigger(self._node, service, timeout)))

    def _set_effects(self, names: list[str], state: State | None = None) -> str:
        from tactile_dynamics_ros.cli.topics import set_parameter

        estimator = "property_estimator" if state and state.numbers else "inertial_estimator"

        def change() -> str:
            set_parameter(self._node, estimator, "effects", names, 10.0)
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
