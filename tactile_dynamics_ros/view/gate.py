"""A door before the page for browsers of other machines: only who has the token comes in."""

from __future__ import annotations

import asyncio
import hmac
import threading
from concurrent.futures import Future
from contextlib import suppress
from http.cookies import SimpleCookie
from urllib.parse import parse_qs, urlsplit

_COOKIE = "tactile_dynamics"
"""Name of the cookie in which a browser keeps the token."""
_LONGEST = 65536
"""Bytes of a request's head that are read: more than browsers send; without a limit anybody could
fill the memory."""


class Gate:
    """Hands connections on to a page of this machine once they have shown a token.

    The first request shows it as `?token=..` and gets a cookie; every further connection, that of
    the websocket too, shows the cookie.

    Args:
        host: address to listen on.
        port: to listen on; 0 takes a free one.
        inner: port of the page on 127.0.0.1.
        token: secret.
    """

    def __init__(self, host: str, port: int, inner: int, token: str) -> None:
        self._inner, self._token = inner, token
        self._listening: Future[int] = Future()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(host, port)), daemon=True
        )
        self._thread.start()
        self.port = self._listening.result()

    def close(self) -> None:
        """Stop listening and cut all connections."""
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join()

    async def _serve(self, host: str, port: int) -> None:
        self._loop, self._over = asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await asyncio.start_server(self._welcome, host, port, limit=_LONGEST)
        except OSError as error:
            self._listening.set_exception(error)
            return
        self._listening.set_result(int(server.sockets[0].getsockname()[1]))
        await self._over.wait()
        server.close()

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10.0)
        except (TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, OSError):
            writer.close()
            return
        target, shown = _read_head(head.decode("latin-1"))
        if any(self._is_right(token) for token in shown):
            with suppress(asyncio.CancelledError):  # the gate closes
                await self._hand_on(head, reader, writer)
        elif any(
            self._is_right(token) for token in parse_qs(urlsplit(target).query).get("token", [])
        ):
            cookie = f"{_COOKIE}={self._token}; HttpOnly; SameSite=Strict"
            _reply(writer, "303 See Other", f"Location: /\r\nSet-Cookie: {cookie}\r\n")
        else:
            _reply(writer, "403 Forbidden", "", "open the address with its ?token=...\n")

    def _is_right(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())

    async def _hand_on(
        self, head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        try:
            answers, requests = await asyncio.open_connection("127.0.0.1", self._inner)
        except OSError:
            writer.close()
            return
        requests.write(head)
        await asyncio.gather(_pour(reader, requests), _pour(answers, writer))


def _read_head(head: str) -> tuple[str, list[str]]:
    """Return the target of a request and the tokens of its cookies."""
    first, *lines = head.split("\r\n")
    words = first.split(" ")
    cookies = SimpleCookie()
    for line in lines:
        name, _, value = line.partition(":")
        if name.lower() == "cookie":
            cookies.load(value.strip())
    shown = [cookies[_COOKIE].value] if _COOKIE in cookies else []
    return (words[1] if len(words) > 1 else ""), shown


def _reply(writer: asyncio.StreamWriter, status: str, fields: str, text: str = "") -> None:
    fields += f"Content-Length: {len(text.encode())}\r\nConnection: close\r\n"
    writer.write(f"HTTP/1.1 {status}\r\n{fields}\r\n{text}".encode())
    writer.close()


async def _pour(source: asyncio.StreamReader, target: asyncio.StreamWriter) -> None:
    """Copy until the source ends or the target is gone."""
    try:
        while data := await source.read(_LONGEST):
            target.write(data)
            await target.drain()
    except (ConnectionError, OSError):
        pass
    finally:
        target.close()
