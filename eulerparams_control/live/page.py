"""The server of the pages, who may connect to it, and the notices on them."""

import io
import socket
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any, TypeVar

import viser
import websockets.asyncio.server as websockets

from eulerparams_control.control.clock import steady
from eulerparams_control.errors import ConfigurationError, EulerParamsError, defect, kind_of

LOCAL = "127.0.0.1"

_T = TypeVar("_T")
_AGAIN = 5.0  # [s] after which the same notice is shown again


def serve(host: str, port: int) -> viser.ViserServer:
    """Return a server on ``port``, or on the next one that is free.

    Only its own pages may connect, opened at ``host`` or on this machine: a page of somebody else,
    open in the same browser, must not move the arm.

    Raises:
        ConfigurationError: if the host is no address of this machine, or viser cannot be guarded.
    """
    try:
        with socket.create_server((host, 0)) as free:  # viser would wait for ever
            port = port or free.getsockname()[1]
    except OSError as error:
        raise ConfigurationError(f"--host {host}: {error}; expected one of this machine") from error
    serve, guarded = websockets.serve, []

    def guard(handler: Any, host: str, port: int, **given: Any) -> Any:
        guarded.append(port)
        origins: list[Any] = [
            f"http://{name}:{port}" for name in (LOCAL, "localhost", host.lower())
        ]
        return serve(handler, host, port, **given, origins=[*origins, None])  # None: a program

    websockets.serve = guard  # type: ignore[misc, assignment]
    try:
        with redirect_stdout(io.StringIO()):
            server = viser.ViserServer(host, port, verbose=False)
    finally:
        websockets.serve = serve  # type: ignore[misc]
    if server.get_port() not in guarded:
        stop(server)
        raise ConfigurationError("viser cannot be guarded; install the release of setup.py")
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server


def stop(server: viser.ViserServer) -> None:
    """End a server."""
    with redirect_stdout(io.StringIO()):
        server.stop()


class Notices:
    """Shows notices.

    Args:
        server: of the pages.
        log: takes an error, in words.
    """

    def __init__(self, server: viser.ViserServer, log: Callable[[str], None]) -> None:
        self._server, self._log = server, log
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
                self._log(f"{what}: {text}")
            return None
