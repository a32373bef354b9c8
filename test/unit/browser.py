"""A headless Chromium that tests drive over its DevTools socket."""

import base64
import json
import shutil
import subprocess
import time
import urllib.request
from contextlib import contextmanager

import pytest

FLAGS = ("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--window-size=1500,950")
FLAGS += ("--enable-unsafe-swiftshader", "--remote-debugging-port=0", "about:blank")


class Browser:
    """One tab."""

    def __init__(self, socket):
        self._socket, self._count = socket, 0
        self.call("Page.enable")

    def call(self, method, **parameters):
        self._count += 1
        call = {"id": self._count, "method": method, "params": parameters}
        self._socket.send(json.dumps(call))
        while True:
            answer = json.loads(self._socket.recv(timeout=120))
            if answer.get("id") == self._count:
                return answer["result"]

    def open(self, address):
        self.call("Page.navigate", url=address)

    def value(self, expression):
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return found["result"].get("value")

    @property
    def text(self):
        return self.value("document.body ? document.body.innerText : ''") or ""

    def wait_for(self, text, seconds=90.0):
        """Return once the page shows a text; fail with what it shows."""
        deadline = time.monotonic() + seconds
        while text not in self.text:
            assert time.monotonic() < deadline, f"no '{text}' in: {self.text}"
            time.sleep(0.3)

    def wait_until(self, expression, seconds=90.0):
        """Return once an expression is true on the page."""
        deadline = time.monotonic() + seconds
        while not self.value(expression):
            assert time.monotonic() < deadline, f"never {expression}: {self.text}"
            time.sleep(0.3)

    def resize(self, width, height):
        """Show the page as a screen of this size in pixels would, a phone's too."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1}
        self.call("Emulation.setDeviceMetricsOverride", mobile=width < 600, **metrics)

    def click(self, text):
        """Press the button with a text."""
        button = (
            f"[...document.querySelectorAll('button')].find(b => b.innerText.trim() == '{text}')"
        )
        assert self.value(f"{button} !== undefined"), f"no button '{text}'"
        self.value(f"{button}.click()")

    def screenshot(self):
        """Return the tab as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])


@contextmanager
def chromium(folder):
    """A browser; tests are skipped with a line where none is installed."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("no Chromium is installed (Debian, Ubuntu: apt install chromium)")
    from websockets.sync.client import connect

    command = [program, f"--user-data-dir={folder}", *FLAGS]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = int(_wait(lambda: (folder / "DevToolsActivePort").read_text().split()[0]))
        tabs = _wait(lambda: json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json")))
        address = next(t["webSocketDebuggerUrl"] for t in tabs if t["type"] == "page")
        with connect(address, max_size=None) as socket:
            yield Browser(socket)
    finally:
        process.kill()
        process.wait()


def _wait(attempt, seconds=60.0):
    deadline = time.monotonic() + seconds
    while True:
        try:
            return attempt()
        except (OSError, IndexError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
