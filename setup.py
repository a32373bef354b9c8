"""Package of kind ament_python; also installs by pip, with ROS 2 from wheels (extra `ros`)."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = "tactile_dynamics_ros"
NODES = (
    "biotac_force",
    "contact_state",
    "explorer",
    "friction_probe",
    "grasp_controller",
    "inertial_estimator",
    "joint_monitor",
    "kinematic_tracker",
    "model_check",
    "payload_writer",
    "property_estimator",
    "push_controller",
    "robot_sim",
    "shape_estimator",
    "vision_tracker",
    "weigher",
    "wrench_compensator",
)


def shared(folder: str, pattern: str) -> tuple[str, list[str]]:
    """Return the data_files entry that puts `folder/pattern` under share/."""
    files = sorted(str(path) for path in Path(folder).glob(pattern) if path.is_file())
    return f"share/{NAME}/{folder}", files


setup(
    name=NAME,
    version="0.1.0",
    description="Live estimation of what a dexterous hand is holding, and of what the model lacks",
    license="Apache-2.0",
    maintainer="tactile_dynamics_ros maintainers",
    maintainer_email="maintainers@tactile-dynamics.invalid",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={
        NAME: ["py.typed", "**/*.npz", "**/*.json", "**/*.yaml", "**/*.html", "**/*.css", "**/*.js"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        ("bin", ["bin/tactile-dynamics"]),
        shared("config", "*.yaml"),
        shared("config", "*.xml"),
        shared("config/layouts", "*"),
        shared("config/objects", "*.yaml"),
        shared("config/robots", "*"),
        shared("config/objects/friction", "*.yaml"),
        shared("interfaces/action", "*.action"),
        shared("interfaces/msg", "*.msg"),
        shared("interfaces/srv", "*.srv"),
        shared("launch", "*.launch.py"),
    ],
    python_requires=">=3.11,<3.14",
    install_requires=[
        "apsw",
        "backports.zstd; python_version < '3.14'",
        "gtsam",
        "jinja2",
        "lz4",
        "matplotlib",
        "numpy",
        "pillow",
        "pypcd4",
        "pyyaml",
        "rich",
        "rosbags",
        "scipy",
        "shtab",
        "small_gicp",
        "sympy",
        "trimesh",
        "urdf-parser-py",
    ],
    extras_require={
        "ros": [
            "ros-jazzy-rclpy",
            "ros-jazzy-common-interfaces",
            "ros-jazzy-rmw-fastrtps-cpp",
        ],
        "fleet": ["distributed", "pyarrow"],
        "sim": ["pybullet"],
        "train": ["torch"],
        "view": ["viser", "websockets"],
        "dev": [
            "catkin-pkg",
            "clarabel",
            "colcon-common-extensions",
            "cvxpy",
            "empy",
            "hypothesis",
            "lark-parser",
            "mypy",
            "pdoc",
            "psutil",
            "pytest",
            "pytest-timeout",
            "pytest-xdist",
            "ruff",
            "setuptools",
            "wheel",
        ],
    },
    entry_points={
        "console_scripts": [
            "tactile-dynamics = tactile_dynamics_ros.cli.main:main",
            *(f"{node} = {NAME}.ros.executable:{node}" for node in NODES),
        ],
    },
    zip_safe=False,
)
