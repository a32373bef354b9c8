"""What every simulated world is: an engine of its own that is freed in the end."""

from __future__ import annotations

from types import TracebackType
from typing import Self

import pybullet


class Engine:
    """A Bullet engine without graphics; a context manager, or call `close`.

    Attributes:
        client: Bullet client, negative once it is closed.
    """

    def __init__(self) -> None:
        self.client: int = pybullet.connect(pybullet.DIRECT)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the engine; the world cannot be used afterwards."""
        if self.client >= 0:
            pybullet.disconnect(self.client)
            self.client = -1
