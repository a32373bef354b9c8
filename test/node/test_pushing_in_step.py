"""A simulated arm that an explorer moves: a busy machine changes nothing of what happens."""

import numpy as np
import pytest
from std_srvs.srv import Trigger

pytest.importorskip("pybullet")

from tactile_dynamics_ros.nodes import explorer, robot_sim
from tactile_dynamics_ros.ros.names import EXPLORE_CHANGE

TABLE = {"scene": "table", "object_number": 121, "vision_rate_hz": 30.0, "noise": "false"}
SWIFT = {"length": 0.04, "way.travel_speed": 0.6, "way.clearance": 0.06, "way.acceleration": 4.0}
PARAMETERS = {"robot_sim": TABLE | {"real_time_factor": 4.0}, "explorer": SWIFT}
ARGUMENTS = [
    word
    for node, values in PARAMETERS.items()
    for key, value in values.items()
    for word in ("-p", f"{node}:{key}:={value}")
]


def moved(bench, held_up):
    """Places (N, 3) of the tip, m, one each period of its motion, and how many targets were late.

    Args:
        bench: of the test.
        held_up: 4 ms each, for up to so many of which the explorer does nothing again and again.
    """
    sim, pushing = bench.start(robot_sim.RobotSim, *ARGUMENTS), explorer.ExplorerNode()
    places, said, rng = [], [], np.random.default_rng(0)
    table, scene, advance = sim.scene.table, pushing.scene, sim.scene.table.advance

    def noted(**options):
        places.append(table.pusher.frame[:3].copy())
        return advance(**options)

    table.advance, pushing._tell = noted, lambda *words: said.append(words)
    bench.nodes[:] = both = [sim, pushing]
    bench.until(lambda: scene._tip is not None and scene._object and scene._footprint is not None)
    service = next(s for s in pushing.services if s.srv_name == EXPLORE_CHANGE)
    service.callback(Trigger.Request(), Trigger.Response()).send(None)
    bench.until(lambda: said and said[-1][0] == "pushing")
    while said[-1][0] == "pushing":
        bench.nodes[:] = [sim]
        for _ in range(int(rng.integers(held_up + 1))):
            bench.work(0.004)
        bench.nodes[:] = both
        bench.work(0.002)
    assert "waiting" in [words[0] for words in said], said  # for an estimate: the push was made
    for node in both:
        node.destroy_node()
    bench.nodes.clear()
    going = np.linalg.norm(np.diff(places, axis=0), axis=1) > 1e-9
    return np.array(places[np.flatnonzero(going)[0] :]), sim.pace.late


def test_the_tip_goes_the_same_way_whether_the_explorer_is_held_up_or_not(bench):
    smooth, late = moved(bench, 0)
    busy, more = moved(bench, 15)
    assert (late, more) == (0, 0)
    count = min(len(smooth), len(busy))
    assert count > 200
    np.testing.assert_allclose(busy[:count], smooth[:count], atol=1e-9)
