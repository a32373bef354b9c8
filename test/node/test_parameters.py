"""Configuration dataclasses as ROS parameters."""

from dataclasses import dataclass, field
from threading import Thread

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_dynamics_ros.cli.topics import set_parameter
from tactile_dynamics_ros.cli.view import Control
from tactile_dynamics_ros.core.configuration import check_ranges, parameter
from tactile_dynamics_ros.core.errors import BadInputError
from tactile_dynamics_ros.core.reading import parse_yaml
from tactile_dynamics_ros.ros.parameters import (
    AnsweringNode,
    declare_config,
    field_names,
    refuse_unknown,
)
from tactile_dynamics_ros.view.state import State


@dataclass(frozen=True)
class Inner:
    gain: float = parameter(2.0, "how much", "N", 0.0, 10.0)


@dataclass(frozen=True)
class Outer:
    rate_hz: float = parameter(100.0, "how often", "Hz", 1.0)
    count: int = parameter(4, "how many", "", 1, 9)
    name: str = parameter("box_0", "what")
    on: bool = parameter(True, "whether")
    effects: tuple[str, ...] = parameter((), "which")
    sides: tuple[str, ...] = parameter(("left", "right"), "of which")
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self):
        check_ranges(self)


def make_node(**given):
    overrides = [Parameter(name.replace("__", "."), value=value) for name, value in given.items()]
    return Node(
        "probe",
        parameter_overrides=overrides,
        automatically_declare_parameters_from_overrides=True,
        enable_rosout=False,
    )


def test_defaults_come_back_and_are_described(ros):
    node = make_node()
    assert declare_config(node, Outer) == Outer()
    refuse_unknown(node)
    descriptor = node.describe_parameter("inner.gain")
    assert descriptor.description == "how much [N]"
    assert descriptor.floating_point_range[0].to_value == 10.0
    assert descriptor.read_only
    plain = ["rate_hz", "count", "name", "on", "effects", "sides"]
    assert field_names(Outer) == [*plain, "inner.gain"]


def test_given_values_reach_the_configuration(ros):
    node = make_node(rate_hz=50, count=2, inner__gain=3.5, effects=["viscous_drag"], on=False)
    expected = Outer(50.0, 2, "box_0", False, ("viscous_drag",), inner=Inner(3.5))
    assert declare_config(node, Outer) == expected
    refuse_unknown(node)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"inner__gain": 11.0}, "inner.gain"),
        ({"rate_hz": "fast"}, "rate_hz = 'fast', expected float"),
        ({"count": 0}, "count"),
        ({"rate_hz": 0.5}, "rate_hz = 0.5 Hz: expected at least 1.0"),
        ({"effects": "left"}, "effects = 'left', expected a list of str"),
        ({"effects": 5}, "effects = 5, expected a list of str"),
        ({"effects": [1, 2]}, "effects = 1, expected str"),
        ({"sides": "left"}, r"sides = 'left', expected a list of str, like \['left', 'right'\]"),
    ],
)
def test_bad_values_are_refused_with_their_name(ros, given, text):
    with pytest.raises(BadInputError, match=text):
        declare_config(make_node(**given), Outer)


def test_unknown_parameter_is_refused(ros):
    node = make_node(rate=50.0)
    declare_config(node, Outer)
    with pytest.raises(BadInputError, match="unknown parameter rate; known: count, effects"):
        refuse_unknown(node)


def test_live_parameter_changes_and_others_do_not(ros):
    node, seen = make_node(), []
    declare_config(node, Outer, live=["effects"], on_change=seen.append)
    assert node.set_parameters([Parameter("effects", value=["viscous_drag"])])[0].successful
    assert seen[-1].effects == ("viscous_drag",)
    assert not node.set_parameters([Parameter("count", value=3)])[0].successful
    assert node.set_parameters([Parameter("effects", value=[])])[0].successful
    assert seen[-1].effects == ()


