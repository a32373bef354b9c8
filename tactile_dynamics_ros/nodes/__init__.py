"""ROS nodes: thin shells that turn messages into calls of the core and results into messages."""
