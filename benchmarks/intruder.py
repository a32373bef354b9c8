"""What another site, user or folder can reach: pages, processes, locks and kept files."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import psutil
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from tactile_dynamics_ros.cli.supervisor import node_command, verb_command
from tactile_dynamics_ros.ros.background import WORKER

SITE = "http://evil.example"
PLANTED = ("yaml", "numpy", "rclpy", "argparse", "tactile_dynamics_ros")
"""Modules that a folder may have under names that our processes import."""
STARTED = 20.0
"""s until a process that starts has imported what it needs on two busy cores."""
NOBODY = 65534
"""Number of the user `nobody`."""


@dataclass
class Attempt:
    """One way in.

    Attributes:
        door: what was tried. how: by whom. reached: whether it was open.
    """

    door: str
    how: str
    reached: bool


def pages() -> Iterator[Attempt]:
    """Ports of the page and of all processes behind it, with what other sites can send."""
    command = verb_command("view", "--control", "--port", "0", "--json")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as view:
        assert view.stdout is not None
        address = urlsplit(json.loads(view.stdout.readline())["page"])
        cookie = _cookie(address.port or 0, address.query)
        ways = {
            "no token": {},
            "wrong token": {"Cookie": f"{cookie.partition('=')[0]}=guess"},
            "another site, with the browser's cookie": {"Cookie": cookie, "Origin": SITE},
            "name of another site (DNS rebinding)": {"Cookie": cookie, "Host": "evil.example"},
        }
        for port in _listening(view.pid):
            for how, headers in ways.items():
                yield Attempt(f"http on port {port}", how, _get(port, "/", headers) == 200)
                yield Attempt(f"websocket on port {port}", how, _opens(port, headers))
        view.send_signal(signal.SIGINT)


def _listening(pid: int) -> set[int]:
    """TCP ports of a process and its children."""
    process = psutil.Process(pid)
    family = [process, *process.children(recursive=True)]
    found = (c for one in family for c in one.net_connections("tcp") if c.status == "LISTEN")
    return {connection.laddr.port for connection in found}


def _cookie(port: int, query: str) -> str:
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", f"/?{query}")
    return str(connection.getresponse().getheader("Set-Cookie")).partition(";")[0]


def _get(port: int, target: str, headers: dict[str, str]) -> int:
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", target, headers=headers)
    return connection.getresponse().status


def _opens(port: int, headers: dict[str, str]) -> bool:
    try:
        with connect(f"ws://127.0.0.1:{port}/", additional_headers=headers):
            return True
    except (WebSocketException, OSError):
        return False


def processes() -> Iterator[Attempt]:
    """Our processes, started in a folder that has modules under the names of what they import."""
    commands = {
        "the command": verb_command("effects"),
        "a node": node_command("model_check"),
        "a node's worker": [*WORKER, str(os.getpid())],
    }
    for door, command in commands.items():
        with tempfile.TemporaryDirectory() as folder:
            for name in PLANTED:
                planted = Path(folder) / name / "__init__.py"
                planted.parent.mkdir()
                planted.write_text(f"open({str(Path(folder) / 'ran')!r}, 'w')\n")
            ran = Path(folder) / "ran"
            process = subprocess.Popen(
                command, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )  # fmt: skip
            end = time.monotonic() + STARTED
            while not ran.exists() and process.poll() is None and time.monotonic() < end:
                time.sleep(0.1)
            yield Attempt(door, "modules in the current folder", ran.exists())
            process.kill()
            process.wait()


def folders() -> Iterator[Attempt]:
    """Locks of domains and kept tares, where others were first or come later."""
    plants: dict[str, Callable[[Path, Path], None]] = {
        "a link in its place": lambda folder, precious: folder.symlink_to(precious),
        "a folder that all may write": lambda folder, _: (folder.mkdir(), folder.chmod(0o777)),
    }
    if os.getuid() == 0:
        plants["a folder of another user"] = lambda folder, _: (
            folder.mkdir(0o700),
            os.chown(folder, NOBODY, NOBODY),
        )
    for how, plant in plants.items():
        with _temporary() as (temporary, precious):
            folder = temporary / f"tactile_dynamics_{os.getuid()}"
            plant(folder, precious)
            for door, code in _USERS.items():
                _run(code, temporary)
                there = {path.name for path in (*precious.iterdir(), *folder.iterdir())}
                spoilt = (precious / "kept").read_text() != "kept"
                yield Attempt(door, how, spoilt or there != {"kept"})
    with _temporary() as (temporary, precious):
        _run(_USERS["lock of a domain"], temporary)
        folder = temporary / f"tactile_dynamics_{os.getuid()}"
        for link in range(1, 100):
            (folder / f"domain_{link}").unlink(missing_ok=True)
            (folder / f"domain_{link}").symlink_to(precious / "kept")
        _run(_USERS["lock of a domain"], temporary)
        spoilt = (precious / "kept").read_text() != "kept"
        yield Attempt("lock of a domain", "links instead of locks", spoilt)
        if os.getuid() == 0:
            seen = subprocess.run(
                ["ls", str(folder)], user=NOBODY, group=NOBODY, capture_output=True, check=False
            )
            yield Attempt("folder of locks and tares", "another user lists it", not seen.returncode)


_USERS = {
    "lock of a domain": (
        "from tactile_dynamics_ros.cli.domain import private_domain\nwith private_domain(): pass"
    ),
    "kept tare": (
        "import numpy; from tactile_dynamics_ros.ros.object_memory import KeptTare\n"
        "KeptTare(4).write(numpy.zeros((5, 4, 44)))"
    ),
}
"""Programs that use the user's own folder, by what they use there."""


