"""The robot: its links and joints, and how their errors move what it holds."""
