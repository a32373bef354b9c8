"""The one path between configuration dataclasses of the core and ROS parameters.

Nodes are created with `automatically_declare_parameters_from_overrides`, so that what the user gave
is visible here: integers are accepted where a float is meant, and unknown names are refused.
"""

from __future__ import annotations

import array
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_dynamics_ros.core.configuration import describe_range
from tactile_dynamics_ros.core.errors import BadInputError, TactileDynamicsError, nearest

Config = TypeVar("Config")

FOREIGN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class AnsweringNode(Node):
    """A node whose answer to a change of parameters says what the change does, or why it is none.

    rclpy leaves the reason of a change that succeeds out, and the name of a parameter that does not
    exist; `ros2 param set` shows both.

    Attributes:
        answer: what the newest change does; empty if nobody says.
    """

    answer = ""

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters as rclpy does, and give the reason."""
        self.answer = ""
        unknown = [p.name for p in parameter_list if not self.has_parameter(p.name)]
        if unknown:
            known = sorted(self.get_parameters_by_prefix(""))
            reason = f"no parameter '{unknown[0]}'{nearest(unknown[0], known)}"
            return SetParametersResult(successful=False, reason=reason)
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            result.reason = self.answer
        return result


def declare_config(
    node: Node,
    config_class: type[Config],
    prefix: str = "",
    live: Sequence[str] = (),
    on_change: Callable[[Config], str | None] | None = None,
) -> Config:
    """Declare every field of a configuration dataclass as a ROS parameter and return the values.

    Nested dataclasses become dotted names. Parameters are read-only except those named in `live`.

    Args:
        node: created with `automatically_declare_parameters_from_overrides=True`.
        config_class: frozen dataclass whose fields carry description, unit and range.
        prefix: put before each name, for example "sensor.".
        live: fields that may change while the node runs.
        on_change: receives the new configuration and may return what the change does, which
            whoever sets a parameter of an `AnsweringNode` is told; raising an error refuses it.

    Raises:
        BadInputError: a given value has the wrong type or lies outside its range.
    """
    given = {name: entry.value for name, entry in node.get_parameters_by_prefix("").items()}
    config = _declare_fields(node, config_class(), prefix, live, given)
    if live and on_change is not None:
        changes = _LiveConfig(node, config, prefix, live, on_change)
        node.add_pre_set_parameters_callback(changes.give_type)
        node.add_on_set_parameters_callback(changes)
    return config


def refuse_unknown(node: Node) -> None:
    """Refuse parameters that were given to the node but that no configuration declares.

    Raises:
        BadInputError: names them and what exists.
    """
    names = sorted(node.get_parameters_by_prefix(""))
    names = [name for name in names if not name.startswith(FOREIGN)]
    unknown = [name for name in names if not node.describe_parameter(name).description]
    if unknown:
        known = ", ".join(name for name in names if name not in unknown)
        raise BadInputError(
            f"node {node.get_name()}: unknown parameter {', '.join(unknown)}; known: {known}"
        )


def field_names(config_class: type[Any], prefix: str = "") -> list[str]:
    """Return the parameter names that a configuration dataclass declares."""
    names = []
    for field in dataclasses.fields(config_class):
        default = _default(field)
        nested = dataclasses.is_dataclass(default)
        name = prefix + field.name
        names += field_names(type(default), name + ".") if nested else [name]
    return names


def _declare_fields(
    node: Node, config: Any, prefix: str, live: Sequence[str], given: dict[str, Any]
) -> Any:
    values = {}
    for field in dataclasses.fields(config):
        name, default = prefix + field.name, getattr(config, field.name)
        if dataclasses.is_dataclass(default):
            values[field.name] = _declare_fields(node, default, name + ".", live, given)
        else:
            values[field.name] = _declare_one(node, field, name, default, live, given)
    return dataclasses.replace(config, **values)


def _declare_one(
    node: Node,
    field: dataclasses.Field[Any],
    name: str,
    default: Any,
    live: Sequence[str],
    given: dict[str, Any],
) -> Any:
    value = _to_parameter(default)
    if name in given:
        value = _like(default, given[name], name, node)
        node.undeclare_parameter(name)
    descriptor = _descriptor(field, default, read_only=field.name not in live)
    if value == []:
        _declare_empty(node, name, _array_type(default), descriptor)
        return ()
    try:
        declared = node.declare_parameter(name, value, descriptor, ignore_override=True)
    except ParameterException as error:
        raise BadInputError(f"node {node.get_name()}: {error}; {descriptor.description}") from error
    return _from_parameter(default, declared.value)


def _declare_empty(
    node: Node, name: str, kind: Parameter.Type, descriptor: ParameterDescriptor
) -> None:
    """Declare an array without elements, of which rclpy alone would not know the type."""
    node.declare_parameter(name, kind, ParameterDescriptor(), ignore_override=True)
    node.set_parameters([Parameter(name, kind, [])])
    descriptor.type = kind.value
    node.set_descriptor(name, descriptor)


def _array_type(default: tuple[Any, ...]) -> Parameter.Type:
    """Return the type of an array parameter; one that is empty by default holds text."""
    return Parameter.Type.from_parameter_value([_element(default)])


def _element(default: tuple[Any, ...]) -> Any:
    return default[0] if default else ""


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    raise TypeError(f"configuration field {field.name} has no default")


def _descriptor(
    field: dataclasses.Field[Any], default: Any, read_only: bool
) -> ParameterDescriptor:
    unit = field.metadata.get("unit", "")
    text = field.metadata.get("description", field.name) + (f" [{unit}]" if unit else "")
    descriptor = ParameterDescriptor(description=text, read_only=read_only)
    low, high = field.metadata.get("minimum"), field.metadata.get("maximum")
    if (low is None and high is None) or isinstance(default, bool):
        return descriptor
    if low is None or high is None:  # a range has two ends: this one is checked by the dataclass
        descriptor.additional_constraints = describe_range(low, high)
    elif isinstance(default, float):
        ends = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [ends]
    elif isinstance(default, int):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


def _to_parameter(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _from_parameter(default: Any, value: Any) -> Any:
    return tuple(value or ()) if isinstance(default, tuple) else value


def _like(default: Any, value: Any, name: str, node: Node) -> Any:
    """Return a given value as the type of the default."""
    if isinstance(default, tuple):
        if value is None or value == "":
            return []
        if not isinstance(value, list | tuple | array.array):
            wanted = type(_element(default)).__name__
            raise BadInputError(
                f"node {node.get_name()}: parameter {name} = {value!r}, expected a list of {wanted}"
                f", like {list(default) or ['one', 'two']}"
            )
        return [_like(_element(default), item, name, node) for item in value if item != ""]
    if isinstance(default, float) and type(value) is int:
        return float(value)
    if type(value) is not type(default):
        raise BadInputError(
            f"node {node.get_name()}: parameter {name} = {value!r}, "
            f"expected {type(default).__name__} like {default!r}"
        )
    return value


class _LiveConfig:
    """Set-parameters callback that rebuilds a configuration and offers it to the node."""

    def __init__(
        self,
        node: Node,
        config: Any,
        prefix: str,
        live: Sequence[str],
        on_change: Callable[[Any], str | None],
    ) -> None:
        self._node, self._config = node, config
        self._names = {prefix + name: name for name in live}
        self._on_change = on_change

    def give_type(self, parameters: list[Parameter]) -> list[Parameter]:
        """Return the new values; an empty list, which has no type on its way here, has its own."""
        return [self._typed(entry) for entry in parameters]

    def _typed(self, entry: Parameter) -> Parameter:
        value = getattr(self._config, self._names.get(entry.name, ""), None)
        if not isinstance(value, tuple) or not hasattr(entry.value, "__len__") or len(entry.value):
            return entry
        return Parameter(entry.name, _array_type(value), [])

    def __call__(self, parameters: list[Parameter]) -> SetParametersResult:
        """Accept or refuse new values."""
        mine = {self._names[p.name]: p.value for p in parameters if p.name in self._names}
        if not mine:
            return SetParametersResult(successful=True)
        for name, value in mine.items():
            mine[name] = _from_parameter(getattr(self._config, name), value)
            if isinstance(mine[name], tuple):
                mine[name] = tuple(item for item in mine[name] if item != "")
        try:
            config = dataclasses.replace(self._config, **mine)
            answer = self._on_change(config)
        except (TactileDynamicsError, TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._config = config
        if isinstance(self._node, AnsweringNode):
            self._node.answer = answer or ""
        return SetParametersResult(successful=True)
