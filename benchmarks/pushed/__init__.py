"""Objects on a support that are pushed: accuracy, honesty, real measurements, peers, time."""
