"""Effects of one's own: formulas in yaml, classes in files, entry points, and their commands."""

from __future__ import annotations

import json
import time
from argparse import Namespace
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
import yaml
from synthetic_recording import held_box

from tactile_dynamics_ros.cli.main import main
from tactile_dynamics_ros.cli.recordings import pushed_effects
from tactile_dynamics_ros.core.effects import create_effect, registered_names, registry
from tactile_dynamics_ros.core.effects.check import (
    check_effect,
    example_inertia,
    example_samples,
)
from tactile_dynamics_ros.core.effects.formula import load_effects
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.friction.effects import FRICTION
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.recording import Recording

SAMPLES = example_samples()
INERTIA = example_inertia()

TWINS = """
effects:
  my_viscous_drag:
    parameters: {c: {unit: N s/m, prior_std: 10, typical: 1}}
    wrench: {axes: world, force: -c*v}
  my_quadratic_drag:
    parameters: {c: {unit: N s^2/m^2, prior_std: 20}}
    wrench: {axes: body, force: ["-c*speed*v_x", "-c*speed*v_y", "-c*speed*v_z_body"]}
  my_rotational_drag:
    parameters: {c: {unit: N m s/rad, prior_std: 0.1}}
    wrench: {torque: -c*omega}
  my_spinning_rotor:
    parameters: {h: {unit: kg m^2/s, prior_std: 0.1, vector: true}}
    wrench: {torque: "-cross(omega, h)"}
  my_hanging_cable:
    parameters:
      F: {unit: N, prior_std: 5, typical: 0.5, vector: true}
      b: {unit: m, prior_std: 1e-1, typical: 4e-2, vector: true}
    wrench: {axes: world, at: b, force: F}
  my_added_mass:
    parameters: {extra: {unit: kg, prior_std: 1, typical: 0.15}}
    wrench: {axes: world, force: -extra*a}
  my_contact_torsion:
    parameters:
      mu: {unit: m, prior_std: 0.05, typical: 0.004}
      w_0: {unit: rad/s, prior_std: 3, typical: 0.3}
    constants: {slow: {value: 0.01, unit: rad/s}}
    definitions: {level: "tanh(spin/max(abs(w_0), slow))"}
    wrench: {axes: contact, at: contacts, torque: [0, 0, -mu*grip*level]}
"""


def load(tmp_path: Path, text: str):
    path = tmp_path / "own.yaml"
    path.write_text(text)
    return load_effects(path)


def drag(**changes) -> str:
    """Return a file of one effect with some lines replaced."""
    lines = {
        "parameters": "{c: {unit: N s/m, prior_std: 10}}",
        "wrench": "{axes: world, force: -c*v}",
        **changes,
    }
    body = "\n".join(f"    {key}: {value}" for key, value in lines.items())
    return f"effects:\n  own_drag:\n{body}\n"


def test_formulas_equal_the_classes_of_the_catalogue(tmp_path):
    effects = load(tmp_path, TWINS)
    assert len(effects) == 7
    for effect in effects:
        twin = create_effect(effect.name.removeprefix("my_"))
        theta = twin.typical(SAMPLES)
        for method in ("wrench", "jacobian", "inertia_jacobian"):
            own, other = (getattr(e, method)(SAMPLES, INERTIA, theta) for e in (effect, twin))
            np.testing.assert_allclose(own, other, atol=1e-10, err_msg=f"{effect.name} {method}")


def test_formulas_pass_the_contract(tmp_path):
    wind = """
  my_wind:
    parameters:
      c: {unit: N s^2/m^2, prior_std: 20, typical: 3}
      w: {unit: m/s, prior_std: 1, typical: 0.1, vector: true}
    definitions: {u: v - w}
    wrench: {axes: world, at: com, force: -c*norm(u)*u}
  my_gain:
    parameters: {gain: {unit: "1", prior_std: 0.5}}
    wrench:
      - {at: r_thumb, force: -gain*f_thumb}
      - {at: com, force: gain*m*g, axes: world}
"""
    for effect in load(tmp_path, TWINS + wind):
        report = check_effect(effect)
        assert report.passed, str(report)


def test_refits_start_near_the_truth(tmp_path):
    for effect in load(tmp_path, TWINS):
        truth = 1.5 * effect.typical(SAMPLES)
        target = effect.wrench(SAMPLES, INERTIA, truth)
        basis = effect.screening_basis(SAMPLES, INERTIA)
        columns = basis.reshape(-1, basis.shape[2])
        coefficients = np.linalg.lstsq(columns, target.ravel(), rcond=None)[0]
        start = effect.initial_guess(SAMPLES, INERTIA, coefficients, target)
        reached = effect.wrench(SAMPLES, INERTIA, start)
        assert np.linalg.norm(reached - target) < 0.1 * np.linalg.norm(target), effect.name


