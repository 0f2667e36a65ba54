"""The server of the pages, and who may connect to it."""

import io
import socket
from contextlib import redirect_stdout
from typing import Any

import viser
import websockets.asyncio.server as websockets

from eulerparams_control.errors import ConfigurationError

LOCAL = "127.0.0.1"


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
