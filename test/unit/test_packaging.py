"""What setup.py, package.xml and README say about installing agrees with the package."""

from pathlib import Path

from setuptools import find_packages

ROOT = Path(__file__).parents[2]
PACKAGE = "tactile_dynamics_ros"


def test_every_folder_with_modules_is_installed():
    folders = {path.parent for path in (ROOT / PACKAGE).rglob("*.py")}
    dotted = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    found = find_packages(str(ROOT), include=[PACKAGE, f"{PACKAGE}.*"])
    assert dotted == set(found)