def test_contacts_that_do_not_touch_add_nothing(tmp_path):
    (effect,) = load(
        tmp_path,
        drag(
            parameters="{k: {unit: N m s/rad, prior_std: 1}}",
            wrench="{at: contacts, torque: -k*spin*n}",
        ),
    )
    lifted = np.ones_like(SAMPLES.in_contact)
    lifted[:, 1:] = False
    one = effect.wrench(replace(SAMPLES, in_contact=lifted), INERTIA, np.ones(1))
    normal = SAMPLES.contact_rotation[:, 0, :, 2]
    spin = np.einsum("ni,ni->n", normal, SAMPLES.angular_velocity)
    np.testing.assert_allclose(one[:, :3], -spin[:, None] * normal, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (drag(parameters="{c: {unit: kg, prior_std: 10}}"), r"wrench.force: .*kg m s\^-1.*N"),
        (drag(wrench="{axes: world, force: -c*v - c*p}"), r"'-c \* v - c \* p' adds kg m s\^-2"),
        (drag(wrench="{force: [-c*vx, 0, 0]}"), "'vx' is neither declared.*did you mean 'v_x'"),
        (drag(wrench="{force: -c*exp(speed)*v}"), r"argument of 'exp\(speed\)' has the unit m s"),
        (drag(wrench="{force: -c*v*v}"), "multiplies two vectors: use dot or cross"),
        (drag(wrench="{force: -c*speed}"), "scalar, expected a vector or three"),
        (drag(wrench="{force: [1, 2]}"), "2 components, expected three"),
        (drag(wrench="{force: -c*v, axis: world}"), "'axis' is unknown, expected axes, at"),
        (drag(wrench="{force: -c*dot(v, v)}"), "a formula with commas needs quotes"),
        (drag(wrench="{force: -c*v, axes: moon}"), "'moon', expected world, body, contact"),
        (drag(wrench="{force: -c*v, axes: contact}"), "axes `contact` need `at: contacts`"),
        (drag(wrench="{force: [grip, 0, 0]}"), "of which contact: write grip_thumb"),
        (drag(wrench="{force: m*g}"), "does not vanish where all parameters are 0"),
        (
            drag(
                parameters="{c: {unit: N s/m, prior_std: 1}, d: {unit: '1', prior_std: 1}}",
                wrench="{force: -c*v/d}",
            ),
            "has no value where all parameters are 0",
        ),
        (drag(wrench='{force: \'__import__("os").system("true")*v\'}'), "not allowed|expression"),
        (drag(wrench="{force: v.T}"), "not allowed in a formula"),
        (drag(wrench="{force: -c*v)}"), "not an expression|not valid yaml"),
        (drag(parameters="{c: {unit: furlong, prior_std: 1}}"), "'furlong' is unknown"),
        (drag(parameters="{c: {unit: N s/m}}"), "'prior_std' is missing"),
        (drag(parameters="{v_x: {unit: m/s, prior_std: 1}}"), "'v_x' is a measured quantity"),
        (drag(parameters="{}"), "expected at least one parameter"),
        ("effects: {viscous_drag: {}}", "taken by the catalogue"),
        ("effects: [1, 2]", "not a table"),
        ("effects: {a: {b: }", "line .*not valid yaml"),
        ("", "expected at least one effect"),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, text, expected):
    with pytest.raises(BadInputError, match=expected) as caught:
        load(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "own.yaml"))


def test_a_formula_without_value_names_the_moment(tmp_path):
    (effect,) = load(
        tmp_path,
        drag(
            parameters="{c: {unit: N, prior_std: 1}}",
            constants="{h: {value: 1, unit: m}}",
            wrench="{axes: world, force: [0, 0, -c*log((p_z - h)/h)]}",
        ),
    )
    with pytest.raises(BadInputError, match=r"own_drag.*no finite value at t = 0\.000 s.*c = 0\.2"):
        effect.wrench(SAMPLES, INERTIA, np.array([0.2]))


def test_a_contact_that_is_not_there_is_named(tmp_path):
    (effect,) = load(tmp_path, drag(wrench="{force: -c*v*abs(grip_palm/grip_thumb)}"))
    with pytest.raises(BadInputError, match="'palm' is not in the recording: expected index"):
        effect.wrench(SAMPLES, INERTIA, np.ones(1))


CLASS = """
import numpy as np
from tactile_dynamics_ros.core.effects import EffectParameter, LinearEffect, register_effect

@register_effect
class Downwind(LinearEffect):
    name, family, formula = "downwind", "user", "f = F y (world)"
    looks_like, sentence, remedy = "A push.", "a fan blows", "Switch it off."

    def parameters(self, samples):
        return (EffectParameter("F", "N", 1.0, "force"),)

    def jacobian(self, samples, inertia, theta):
        force = samples.rotation[:, 1, :]
        return np.concatenate([np.zeros_like(force), force], axis=1)[..., None]
"""


