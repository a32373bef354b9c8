"""ROS nodes: thin shells that turn messages into calls of the core and results into messages."""

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