@pytest.mark.parametrize("given", [{}, {"effects": []}, {"effects": ""}, {"effects": [""]}])
def test_an_empty_list_is_an_array_of_text(ros, given):
    node = make_node(**given)
    assert declare_config(node, Outer, live=["effects"], on_change=lambda _: None).effects == ()
    found = node.get_parameter("effects")
    assert found.type_ is Parameter.Type.STRING_ARRAY
    assert list(found.value) == []
    descriptor = node.describe_parameter("effects")
    assert (descriptor.type, descriptor.dynamic_typing) == (found.type_.value, False)


def test_empty_list_of_read_only_values_keeps_its_type(ros):
    node = make_node(sides=[])
    assert declare_config(node, Outer).sides == ()
    assert node.get_parameter("sides").type_ is Parameter.Type.STRING_ARRAY
    assert node.describe_parameter("sides").read_only


@pytest.mark.parametrize("kind", [Parameter.Type.BOOL_ARRAY, Parameter.Type.BYTE_ARRAY])
def test_live_list_is_emptied_whatever_type_the_empty_list_came_with(ros, kind):
    node, seen = make_node(effects=["viscous_drag"]), []
    declare_config(node, Outer, live=["effects"], on_change=seen.append)
    assert node.set_parameters([Parameter("effects", kind, [])])[0].successful
    assert seen[-1].effects == ()
    assert node.get_parameter("effects").type_ is Parameter.Type.STRING_ARRAY


@pytest.mark.parametrize("value", [5, [1, 2], "viscous_drag"])
def test_live_list_of_another_type_is_refused(ros, value):
    node, seen = make_node(), []
    declare_config(node, Outer, live=["effects"], on_change=seen.append)
    result = node.set_parameters([Parameter("effects", value=value)])[0]
    assert not result.successful
    assert "STRING_ARRAY" in result.reason
    assert seen == []


def test_only_what_is_bounded_on_both_sides_is_described_as_a_range(ros):
    node = make_node()
    declare_config(node, Outer)
    one_sided = node.describe_parameter("rate_hz")
    assert list(one_sided.floating_point_range) == []
    assert one_sided.additional_constraints == "at least 1.0"
    assert node.describe_parameter("count").integer_range[0].to_value == 9


def test_refused_live_change_tells_why(ros):
    def refuse(config):
        raise BadInputError("unknown effect 'magic'")

    node = make_node()
    declare_config(node, Outer, live=["effects"], on_change=refuse)
    result = node.set_parameters([Parameter("effects", value=["magic"])])[0]
    assert not result.successful
    assert "magic" in result.reason


def test_a_parameter_that_does_not_exist_is_named_with_the_nearest(ros):
    node = AnsweringNode("probe", enable_rosout=False)
    declare_config(node, Outer, live=["effects"], on_change=lambda _: None)
    result = node.set_parameters_atomically([Parameter("efects", value=["viscous_drag"])])
    assert (result.successful, result.reason) == (
        False,
        "no parameter 'efects'; did you mean 'effects'?",
    )


@pytest.mark.parametrize("names", [[], ["viscous_drag"]])
def test_the_page_and_the_command_set_any_choice_of_effects_or_none(ros, names):
    """Over the service, where an empty list arrives without its type."""
    node, seen = AnsweringNode("inertial_estimator", enable_rosout=False), []
    declare_config(node, Outer, live=["effects"], on_change=seen.append)
    asker = Node("asker", enable_rosout=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    thread = Thread(target=executor.spin, daemon=True)
    thread.start()
    try:
        told = Control(asker, State())._set_effects(names)
        set_parameter(asker, "inertial_estimator", "effects", parse_yaml(str(names), ""), 10.0)
    finally:
        executor.shutdown()
        thread.join()
    assert told == f"effects of the model: {', '.join(names) or 'none'}"
    assert [config.effects for config in seen] == [tuple(names)] * 2


@pytest.mark.parametrize("value", ["{a: 1}", "[1, a]", "", "99999999999999999999", "2001-01-01"])
def test_a_value_that_no_parameter_can_have_is_refused_before_it_is_sent(value):
    with pytest.raises(BadInputError, match="expected a number, a text, or a list of one kind"):
        set_parameter(None, "model_check", "period", parse_yaml(value, "value"), 1.0)
