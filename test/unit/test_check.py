"""What `check` says of a recording before the experiment is over."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import tactile_dynamics_ros as td
from benchmarks.support.planned import record_plan
from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.core.inertia.batch.batch import fit_body
from tactile_dynamics_ros.core.inertia.batch.inertial_estimate import PARAMETER_NAMES
from tactile_dynamics_ros.core.inertia.excitation.addition import SimpleMotion
from tactile_dynamics_ros.core.inertia.excitation.continuation import Continuation
from tactile_dynamics_ros.core.streams.joining import join_streams
from tactile_dynamics_ros.recording import Recording
from tactile_dynamics_ros.recording.rates import StreamRate
from tactile_dynamics_ros.synthetic import ScenarioOptions, SensorOptions, generate
from tactile_dynamics_ros.synthetic.recordings import write_bag

CALM = ScenarioOptions(duration=4.0, band_hz=(0.2, 1.0), angle_peak_deg=(5.0, 15.0))


@pytest.fixture(scope="module")
def calm():
    return generate(700, {}, CALM)


@pytest.fixture(scope="module")
def checked(calm):
    return td.check(Recording(calm.streams, "calm"), goal=0.15)


def test_a_motion_brings_what_was_promised(calm, checked):
    addition = checked.additions[0]
    plan = addition.to_json() | {"kind": "motion"}
    second = record_plan(calm, plan, SensorOptions())
    both = fit_body(join_streams([calm.streams, second.streams])).to_estimate()
    index = PARAMETER_NAMES.index(addition.parameter)
    now = checked.estimate.found.parameter_std[index]
    assert addition.promised < 0.5 * now
    assert 1 / 1.5 < both.parameter_std[index] / addition.promised < 1.5


def test_the_worst_parameter_is_helped_first_and_lines_say_how(checked):
    worst = max(checked.relative, key=checked.relative.get)
    assert checked.additions[0].parameter == worst == "inertia_zz"
    line = next(line for line in checked.lines() if line.startswith("inertia about z"))
    promised = 100 * checked.to_json()["additions"][0]["expected_relative"]
    assert "10 s more turning about z by" in line
    assert line.endswith(f"would bring it to {promised:.2g} %")
    assert line in checked.to_json()["advice"]


def test_what_is_printed_is_what_estimate_gives(calm, checked):
    std = fit_body(calm.streams).to_estimate().parameter_std
    printed = [entry["std"] for entry in checked.to_json()["parameters"].values()]
    np.testing.assert_allclose(printed, std, rtol=1e-9)


def test_a_goal_that_is_met_is_ready_and_proposes_nothing(checked):
    met = replace(checked, goal=1.0)
    assert met.ready and not checked.ready
    assert met.lines()[-1] == "ready"
    assert "not ready" in checked.headline()


def test_simulated_streams_have_the_rates_and_the_noise_of_the_recording(calm):
    held = Continuation.of(calm.streams, fit_body(calm.streams))
    offsets = SimpleMotion(0, True, 0.3, 0.5).offsets(held.start.rotation)
    made = held.record(offsets, seed=1)
    exact = held.move(offsets, made.pose.time)
    spread = np.std(made.pose.position - exact.position, axis=0)
    np.testing.assert_allclose(spread, 0.0005, rtol=0.2)
    force = made.contacts["thumb"]
    k = held.grip.names.index("thumb")
    loads = held.move(offsets, force.time)
    true = np.einsum("nij,nj->ni", loads.rotation, loads.contact_force[:, k])
    np.testing.assert_allclose(np.std(force.force - true, axis=0), 0.03, rtol=0.2)
    recorded = calm.streams.contacts["thumb"]
    assert np.median(np.diff(force.time)) == pytest.approx(np.median(np.diff(recorded.time)))


def test_a_wrist_carries_force_and_torque_of_the_motion():
    from tactile_dynamics_ros.core.rigid_body.newton_euler import regressor

    made = generate(701, {}, CALM)
    held = Continuation.of(made.streams, fit_body(made.streams))
    name = held.grip.names[0]
    wrist = replace(made.streams.contacts[name], carries_torque=True)
    grip = replace(
        held.grip,
        names=(name,),
        point=held.grip.point[:1],
        normal=held.grip.normal[:1],
        squeeze=np.zeros((1, 3)),
    )
    one = replace(held, streams=replace(made.streams, contacts={name: wrist}), grip=grip)
    moved = one.move(SimpleMotion(1, True, 0.4, 1.0).offsets(np.eye(3)), np.arange(0.0, 5.0, 0.1))
    motion = regressor(
        moved.specific_acceleration, moved.angular_velocity, moved.angular_acceleration
    )
    np.testing.assert_allclose(moved.measured_wrench, motion @ held.model.phi, atol=1e-9)


@pytest.mark.parametrize(
    ("effect", "size", "blamed"), [("time_offset", 2.0, True), ("viscous_drag", 2.0, False)]
)
def test_clocks_are_blamed_for_a_delay_and_not_for_a_drag(effect, size, blamed):
    made = generate(31, {effect: size}, ScenarioOptions(duration=5.0))
    found = td.check(Recording(made.streams, "late"))
    assert any("stamps of forces and motion" in fault for fault in found.faults) is blamed
    assert found.additions == (), "nothing is promised where the model does not fit"


def test_gaps_are_counted_and_their_share_of_the_time():
    time = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(1.5, 2.0, 0.01)])
    rate = StreamRate.of("force", time)
    assert (rate.samples, rate.gaps) == (150, 1)
    assert rate.rate_hz == pytest.approx(100.0)
    assert rate.longest_gap_s == pytest.approx(0.51)
    assert rate.lost_share == pytest.approx(0.5 / 1.99, rel=0.01)
    assert "1 gaps, the longest 0.51 s" in rate.words
    assert StreamRate.of("lost", time[:1]).gaps == 0


def test_the_exit_code_tells_scripts_whether_to_go_on(calm, tmp_path, capsys):
    bag = write_bag(calm.streams, tmp_path / "calm")
    assert main(["check", str(bag), "--goal", "90", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ready"] is True
    assert main(["check", str(bag), "--goal", "0"]) == 2
    assert main(["check", str(bag), "--effects", "viscous_drag"]) == 2


def test_a_motion_that_leaves_the_parameter_undetermined_is_not_proposed(checked, monkeypatch):
    from tactile_dynamics_ros.core.inertia.excitation import addition

    useless = replace(checked.additions[0], undetermined=("inertia_zz",))
    asked = []

    def best_for(parameter, held):
        asked.append(parameter)
        return replace(useless, parameter=parameter)

    monkeypatch.setattr(addition, "_best_for", best_for)
    found = addition.propose_additions(None, checked.estimate.found, 0.15)
    assert asked[0] == "inertia_zz"
    assert "inertia_zz" not in [each.parameter for each in found]
