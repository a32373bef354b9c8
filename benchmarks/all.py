"""Runs what makes the sections of docs/benchmarks.md that are stale; resumes (see `stamps`)."""

from benchmarks import stamps


def main() -> int:
    """Run."""
    return stamps.main(run=True)
