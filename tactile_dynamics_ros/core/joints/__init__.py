"""Arms by the torques of their joints: rigid bodies, friction, a payload, and what is missing."""
