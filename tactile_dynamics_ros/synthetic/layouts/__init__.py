"""Files of a load on a wrist as other people's programs write them, with known truth."""

from collections.abc import Callable
from pathlib import Path

from tactile_dynamics_ros.synthetic.layouts import arms, bags, laboratory, others
from tactile_dynamics_ros.synthetic.layouts.wrist_log import WristLog

Layout = Callable[[WristLog, Path], list[Path]]
"""Writes a log to a folder and returns the files."""

LAYOUTS: dict[str, Layout] = {
    layout.__name__: layout
    for layout in (
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
    )
}
"""Layouts by name, on which the guess was made."""
UNSEEN: dict[str, Layout] = {
    layout.__name__: layout
    for layout in (
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
        others.no_time,
        others.compensated,
        others.ros2_echo,
        others.milliseconds_unsaid,
    )
}
"""Layouts that were written after it."""
STATIC = frozenset(["static_angles", "static_without_names", "static_vectors", "static_kuka"])
"""Layouts of static poses, which take a log from `WristLog.draw_static`."""

__all__ = ["LAYOUTS", "STATIC", "UNSEEN", "Layout", "WristLog"]