def test_a_python_file_makes_its_classes_known(tmp_path):
    path = tmp_path / "fan.py"
    path.write_text(CLASS)
    (effect,) = load_effects(path)
    assert create_effect("downwind").sentence == "a fan blows"
    assert np.allclose(effect.wrench(SAMPLES, INERTIA, np.ones(1))[:, 3:], SAMPLES.rotation[:, 1])
    path.write_text("import nowhere_to_be_found")
    with pytest.raises(BadInputError, match=r"fan\.py: ModuleNotFoundError"):
        load_effects(path)
    path.write_text("x = 1")
    with pytest.raises(BadInputError, match="registers no effect"):
        load_effects(path)


def test_effects_of_other_packages_come_by_entry_points(tmp_path, monkeypatch):
    (tmp_path / "fan_package.py").write_text(CLASS.replace("@register_effect", ""))
    monkeypatch.syspath_prepend(tmp_path)
    point = EntryPoint("downwind", "fan_package:Downwind", registry.ENTRY_POINT_GROUP)
    asked = []
    monkeypatch.setattr(registry, "entry_points", lambda group: asked.append(group) or [point])
    monkeypatch.setattr(registry.HELD, "_loaded", False)
    assert "downwind" in registered_names()
    assert asked == ["tactile_dynamics_ros.effects"]
    assert create_effect("downwind").formula == "f = F y (world)"


def dragged_box(tmp_path: Path, coefficient: float) -> str:
    """Return a bag of a box whose fingers also overcome viscous drag."""
    clean = held_box(seconds=6.0)
    pose = clean.streams.pose
    velocity = np.gradient(pose.position, pose.time, axis=0)
    width = 15
    smooth = np.stack(
        [np.convolve(v, np.hanning(width) / np.hanning(width).sum(), "same") for v in velocity.T]
    ).T
    contacts = {
        name: replace(c, force=c.force + 0.25 * coefficient * smooth)
        for name, c in clean.streams.contacts.items()
    }
    streams = replace(clean.streams, contacts=contacts)
    return str(Recording(streams, "dragged box", {}).to_bag(tmp_path / "drag.mcap"))


def test_estimate_fits_an_effect_of_a_file(tmp_path, capsys):
    (tmp_path / "own.yaml").write_text(drag())
    bag = dragged_box(tmp_path, 2.0)
    arguments = ["estimate", bag, "--json", "--effect-file", str(tmp_path / "own.yaml")]
    main(arguments)
    alone = capsys.readouterr()
    assert "not yet in the model: --effects own_drag" in alone.err
    main([*arguments, "--effects", "own_drag"])
    fitted = json.loads(capsys.readouterr().out)
    found = fitted["effects"]["own_drag"]["c"]
    assert found["value"] == pytest.approx(2.0, abs=0.3)
    assert found["unit"] == "N s/m"
    before = json.loads(alone.out)["error"]["whitened_rms"]
    assert fitted["error"]["whitened_rms"] < 0.7 * before


