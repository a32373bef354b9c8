"""Paper A's inertial inference as published, to be compared with: batch factor graph in GTSAM."""

from benchmarks.peers.paper_a.methods import (
    METHODS,
    Method,
    PublishedEstimate,
    estimate_as_published,
)
from benchmarks.peers.paper_a.time_steps import TimeSteps

__all__ = ["METHODS", "Method", "PublishedEstimate", "TimeSteps", "estimate_as_published"]
