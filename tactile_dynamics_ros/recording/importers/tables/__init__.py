"""Text tables of numbers as loggers, robots and spreadsheets write them."""

from tactile_dynamics_ros.recording.importers.tables.table import Table, read_table

__all__ = ["Table", "read_table"]
