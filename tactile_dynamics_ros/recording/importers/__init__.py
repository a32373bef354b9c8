"""Importers of measurements in other forms; add one to the table to add a word to the command."""

from tactile_dynamics_ros.recording.importers.bag import BagImporter
from tactile_dynamics_ros.recording.importers.biotac_slide import BiotacSlideImporter
from tactile_dynamics_ros.recording.importers.contactnets_cube import ContactnetsCubeImporter
from tactile_dynamics_ros.recording.importers.csv_mapping import CsvMappingImporter
from tactile_dynamics_ros.recording.importers.goal_pushes_zhou2017 import (
    GoalPushesZhou2017Importer,
)
from tactile_dynamics_ros.recording.importers.importer import Importer
from tactile_dynamics_ros.recording.importers.kuka_ft_imu import KukaFtImuImporter
from tactile_dynamics_ros.recording.importers.pushes_mit import PushesMitImporter
from tactile_dynamics_ros.recording.importers.pushes_zhou2016 import PushesZhou2016Importer
from tactile_dynamics_ros.recording.importers.static_poses import StaticPosesImporter

IMPORTERS: tuple[Importer, ...] = (
    CsvMappingImporter(),
    StaticPosesImporter(),
    BagImporter(),
    KukaFtImuImporter(),
    ContactnetsCubeImporter(),
    BiotacSlideImporter(),
    PushesZhou2016Importer(),
    PushesMitImporter(),
    GoalPushesZhou2017Importer(),
)

__all__ = ["IMPORTERS", "Importer"]
