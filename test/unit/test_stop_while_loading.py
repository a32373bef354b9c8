"""A node that is stopped while its libraries load ends with 0, whatever they do about it."""

import subprocess
import sys

import pytest

PROGRAM = """
import os, signal
from tactile_dynamics_ros.ros import executable

class Node:
    main = staticmethod(lambda: print("ran") or 7)

def load(name):
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except BaseException:
        {answer}
    return Node

executable.importlib.import_module = load
executable.start("any")
"""


@pytest.mark.parametrize("answer", ["pass", "raise ImportError('initialization failed')"])
def test_a_library_that_catches_the_stop_changes_nothing(answer):
    words = [sys.executable, "-c", PROGRAM.format(answer=answer)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
