"""What all nodes share: which of the messages that came together are read."""

import ast
import inspect
import multiprocessing
import os
import re
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Vector3Stamped

from benchmarks.policy import node_class
from tactile_dynamics_ros.cli.bringup import node_names
from tactile_dynamics_ros.ros import shell, wire
from tactile_dynamics_ros.ros.inputs import Need
from tactile_dynamics_ros.ros.startup import introduce


def test_a_node_that_skims_reads_only_the_newest_where_that_is_allowed(bench, monkeypatch):
    node = bench.start(lambda: shell.Shell("skimmer"))
    read = {"skimmed": [], "newest_two": [], "whole": []}
    for (name, heard), skim in zip(read.items(), (1, 2, 0), strict=True):
        node.listen(
            Vector3Stamped, f"/{name}", lambda m, to=heard: to.append(m.values[0]), skim=skim
        )
    stamp = wire.Stamp(1, 0)
    waiting = [wire.encode_stamped(stamp, "world", np.full(3, float(k))) for k in range(4)]
    monkeypatch.setattr(
        shell, "take_messages", lambda *_: [shell.Taken(m, None, 0) for m in waiting]
    )
    node.work()
    node.skimming = True
    node.work()
    assert read["whole"] == [0, 1, 2, 3, 0, 1, 2, 3]
    assert read["newest_two"] == [0, 1, 2, 3, 2, 3]
    assert read["skimmed"] == [0, 1, 2, 3, 3]


@pytest.mark.parametrize("name", node_names())
def test_no_node_hides_what_is_private_to_all_nodes(name):
    """A node that has a `_look` of its own would never look for what its inputs lack."""
    own = {key for key in vars(node_class(name)) if re.match("_[a-z]", key)}
    for entry in ast.walk(ast.parse(inspect.getsource(node_class(name)))):
        stored = isinstance(entry, ast.Attribute) and isinstance(entry.ctx, ast.Store)
        if stored and ast.unparse(entry.value) == "self":
            own |= {entry.attr} if entry.attr.startswith("_") else set()
    assert own & set(dir(shell.Shell)) == set()


@pytest.mark.parametrize(("given", "kept"), [("SCHED_OTHER", "SCHED_BATCH"), ("SCHED_IDLE",) * 2])
def test_a_node_finishes_its_bursts_unless_another_policy_was_chosen(given, kept):
    context = multiprocessing.get_context("spawn")
    with context.Pool(1) as pool:
        found = pool.apply(policy_of_a_process_with, (getattr(os, given),))
    assert found == getattr(os, kept)


def policy_of_a_process_with(given):
    """Return the policy that a process with one has after starting a node."""
    os.sched_setscheduler(0, given, os.sched_param(0))
    shell.finish_bursts()
    return os.sched_getscheduler(0)


def test_messages_of_all_topics_are_read_in_the_order_in_which_they_came(bench):
    """A node that was held up finds seconds of each topic at once."""
    node, read = bench.start(lambda: shell.Shell("late")), []
    node.by_arrival = True
    for name in "ab":
        node.listen(Vector3Stamped, f"/{name}/force_std", lambda m: read.append(m.values[0]))
    for k in range(20):
        value = wire.encode_stamped(wire.Stamp(k + 1, 0), "world", np.full(3, float(k)))
        bench.send(f"/{'ab'[k % 2]}/force_std", value)
    bench.until(lambda: len(read) == 20)
    assert read == sorted(read)


def test_what_is_published_and_not_heard_is_listened_to_through_another_participant(bench):
    """As after a restart of which DDS did not tell the publisher."""
    node, read = bench.start(lambda: shell.Shell("deaf")), []
    for name in ("heard", "missed"):
        topic, take = f"/{name}/force_std", partial(read.append, name)
        node.listen(Vector3Stamped, topic, lambda _, take=take: take(), need=Need.ALWAYS)
    missed = node.listening[1]
    missed.source.patience = 0.5
    node.destroy_subscription(missed.subscription)
    missed.subscription = node.create_subscription(Vector3Stamped, "/elsewhere", print, 10)
    value = wire.encode_stamped(wire.Stamp(1, 0), "world", np.ones(3))

    def both_are_heard():
        for topic in ("/heard/force_std", "/missed/force_std"):
            bench.send(topic, value)
        return {"heard", "missed"} <= set(read)

    bench.until(both_are_heard)
    assert node.faults.counts["subscribed_anew"] >= 1
    assert [one.through is None for one in node.listening] == [True, False]


def test_a_count_that_begins_anew_is_counted_on(bench):
    faults = bench.start(lambda: shell.Shell("counting")).faults
    for total in (3, 5, 5, 2, 4):  # the one who counts was reset after 5
        faults.count("late", total)
    assert faults.counts["late"] == 9


def test_a_node_introduces_itself_in_one_line(bench):
    node = bench.start(lambda: shell.Shell("speaker"), "-r", "__ns:=/left")
    for finger in ("index", "thumb"):
        for kind in ("pose", "force"):
            node.listen(PoseStamped, f"contact/{finger}/{kind}", lambda _: None)
    node.listen(PoseStamped, "object/pose", lambda _: None)
    node.latched(PoseStamped, "/camera/target")
    node.serve("speaker/reset", lambda: "")
    assert introduce(node) == (
        "started; listens to contact/* (4), object/pose; publishes /camera/target; "
        "offers speaker/reset"
    )
    assert introduce(bench.start(lambda: shell.Shell("silent"))) == "started"


ENDING = """
import os, signal, sys, threading, time
from tactile_dynamics_ros.ros import shell

class Ending(shell.Shell):
    def __init__(self):
        {construct}
        super().__init__("ending")
        self.begun = False

    def process(self):
        if not self.begun:
            self.begun = True
            threading.Timer(0.1, os.kill, [os.getpid(), signal.SIGTERM]).start()
        {work}

    def destroy_node(self):
        {end}
        print("written")
        super().destroy_node()

shell.LONGEST_CALLBACK, shell.TIME_TO_END = 0.3, {limit}
sys.exit(shell.run_node(Ending))
"""
LONG = "time.sleep(60.0)"
STOPPED = "signal.raise_signal(signal.SIGINT)"


def end(limit=30.0, **parts):
    """Run a node that is asked to stop, with these lines in its methods.

    Its introduction, one line on standard error, is left out of what it says.
    """
    lines = dict.fromkeys(("construct", "work", "end"), "pass") | parts
    program = ENDING.format(limit=limit, **lines)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=50.0
    )
    introduced = re.findall(r".*\[ending\]: started\n", done.stderr)
    assert len(introduced) == ("construct" not in parts)
    done.stderr = done.stderr.replace("".join(introduced), "")
    return done


def test_a_node_that_is_asked_to_stop_finishes_its_callback():
    done = end(work="time.sleep(0.1); print('finished')")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-2:] == ["finished", "written"]


def test_a_callback_that_takes_long_is_left_and_the_file_is_written():
    done = end(work=LONG)
    assert (done.returncode, done.stdout, done.stderr) == (0, "written\n", "")


def test_a_node_that_still_starts_is_left_at_once():
    done = end(construct=f"{STOPPED}; {LONG}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_second_request_does_not_keep_a_node_from_writing_its_file():
    done = end(end=STOPPED)
    assert (done.returncode, done.stdout, done.stderr) == (0, "written\n", "")


def test_a_node_that_hangs_while_it_ends_says_where_and_ends():
    done = end(end=LONG, limit=0.3)
    assert done.returncode == 1
    assert "in destroy_node" in done.stderr
