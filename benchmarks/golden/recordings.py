"""Small recordings of every kind, the same at every call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.support.conventions import mistaken
from benchmarks.support.regimes import generate_in_regime
from benchmarks.support.static_poses import StaticLoad, weigh_poses
from benchmarks.support.tables import WristOptions, wrist_table
from tactile_dynamics_ros.core.streams.joining import cut_streams
from tactile_dynamics_ros.core.streams.streams import Streams
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.pushed import PushedRecording
from tactile_dynamics_ros.synthetic import generate_at_whitened_rms
from tactile_dynamics_ros.synthetic.pushed.actions import ActionOptions
from tactile_dynamics_ros.synthetic.pushed.recordings import PushOptions
from tactile_dynamics_ros.synthetic.pushed.recordings import generate as generate_pushes
from tactile_dynamics_ros.synthetic.scenario import ScenarioOptions
from tactile_dynamics_ros.synthetic.sensors import SensorOptions

Made = Callable[[], Recording | PushedRecording]
TEN_SECONDS = ScenarioOptions(duration=10.0)
"""The shortest recordings in which every effect shows."""


def held(
    seed: int,
    effects: Mapping[str, float],
    scenario: ScenarioOptions = TEN_SECONDS,
    sensors: SensorOptions | None = None,
) -> Recording:
    """An object in four fingers; effects raise the error to what they come with."""
    made = generate_at_whitened_rms(seed, dict(effects), scenario, sensors)
    return Recording(made.streams, "made")


def in_regime(seed: int, case: str) -> Recording:
    """An object in four fingers with an effect that acts in a regime."""
    return Recording(generate_in_regime(seed, case).streams, "made")


def wrist(seed: int, mistake: str = "", **options: object) -> Recording:
    """A load on a wrist sensor whose zero is off, perhaps written down wrongly."""
    chosen = WristOptions(**({"bias_n": 4.0, "bias_nm": 0.1} | options))  # type: ignore[arg-type]
    table, _ = wrist_table(seed, chosen)
    return Recording((mistaken(table, mistake, seed) if mistake else table).streams(), "made")


def static(seed: int, wrong_row: bool = False) -> Recording:
    """Twelve poses of a load at rest."""
    table = weigh_poses(StaticLoad.draw(seed), 12, seed)
    force = table.force.copy()
    force[3] *= -1.0 if wrong_row else 1.0
    return Recording.from_static_poses(force, table.torque, rotation=table.rotation)


def pushed(seed: int, effects: Mapping[str, float], kind: str = "single") -> PushedRecording:
    """Four pushes on a table; effects have what they come with of their typical sizes."""
    options = PushOptions(kind=kind, actions=ActionOptions(count=4))
    made = generate_pushes([seed], dict(effects), options)[0]
    return PushedRecording(made.streams, "made")


def _changed(recording: Recording, change: Callable[[Streams], Streams]) -> Recording:
    return replace(recording, streams=change(recording.streams))


def _without_thumb(streams: Streams) -> Streams:
    kept = {name: one for name, one in streams.contacts.items() if name != "thumb"}
    return replace(streams, contacts=kept)


def _at_rest(streams: Streams) -> Streams:
    assert streams.pose is not None
    still = np.zeros(len(streams.pose.time), dtype=int)
    pose = replace(
        streams.pose,
        position=streams.pose.position[still],
        rotation=streams.pose.rotation[still],
    )
    return replace(streams, pose=pose)


RECORDINGS: dict[str, Made] = {
    "held_clean": partial(held, 1, {}),
    "held_drag": partial(held, 2, {"viscous_drag": 2.0}),
    "held_bias": partial(held, 3, {"force_bias": 2.0}),
    "held_spring": partial(held, 4, {"tether_spring": 2.0}),
    "held_late": partial(held, 5, {"time_offset": 2.0}),
    "held_sloshing": partial(held, 6, {"sloshing_mass": 2.0}),
    "held_two": partial(held, 7, {"force_scale": 2.0, "hanging_cable": 2.0}),
    "held_outside": partial(held, 8, {"dipole_pull": 2.0}),
    "held_fast": partial(
        held, 9, {}, sensors=SensorOptions(force_rate_hz=500.0, pose_rate_hz=50.0)
    ),
    "held_unstated": partial(held, 10, {}, sensors=SensorOptions(state_force_std=False)),
    "regime_water": partial(in_regime, 11, "drag below the water line"),
    "regime_gain": partial(in_regime, 12, "gain too high under load"),
    "wrist_clean": partial(wrist, 13),
    "wrist_cable": partial(wrist, 14, effects=(("hanging_cable", 1.0),)),
    "wrist_imu": partial(wrist, 15, imu=True),
    "wrist_pounds": partial(wrist, 16, "force_unit"),
    "wrist_mirrored": partial(wrist, 17, "mirrored_axes"),
    "wrist_inverse": partial(wrist, 18, "inverse_rotation"),
    "event_zeroed": partial(wrist, 19, zeroed_at=8.0),
    "event_payload": partial(wrist, 20, effects=(("payload_change", 1.0),)),
    "event_shift": partial(wrist, 21, effects=(("grasp_shift", 1.0),)),
    "static": partial(static, 22),
    "static_wrong_row": partial(static, 23, wrong_row=True),
    "pushed_clean": partial(pushed, 24, {}),
    "pushed_lean": partial(pushed, 25, {"support_tilt": 2.0}),
    "pushed_jointed": partial(pushed, 26, {}, kind="jointed"),
    "bad_short": lambda: _changed(held(27, {}), lambda s: cut_streams(s, 4.0, 4.5)),
    "bad_at_rest": lambda: _changed(held(28, {}), _at_rest),
    "bad_three_fingers": lambda: _changed(held(29, {}), _without_thumb),
}
"""By name; each is made from its own seed."""
