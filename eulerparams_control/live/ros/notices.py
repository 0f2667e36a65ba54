"""Notices on the pages: what people have to know at once."""

from collections.abc import Callable
from typing import Any, TypeVar

import viser
from rclpy.impl.rcutils_logger import RcutilsLogger

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import EulerParamsError, defect, kind_of

_T = TypeVar("_T")
_AGAIN = 5.0  # [s] after which the same notice is shown again


class Notices:
    """Shows notices.

    Args:
        server: of the pages.
        logger: of the node.
    """

    def __init__(self, server: viser.ViserServer, logger: RcutilsLogger) -> None:
        self._server, self._logger = server, logger
        self._failed: set[str] = set()  # what was logged already
        self._told: dict[tuple[int, str], float] = {}  # when, each page and text

    def show(
        self, title: str, text: str, page: int = 0, colour: Any = "orange", about: str = ""
    ) -> None:
        """Show a text on one page, 0: on all; the same, or one about the same, after a while."""
        now = steady.now()
        self._told = {said: t for said, t in self._told.items() if now < t + _AGAIN}
        if (page, about or text) in self._told:
            return
        self._told[page, about or text] = now
        for number, client in self._server.get_clients().items():
            if page in (0, number + 1):
                client.add_notification(title, text, auto_close_seconds=8.0, color=colour)

    def alarm(self, title: str, text: str) -> None:
        """Show a text on all pages, in red."""
        self.show(title, text, colour="red")

    def guarded(self, what: str, do: Callable[..., _T], *given: Any) -> _T | None:
        """Return what comes of it; None where it fails, which is said, and logged once."""
        try:
            return do(*given)
        except Exception as error:
            text = str(error) if isinstance(error, EulerParamsError) else defect(error)
            self.show(what, text, colour="red", about=f"{what}: {kind_of(error)}")
            if kind_of(error) not in self._failed:
                self._failed.add(kind_of(error))
                self._logger.error(f"{what}: {text}")
            return None
