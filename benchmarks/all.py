"""Runs what makes the sections of docs/benchmarks.md that are stale; resumes (see `stamps`)."""

import sys

from benchmarks import stamps


def main() -> int:
    """Run."""
    return stamps.main(run=True)


if __name__ == "__main__":
    sys.exit(main())
