"""A table begins to lean: with the lean in the model, the live error falls below what it was."""

import numpy as np
import pytest

pytest.importorskip("pybullet")

from benchmarks.explore.changes import Watched  # noqa: E402
from tactile_dynamics_ros.core.planar.diagnosis.changed import ChangeCheck  # noqa: E402
from tactile_dynamics_ros.core.planar.properties.estimate import PushedEstimate  # noqa: E402
from tactile_dynamics_ros.sim.objects import planar_object  # noqa: E402
from tactile_dynamics_ros.sim.planar.simulated_table import SimulatedTableConfig  # noqa: E402

pytestmark = pytest.mark.slow
NUMBER = 18
STD = np.array([0.05, 0.15, 1e-3, 1e-3])
"""Of ln friction force, ln mass and centre of mass, m: what fits to five pushes state."""


def known(seed):
    """What a fit to pushes before the change could have told."""
    part, rng = planar_object(NUMBER).parts[0], np.random.default_rng(seed)
    off = STD * rng.standard_normal(4)
    mass, force = part.mass * np.exp(off[1]), 9.81 * part.mass * part.friction * np.exp(off[0])
    values = {
        "mass": (mass, STD[1] * mass),
        "friction": (force / mass / 9.81, 0.03),
        "friction_force_n": (force, STD[0] * force),
        "com_x": (part.com[0] + off[2], STD[2]),
        "com_y": (part.com[1] + off[3], STD[3]),
        "friction_radius_m": (0.04, 1e-3),
        "inertia_zz": (1e-3, 4e-4),
    }
    return PushedEstimate(400, 5.0, values, (), np.diag(np.square(STD)), 0.9)


@pytest.fixture(scope="module")
def leant():
    """Pushes before and after a lean of 4 deg, as the nodes see them; the lean (2,) rad."""
    config = SimulatedTableConfig(
        seed=702, object_number=NUMBER, hidden_effect="support_tilt", hidden_magnitude=2.0,
        hidden_waits=True, friction_spread=0.05, vision_rate_hz=30.0, depth_rate_hz=0.0,
    )  # fmt: skip
    watched = Watched(config)
    watched.push()
    watched.live.take_fit(known(5))
    watched.table.begin()
    while watched.live.changed is None:
        watched.push()
    for _ in range(2):
        watched.push()
    truth = watched.table.reveal()["hidden_effect"]["parameters"]
    yield watched, truth["angle"]["value"] * np.array(truth["direction"]["value"])
    watched.table.world.close()


def test_the_live_error_falls_once_the_lean_is_in_the_model(leant):
    watched, lean = leant
    live = watched.live
    live.set_effects(["support_tilt"])
    watched.fit()
    assert live.refused == ""
    assert live.fit.error < 0.85 * live.fit.error_without
    told = live.fit.effects["support_tilt"]
    assert [told[axis]["value"] for axis in ("t_x", "t_y")] == pytest.approx(lean, abs=0.017)
    part = planar_object(NUMBER).parts[0]
    mass, std = live.fit.values["mass"]
    assert abs(mass - part.mass) < 2.6 * std  # no heavy object on ice
    assert std < 0.3 * mass


def test_the_error_that_model_check_publishes_falls(leant):
    watched, _ = leant
    check = ChangeCheck(watched.live.changed.since)
    streams = watched.window.streams()
    without = check.compare(streams, ()).whitened_rms
    with_it = check.compare(streams, ("support_tilt",)).whitened_rms
    assert with_it < 0.85 * without