def _run(code: str, temporary: Path) -> None:
    """Run a program with a folder for temporary files and without one of the session."""
    environment = {k: v for k, v in os.environ.items() if k != "XDG_RUNTIME_DIR"}
    environment["TMPDIR"] = str(temporary)
    subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=False)


@contextmanager
def _temporary() -> Iterator[tuple[Path, Path]]:
    """A folder for temporary files, and one of a user's with a file in it."""
    made = Path(tempfile.mkdtemp())
    made.chmod(0o755)
    temporary, precious = made / "tmp", made / "precious"
    temporary.mkdir()
    temporary.chmod(0o1777)
    precious.mkdir()
    (precious / "kept").write_text("kept")
    try:
        yield temporary, precious
    finally:
        shutil.rmtree(made)


def requests() -> Iterator[Attempt]:
    """Targets that are none: answered with 400, without a traceback."""
    command = verb_command("view", "--port", "0", "--json")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, **pipes) as view:
        assert view.stdout is not None and view.stderr is not None
        port = urlsplit(json.loads(view.stdout.readline())["page"]).port or 0
        for target in ("http://[::1/", "//[/", "*", "/" + "a" * 100_000):
            with socket.create_connection(("127.0.0.1", port), timeout=20) as door:
                door.sendall(f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
                status = door.recv(12)
            yield Attempt("http", f"target {target[:20]}", status[9:10] not in (b"4", b""))
        view.send_signal(signal.SIGINT)
        yield Attempt("http", "a traceback for a request", "Traceback" in view.stderr.read())


def main() -> int:
    """Try all; print a row for each that was open.

    Returns:
        0 if none was.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="all attempts as JSON")
    options = parser.parse_args()
    tried = [one for kind in (pages, requests, processes, folders) for one in kind()]
    reached = [one for one in tried if one.reached]
    if options.json:
        print(json.dumps([asdict(one) for one in tried]))
    else:
        for one in reached:
            print(f"REACHED {one.door}: {one.how}")
        print(f"{len(tried)} tried, {len(reached)} reached")
    return 1 if reached else 0
