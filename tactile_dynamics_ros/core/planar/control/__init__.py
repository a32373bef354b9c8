"""Where to push so that an object comes to a wanted pose: prediction, search, closed loop."""
