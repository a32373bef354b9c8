"""Who may read and use a page: browsers that were given its address, and no other site in them."""

from __future__ import annotations

import hmac
import ipaddress
import logging
import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets import Headers
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from tactile_dynamics_ros.view import TOKEN_VARIABLE

_LOOPBACK = ("localhost", "127.0.0.1", "::1")
"""Names of this machine in the address of a page that only it can reach."""

Answerer = Callable[[ServerConnection, Request], Response | None]
"""Answers a request before it becomes a websocket; None lets it become one."""


class Gate:
    """Lets requests in, of HTTP and for websockets alike, that come with the page's token.

    The first one shows it as `?token=..` and gets a cookie, all others show the cookie. A request
    that another site makes in a browser is refused by its Origin, and one that reached this machine
    under the name of another (DNS rebinding) by its Host.

    Args:
        host: address that is listened on.

    Attributes:
        token: secret of this page.
    """

    def __init__(self, host: str) -> None:
        self.token = os.environ.get(TOKEN_VARIABLE) or secrets.token_urlsafe(16)
        self._names = (*_LOOPBACK, host) if is_loopback(host) else None

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Servers of websockets that start meanwhile ask here first."""
        serve = websockets.asyncio.server.serve
        silent = logging.getLogger(__name__)
        silent.setLevel(logging.CRITICAL)  # what is no request of HTTP would be a traceback

        def guarded(*args: Any, process_request: Answerer, **options: Any) -> Any:
            answer = partial(self.answer, then=process_request)
            return serve(*args, process_request=answer, logger=silent, **options)

        websockets.asyncio.server.serve = guarded  # type: ignore[misc, assignment]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]

    def answer(
        self, connection: ServerConnection, request: Request, then: Answerer
    ) -> Response | None:
        """Refuse a request, give it the cookie, or hand it on."""
        try:
            host, origin = (request.headers.get(name, "") for name in ("Host", "Origin"))
            name = urlsplit(f"//{host}").hostname or ""
            target = urlsplit(request.path)
            shown = parse_qs(target.query).get("token", [])
            cookies = SimpleCookie(request.headers.get("Cookie", ""))
        except (ValueError, LookupError, CookieError):  # LookupError: a header comes twice
            return _refuse(connection, HTTPStatus.BAD_REQUEST, "the request cannot be read")
        if target.netloc or not target.path.startswith("/"):
            return _refuse(connection, HTTPStatus.BAD_REQUEST, "the request cannot be read")
        if self._names is not None and name not in self._names:
            return _refuse(connection, HTTPStatus.FORBIDDEN, f"'{name}' is not this page")
        if origin and urlsplit(origin).netloc != host:
            return _refuse(connection, HTTPStatus.FORBIDDEN, "another site asks")
        cookie = f"tactile_dynamics_{connection.local_address[1]}"
        if cookie in cookies and self._is_right(cookies[cookie].value):
            return then(connection, request)
        if any(map(self._is_right, shown)):
            headers = Headers(
                Location="/",
                **{"Set-Cookie": f"{cookie}={self.token}; HttpOnly; SameSite=Strict"},
            )
            headers["Content-Length"] = "0"
            return Response(HTTPStatus.SEE_OTHER, "See Other", headers)
        return _refuse(connection, HTTPStatus.FORBIDDEN, "open the address with its ?token=...")

    def _is_right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.token.encode())


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _refuse(connection: ServerConnection, status: HTTPStatus, text: str) -> Response:
    return connection.respond(status, f"{text}\n")
