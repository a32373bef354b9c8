"""A table or object that changes while it is pushed: false alarms, delays, and what is named."""

from __future__ import annotations

import argparse
import json
import sys
import time
from itertools import product
from typing import Any

import numpy as np

from benchmarks.support.pushing_robot import PushOptions, drawn_action, perform
from tactile_dynamics_ros.core.errors import NotIdentifiableError, TactileDynamicsError
from tactile_dynamics_ros.core.planar.diagnosis.changed import diagnose_change
from tactile_dynamics_ros.core.planar.filter.live import LiveProperties
from tactile_dynamics_ros.core.planar.filter.record import PushWindow
from tactile_dynamics_ros.core.planar.filter.tracker import ContactForce
from tactile_dynamics_ros.core.planar.properties.estimate import estimate
from tactile_dynamics_ros.sim.planar.simulated_table import (
    SimulatedTable,
    SimulatedTableConfig,
    TableReadings,
)

SIZES = {"support_tilt": 2.0, "none": 0.0}
"""Multiples of the typical size: 4 degrees of tilt; effects that are not here come at 1.35."""
PUSHES = PushOptions(speed=(0.05, 0.2), travel=(0.05, 0.07), height_share=0.4)
KNOWN, MORE, AFTER, FOR_NAME = 5, 3, 6, 3
"""Pushes before the reference, more of them where fits do not come to an end, after the change at
most, and after the alarm for the diagnosis."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the section's options."""
    parser.add_argument("--changes", nargs="+", default=["none", "support_tilt"], help="effects")
    parser.add_argument("--changing", type=int, nargs="+", default=[121, 122, 123], help="objects")
    parser.add_argument("--change-seeds", type=int, nargs="+", default=[501], help="of each")
    parser.add_argument("--spreads", type=float, nargs="+", default=[0.05], help="of friction")
    parser.add_argument("--clean", type=int, default=6, help="pushes before the change")
    parser.add_argument("--diagnosed-changes", action="store_true", help="name them: minutes each")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """One row for each effect, object, seed and spread; rows go to standard error too."""
    rows = []
    cases = product(options.spreads, options.change_seeds, options.changing, options.changes)
    for spread, seed, number, effect in list(cases)[: 1 if options.quick else None]:
        row = _row(number, seed, effect, spread, options)
        print(json.dumps(row), file=sys.stderr, flush=True)
        rows.append(row)
    return {"rows": rows}


class Watched:
    """A simulated table, pushed without ROS, with what is known of its object live."""

    def __init__(self, config: SimulatedTableConfig) -> None:
        self.table = SimulatedTable(config)
        self.live, self.window = LiveProperties(), PushWindow(60.0)
        for each in (self.live, self.window):
            each.set_outline(self.table.outlines[0].corners)
        covariance = self.table.markers[0].covariance
        self._std = np.sqrt([covariance[3, 3], covariance[4, 4], covariance[2, 2]])
        self._rng, self._count = np.random.default_rng([config.seed, 97]), 0
        self.statistics: list[float] = []

    def push(self) -> None:
        """Make a push that is drawn, and let a second pass."""
        action = drawn_action(self.table, PUSHES, self._count, self._rng)
        self._count += 1
        self.table.pusher.place(action.legs[0].start, action.legs[0].width)
        for readings in perform(self.table, action):
            self._take(readings)
        for _ in range(120):
            self._take(self.table.advance(looking=False))

    def refer(self) -> None:
        """Push until a fit says what is known, as the node does after each push.

        Raises:
            NotIdentifiableError: the pushes do not tell.
        """
        for count in range(1, KNOWN + MORE):
            self.push()
            if count >= KNOWN:
                self.fit()
            if self.live.fit is not None:
                return
        raise NotIdentifiableError(self.live.refused)

    def fit(self) -> None:
        """Fit what is due, as the node does after each push; take the fit or why there is none."""
        streams = self.live.due(self.live.newest)
        if streams is None:
            return
        try:
            self.live.take_fit(estimate(streams, self.live.effects, self.live.known))
        except NotIdentifiableError as error:
            self.live.take_fit(None, str(error))

    def _take(self, readings: TableReadings) -> None:
        for each in (self.live, self.window):
            pusher = np.array([*readings.pusher[:3, 3], 0.0])
            each.add_pusher(readings.time, pusher)
            for pose in (pose for pose in readings.links[:1] if pose is not None):
                flat = np.array([*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])])
                each.add_pose(readings.links_time, flat, self._std)
            for measured in (measured for measured in readings.touch if measured.name == "pusher"):
                force = measured.force if measured.touching else np.zeros(3)
                std, pose = np.full(3, self.table.sensors.force_std), measured.pose
                each.add_contact(
                    ContactForce("pusher", measured.time, force, std, pose[:3, 3], pose[:3, 2])
                )
        self.live.advance(readings.time - 0.02)
        change = self.live.monitor.change
        told = 0.0 if change is None else change.statistic
        if not self.statistics or told != self.statistics[-1]:
            self.statistics.append(told)


