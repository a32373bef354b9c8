"""Requests that come faster than their senders read answers: each is answered, none too soon."""

from collections import deque
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from std_srvs.srv import Trigger

from tactile_dynamics_ros.ros.listening import ANSWER_BURST, ANSWER_SPAN, REQUESTS, Served


class Handle(nullcontext):
    """Requests that wait."""

    def __init__(self, count):
        super().__init__()
        self.waiting = deque(range(count))

    def service_take_request(self, kind):
        return (kind(), self.waiting.popleft()) if self.waiting else (None, None)


@pytest.mark.parametrize("count", [1, ANSWER_BURST, 400])
def test_each_request_is_answered_and_never_more_at_once_than_a_client_keeps(count):
    given, now = [], 0.0
    handle = Handle(count)
    served = Served(
        SimpleNamespace(
            srv_type=Trigger,
            handle=handle,
            callback=lambda request, response: response,
            send_response=lambda response, header: given.append((now, header)),
        )
    )
    while handle.waiting:
        served.answer(now)
        now += 0.01
    assert [header for _, header in given] == list(range(count))
    within = [sum(t <= other < t + ANSWER_SPAN - 1e-9 for other, _ in given) for t, _ in given]
    assert max(within) <= ANSWER_BURST
    assert now <= 0.01 + ANSWER_SPAN * 1.3 * count / ANSWER_BURST


def test_as_many_requests_can_wait_as_come_in_ten_seconds():
    assert REQUESTS.depth >= 10 * 100