def test_the_verb_lists_the_catalogue_and_own_effects(tmp_path, capsys):
    assert main(["effects", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert [e["name"] for e in listed if e["model"] == "pushed"] == list(PUSHED.names())
    entries = {e["name"]: e for e in listed if e["model"] == "held"}
    assert [e["name"] for e in listed if e["model"] == "held"] == list(registry.EFFECT_NAMES)
    assert [e["name"] for e in listed if e["model"] == "friction"] == list(FRICTION.names())
    for entry in listed:
        assert all(entry[key] for key in ("formula", "parameters", "looks_like", "remedy"))
    assert entries["force_bias"]["per_finger"]
    assert not entries["viscous_drag"]["per_finger"]
    (tmp_path / "own.yaml").write_text(drag(looks_like="Like syrup."))
    assert main(["effects", "own_drag", "--effect-file", str(tmp_path / "own.yaml")]) == 0
    text = capsys.readouterr().out
    assert "Like syrup." in text
    assert "c [N s/m]" in text
    assert main(["effects", "--model", "friction", "--json"]) == 0
    assert {e["model"] for e in json.loads(capsys.readouterr().out)["effects"]} == {"friction"}
    assert main(["effects", "skin_creep"]) == 0
    assert "--model friction" in capsys.readouterr().out
    assert main(["effects", "skin_creep", "--model", "held"]) == 2
    assert main(["effects", "no_such_effect"]) == 2
    assert "'no_such_effect' is unknown" in capsys.readouterr().err


def test_the_verb_lists_what_formulas_can_name(capsys):
    assert main(["effects", "--quantities"]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in ("omega", "grip", "turn_rate", "cross"))
    assert main(["effects", "--quantities", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["vectors"]["v"]["unit"] == "m/s"


def test_formulas_of_motion_are_external_and_those_of_forces_are_not(tmp_path):
    path = tmp_path / "mine.yaml"
    entry = """  {name}:
    parameters: {{k: {{unit: {unit}, prior_std: 1.0}}}}
    wrench: {{force: {law}}}
"""
    path.write_text(
        "effects:\n"
        + entry.format(name="of_motion", unit="N s/m", law="-k*v")
        + entry.format(name="of_forces", unit='"1"', law="k*f_thumb")
    )
    found = {effect.name: effect for effect in load_effects(path)}
    assert found["of_motion"].external
    assert not found["of_forces"].external
    path.write_text(path.read_text() + "    external: true\n")
    assert {effect.name: effect for effect in load_effects(path)}["of_forces"].external


OWN_PUSH_EFFECT = """
from tactile_dynamics_ros.core.effects import EffectParameter
from tactile_dynamics_ros.core.planar.effects.effect import PushEffect
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED
from tactile_dynamics_ros.core.planar.effects.support import SupportTilt

class Windy(PushEffect):
    name = "windy"
    parameters = (EffectParameter("f_x", "N", 1.0, "wind along x"),)
"""


def test_a_file_adds_an_effect_of_pushes(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(OWN_PUSH_EFFECT)
    args = Namespace(effects="windy", effect_file=[str(file)])
    with pytest.raises(BadInputError, match="registers no effect"):
        pushed_effects(args)
    file.write_text(OWN_PUSH_EFFECT.replace("class Windy", "@PUSHED.register\nclass Windy"))
    assert pushed_effects(args) == ["windy"]
    assert PUSHED.create("windy").parameters[0].name == "f_x"


MANY = "max(" * 12 + "c" + ", 1)" * 12


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("c*v_x*9^9^9^9", "is beyond 1e+100"),
        ("c*v_x*(1/9)^9^9", "is beyond 1e+100"),
        ("c*v_x*exp(exp(exp(9)))", "is beyond 1e+100"),
        ("-" * 100_000 + "c*v_x", "characters, at most 2000"),
        ("-" * 1900 + "c*v_x", "more than 100 levels"),
        ("(" * 20_000 + "c" + ")" * 20_000, "characters, at most 2000"),
        ("(" * 900 + "c*v_x" + ")" * 900, "too many nested parentheses"),
        (f"v_x*{MANY}", "more than 2000 operations"),
        ("v_x*(c + c^2 + v_x*s + 1)^90", "terms if multiplied out"),
        ("v_x*c^(10^90)", "power above 100"),
        ("c*v_x*sqrt(0 - 1)", "is no real number"),
        ("c*v_x/(1 - 1)", "divides by zero"),
        ("c*v_x*1e999", "is beyond 1e+100"),
    ],
)
def test_a_law_that_would_never_be_computed_is_refused_in_one_line(tmp_path, law, words):
    file = tmp_path / "own.yaml"
    entry = {
        "parameters": {"c": {"unit": "1", "prior_std": 1.0}},
        "constants": {"s": {"value": 1.0, "unit": "s/m"}},
        "wrench": {"force": [law, "0", "0"]},
    }
    file.write_text(yaml.safe_dump({"effects": {"own": entry}}))
    began = time.process_time()
    with pytest.raises(BadInputError) as caught:
        load_effects(file)
    assert time.process_time() - began < 5.0
    message = str(caught.value)
    assert words in message and "own.wrench.force" in message
    assert len(message) < 400 and "\n" not in message


def test_definitions_that_double_each_other_are_refused(tmp_path):
    lines = "".join(f"      q{k + 1}: max(q{k}, c*q{k})\n" for k in range(1, 30))
    file = tmp_path / "own.yaml"
    file.write_text(
        "effects:\n  own:\n    parameters: {c: {unit: 1, prior_std: 1.0}}\n"
        f"    definitions:\n      q1: c\n{lines}    wrench: {{force: [q30*v_x, '0', '0']}}\n"
    )
    with pytest.raises(BadInputError, match="q[56]: .*more than 2000 operations"):
        load_effects(file)


def test_a_law_that_is_zero_at_absence_only_by_an_identity_is_accepted(tmp_path):
    file = tmp_path / "own.yaml"
    parameters = "{c: {unit: kg/s, prior_std: 1.0}}"
    text = f"effects: {{own: {{parameters: {parameters}, wrench: {{force: ['%s']}}}}}}"
    law = "c*v_x + (sin(speed/v_x)^2 + cos(speed/v_x)^2 - 1)*m*g_x', '0', '0"
    file.write_text(text % law)
    assert [effect.name for effect in load_effects(file)] == ["own"]
    file.write_text(text % law.replace("- 1", "- 0.999"))
    with pytest.raises(BadInputError, match="does not vanish"):
        load_effects(file)
