"""A ROS domain of its own for every test run, confined to this host."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from tactile_dynamics_ros.cli.domain import private_domain  # noqa: E402
from tactile_dynamics_ros.core.effects.registry import HELD  # noqa: E402
from tactile_dynamics_ros.core.planar.effects.registry import PUSHED  # noqa: E402

_claim = private_domain()

settings.register_profile("seeded", derandomize=True, deadline=None)
settings.load_profile("seeded")


def pytest_configure(config):
    """Claim the domain before anything imports rclpy."""
    _claim.__enter__()


def pytest_unconfigure(config):
    """Give the domain back."""
    _claim.__exit__(None, None, None)


@pytest.fixture(autouse=True)
def catalogue_alone(monkeypatch):
    """Effects of one's own that a test loads are forgotten after it."""
    for registry in (HELD, PUSHED):
        registry.names()
        monkeypatch.setattr(registry, "_known", dict(registry._known))


@pytest.fixture
def ros():
    """Start rclpy for a test and stop it afterwards."""
    rclpy = pytest.importorskip("rclpy")
    rclpy.init(args=[])
    yield rclpy
    rclpy.try_shutdown()
