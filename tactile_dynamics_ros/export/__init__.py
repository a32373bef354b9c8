"""Estimates in the formats of simulators and robots."""

from tactile_dynamics_ros.export.export import FORMATS, Export, export

__all__ = ["FORMATS", "Export", "export"]
