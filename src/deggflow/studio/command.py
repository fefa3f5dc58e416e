"""`deggflow studio`: serves the page until it is interrupted."""

import ipaddress
import os
import signal
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from deggflow.app.session import SATISFIED, console, prepare_jax
from deggflow.extras import imported
from deggflow.jsonl import InputError
from deggflow.task import check_range

PORT = 8765
TOKEN = "DEGGFLOW_STUDIO_TOKEN"
_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")


def studio(
    host: str = "127.0.0.1",
    port: int = PORT,
    browser: bool = True,
    weights: Path | None = None,
    bridge_weights: Path | None = None,
) -> int:
    """Open a page in the browser on which requirements are edited by hand; scenes and bridge trials follow at once.

    Needs `pip install 'deggflow[studio]'`, and no network. The page is reached at the printed address alone, which
    holds a token. Set DEGGFLOW_STUDIO_TOKEN to keep the address over several starts.

    Args:
        host: Address of this machine to listen at; others can then open the page if they know the token.
        port: If it is in use, another one is chosen; 0: any free one.
        browser: Open the browser.
        weights: Weights of the tabletop's field; default: the shipped ones.
        bridge_weights: Weights of the bridge's field; default: the shipped ones.
    """
    check_range("port", port, 0, 65535)
    address = _address(host)
    for path in (weights, bridge_weights):
        if path is not None and not path.is_file():
            raise InputError("there is no such file", file=path)
    for package in ("starlette", "uvicorn", "websockets"):
        imported(package, "studio", "the studio")
    from .access import new_token
    from .server import StudioServer, studio_app

    token = _given_token() or new_token()
    listener = _listener(address, port)
    where = _with_port(address, listener.getsockname()[1])
    desks = _late_desks(weights, bridge_weights)
    hosts = [where, *([where.replace("127.0.0.1", "localhost")] if address == "127.0.0.1" else [])]
    url = f"http://{where}/{token}/"
    _leave_when_interrupted()
    print(url, flush=True)
    console().print("The studio runs until Ctrl-C. Keep the address to yourself: it holds a token.")
    threading.Thread(target=_warm_up, args=(desks["tabletop"],), daemon=True).start()
    if browser:
        threading.Thread(target=_open, args=(url,), daemon=True).start()
    StudioServer(studio_app(desks, token, hosts)).run(sockets=[listener])
    return SATISFIED


def _late_desks(weights: Path | None, bridge_weights: Path | None) -> dict[str, Any]:
    """Desks that are imported, with JAX, by the first thread that needs them: the page is served at once."""
    from .desk import LateDesk

    def tabletop() -> Any:
        prepare_jax()
        from deggflow.tasks.tabletop.field import load_field

        from .tabletop import TabletopDesk

        return TabletopDesk(lambda: load_field(weights))

    def bridge() -> Any:
        prepare_jax()
        from deggflow.tasks.bridge.field import load_field

        from .bridge import BridgeDesk

        return BridgeDesk(lambda: load_field(bridge_weights))

    def film() -> Any:
        from .films import FilmDesk

        return FilmDesk()

    return {"tabletop": LateDesk(tabletop), "bridge": LateDesk(bridge), "film": LateDesk(film)}


def _warm_up(desk: Any) -> None:
    with suppress(InputError):  # of the weights; the page will be told
        desk.warm_up()


def _address(host: str) -> str:
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        raise InputError(f"--host must be an IP address or localhost; got {host!r}") from None
    if address.is_unspecified:
        raise InputError(
            f"--host must be one address of this machine, as the browser names it; got {host}, which is all of them"
        )
    return str(address)


def _given_token() -> str | None:
    token = os.environ.get(TOKEN)
    if token is not None and not (len(token) >= 16 and _CHARACTERS.issuperset(token)):
        raise InputError(f"{TOKEN} must have at least 16 letters, digits, - or _")
    return token


def _listener(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    if os.name == "posix":  # elsewhere it would let two servers share the port
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((address, port))
    except OSError as error:
        if port != PORT:
            listener.close()
            raise InputError(f"can't listen at {address}, port {port}: {error.strerror}") from None
        listener.bind((address, 0))
    listener.listen()  # whoever opens the address before the server runs has to wait, not to fail
    return listener


def _with_port(address: str, port: int) -> str:
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"


def _leave_when_interrupted() -> None:
    """On Ctrl-C the command ends at once: the server keeps nothing that could be lost."""

    def leave(*_: object) -> None:
        os.write(2, b"\ndeggflow: the studio has stopped\n")
        os._exit(SATISFIED)

    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, leave)


def _open(url: str) -> None:
    import webbrowser

    webbrowser.open(url)
