"""Services whose requests a node takes itself, at a pace that those who ask can follow."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.service import Service

REQUESTS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""Services: requests that may wait; a script sends hundreds at once, of which `ANSWER_BURST` are
answered every `ANSWER_SPAN`."""

ANSWER_BURST, ANSWER_SPAN = 8, 0.05
"""Answers of one service within so many seconds: a client of rclpy keeps ten that it has not read,
and loses older ones without a word. 160 answers/s, and it may be held up for 50 ms."""


@dataclass
class Served:
    """A service whose requests the node takes itself, and when it gave its last answers, s."""

    service: Service
    given: deque[float] = field(default_factory=lambda: deque(maxlen=ANSWER_BURST))

    def answer(self, now: float) -> None:
        """Answer requests that wait, at most `ANSWER_BURST` within `ANSWER_SPAN`.

        Args:
            now: monotonic, s.
        """
        kind, handle = self.service.srv_type, self.service.handle
        while len(self.given) < ANSWER_BURST or now - self.given[0] > ANSWER_SPAN:
            with handle:
                request, header = handle.service_take_request(kind.Request)
            if header is None:
                return
            self.service.send_response(self.service.callback(request, kind.Response()), header)
            self.given.append(now)
