"""Object tracking in the simulated hand: accuracy, honesty, recovery, speed."""
