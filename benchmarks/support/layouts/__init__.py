"""Files of a load on a wrist as other people's programs write them, with known truth."""

from collections.abc import Callable
from pathlib import Path

from benchmarks.support.layouts import (
    arms,
    bags,
    fresh,
    laboratory,
    late,
    others,
)
from benchmarks.support.layouts.wrist_log import WristLog

Layout = Callable[[WristLog, Path], list[Path]]
"""Writes a log to a folder and returns the files."""


def _by_name(*layouts: Layout) -> dict[str, Layout]:
    return {layout.__name__: layout for layout in layouts}


LAYOUTS: dict[str, Layout] = _by_name(
    arms.rtde,
    arms.libfranka,
    arms.kuka,
    arms.rostopic_echo,
    arms.plotjuggler,
    arms.sec_nanosec,
    arms.fingers,
    bags.panda_poses,
    bags.ur_frames,
    bags.kuka_ros1,
    laboratory.ati_and_pose,
    laboratory.optitrack,
    laboratory.vicon,
    laboratory.matlab_without_names,
    laboratory.numpy_savetxt,
    laboratory.integer_quaternions,
    laboratory.roll_pitch_yaw,
    laboratory.labview,
    laboratory.matrices,
    laboratory.unlabelled_turn,
    laboratory.static_angles,
    laboratory.static_without_names,
    others.robotiq_and_pose,
    others.bota,
    others.matlab_table,
    others.qualisys,
    others.abb,
    others.fanuc,
    others.intrinsic_angles,
    others.doosan,
    others.kinova,
    others.world_to_body,
    others.pandas_dates,
    others.spreadsheet,
    others.bagpy,
    others.pounds,
    others.static_vectors,
    others.static_kuka,
    others.ros2_echo,
    others.milliseconds_unsaid,
    fresh.fri,
    fresh.netbox_and_trajectory,
    fresh.two_without_names,
    fresh.panda_py,
    fresh.polyscope,
    fresh.flattened,
    fresh.link_names,
    fresh.onrobot,
    fresh.denso,
    fresh.millinewtons,
    fresh.microseconds,
    fresh.german_export,
    fresh.bare_numbers,
    fresh.lost_markers,
    fresh.two_rates,
    fresh.numbered_quaternion,
    fresh.static_named_rows,
    fresh.static_matrices,
    fresh.simulator,
    fresh.tags,
    fresh.turned_sensor,
    fresh.left_handed,
)
"""Layouts by name, on which the guess was made."""
UNSEEN: dict[str, Layout] = _by_name(
    late.mujoco,
    late.date_and_time,
    late.kawasaki,
    late.dotted,
    late.influx,
    late.nanoseconds,
    late.quoted,
    late.bars,
    late.aligned,
    late.greek,
    late.short_names,
    late.raw_with_units,
    late.transform_rows,
    late.xarm,
    late.vectors_without_names,
    late.forces_first_without_names,
    late.static_angles_without_names,
    late.static_with_stamps,
    late.two_styles,
    late.yaw_first,
)
"""Layouts that were written after it."""
UNTOLD: dict[str, Layout] = _by_name(
    others.no_time,
    others.compensated,
)
"""Layouts that lack what no guess can know: it has to ask."""
STATIC = frozenset(
    ["static_angles", "static_without_names", "static_vectors", "static_kuka"]
    + ["static_named_rows", "static_matrices", "static_angles_without_names", "static_with_stamps"]
)
"""Layouts of static poses, which take a log from `WristLog.draw_static`."""

__all__ = ["LAYOUTS", "STATIC", "UNSEEN", "UNTOLD", "Layout", "WristLog"]