def _row(
    number: int, seed: int, effect: str, spread: float, options: argparse.Namespace
) -> dict[str, Any]:
    watched = Watched(
        SimulatedTableConfig(
            seed=seed, object_number=number, hidden_effect=effect, friction_spread=spread,
            hidden_magnitude=SIZES.get(effect, 1.35), hidden_waits=True, vision_rate_hz=30.0,
            depth_rate_hz=0.0,
        )
    )  # fmt: skip
    part = watched.table.reveal()["links"][0]
    row: dict[str, Any] = {"object": number, "seed": seed, "effect": effect, "spread": spread}
    row["friction"] = part["friction"]
    try:
        watched.refer()
        return row | _watched(watched, effect, options)
    except TactileDynamicsError as error:
        return row | {"refused": str(error)}
    finally:
        watched.table.world.close()


def _watched(watched: Watched, effect: str, options: argparse.Namespace) -> dict[str, Any]:
    """Statistics of clean pushes, then of those after the change."""
    live = watched.live
    for _ in range(options.clean if effect != "none" else 2 * options.clean):
        watched.push()
        if live.changed is not None:
            return {
                "false_alarm": True,
                "clean_s": live.changed.touch,
                "statistics": watched.statistics,
            }
    row: dict[str, Any] = {"clean_s": live.monitor.touch, "clean_most": max(watched.statistics)}
    row["statistics"] = [round(value, 2) for value in watched.statistics]
    if effect == "none":
        return row | {"false_alarm": False}
    watched.table.begin()
    begun, before = watched.table.world.time, live.monitor.touch
    pushes = 0
    while live.changed is None and pushes < AFTER:
        watched.push()
        pushes += 1
    row |= {"false_alarm": False, "truth": watched.table.reveal()["hidden_effect"]["parameters"]}
    row["after"] = [round(value, 2) for value in watched.statistics[-12:]]
    if live.changed is None:
        return row | {"detected": False, "pushes": pushes}
    contact = live.changed.touch - before
    row |= {"detected": True, "pushes": pushes, "contact_s": round(contact, 2)}
    row["since_s"] = live.changed.since - begun
    return row | (_named(watched) if options.diagnosed_changes else {})


def _named(watched: Watched) -> dict[str, Any]:
    """What three more pushes let the diagnosis say."""
    for _ in range(FOR_NAME):
        watched.push()
    change = watched.live.changed
    assert change is not None
    document = diagnose_change(watched.window.streams(), (), change.since)
    told = [c["parameters"] for c in document["candidates"] if c["name"] == document["effect"]]
    keys = ("verdict", "effect", "group", "error")
    named = {key: document[key] for key in keys} | {"parameters": told[:1]}
    return {"named": named} | (_taken_over(watched, document["effect"]) if told else {})


def _taken_over(watched: Watched, effect: str) -> dict[str, Any]:
    """Error of the live fit without and with a named effect, or why there is no such fit."""
    live, began = watched.live, time.thread_time()
    live.set_effects([effect])
    watched.fit()
    seconds = round(time.thread_time() - began, 1)
    if live.fit is None:
        return {"live": {"refused": live.refused, "seconds": seconds}}
    errors = {"without": live.fit.error_without, "with": live.fit.error, "seconds": seconds}
    return {"live": errors | {"parameters": live.fit.effects}}


def table(found: dict[str, Any]) -> str:
    """Alarms and delays as Markdown."""
    head = "| hidden | spread | n | clean touch s, false alarms | detected | within 3 s | named |"
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    cases = {(row["effect"], row["spread"]): None for row in found["rows"] if "refused" not in row}
    for effect, spread in cases:
        rows = [
            row for row in found["rows"]
            if (row["effect"], row["spread"]) == (effect, spread) and "refused" not in row
        ]  # fmt: skip
        alarms = sum(row["false_alarm"] for row in rows)
        clean = sum(row.get("clean_s", 0.0) for row in rows)
        seen = [row for row in rows if row.get("detected")]
        soon = sum(row["contact_s"] <= 3.0 for row in seen)
        told = [row["named"] for row in seen if "named" in row]
        named = sum(effect in (each["effect"], *each["group"]) for each in told)
        lines.append(
            f"| `{effect}` | {spread:g} | {len(rows)} | {clean:.0f}, {alarms} | {len(seen)} "
            f"| {soon} | {f'{named} of {len(told)}' if told else ''} |"
        )
    return "\n".join(lines)
