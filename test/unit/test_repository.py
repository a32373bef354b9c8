"""What may be in the repository."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LARGEST = 2_000_000


def test_no_tracked_file_is_large_or_a_package() -> None:
    """A clone stays small: packages are installed, data and recordings are made."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True)
    if listed.returncode:
        pytest.skip("not a clone of the repository")
    files = [ROOT / name for name in listed.stdout.decode().split("\0") if name]
    present = [file for file in files if file.is_file()]
    assert present
    assert not [file for file in present if file.stat().st_size > LARGEST]
    assert not [file for file in present if file.suffix in {".whl", ".mcap", ".zip", ".gz"}]
