"""The studio's web application: the page's files, and a websocket for each page."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import NamedTuple

import anyio
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from deggflow.blocks import cores

from .access import Access
from .conversation import Conversation
from .desk import AbstractDesk
from .limits import MAX_MESSAGE, MAX_PAGES, MAX_REQUESTS

_TYPES = {
    "html": "text/html; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "svg": "image/svg+xml",
}
_PART = re.compile(rb"<!-- part: ([a-z]+) -->\n")


class Asset(NamedTuple):
    """A file of the page.

    Attributes:
        content: As it is sent.
        type: Its media type.
    """

    content: bytes
    type: str


def page_assets() -> dict[str, Asset]:
    """The page's files by name, read once: no request reaches the file system."""
    folder = files(__package__).joinpath("page")
    return {
        entry.name: Asset(_whole(entry, folder), _TYPES[entry.name.rpartition(".")[2]])
        for entry in folder.iterdir()
        if entry.name.rpartition(".")[2] in _TYPES
    }


def _whole(entry: Traversable, folder: Traversable) -> bytes:
    """A file with what pages share: `<!-- part: head -->` stands for `parts/head.html`."""

    def part(mark: re.Match[bytes]) -> bytes:
        return folder.joinpath("parts", f"{mark[1].decode()}.html").read_bytes()

    return _PART.sub(part, entry.read_bytes())


def studio_app(
    desks: Mapping[str, AbstractDesk],
    token: str,
    hosts: Iterable[str],
    index: str = "index.html",
) -> ASGIApp:
    """The application that a server runs.

    Args:
        desks: Answer the pages' messages; each page names its own.
        token: First part of every path.
        hosts: "address:port" that the browser may use.
        index: File of the page that the address opens.
    """
    assets = page_assets()
    # Each desk has its own: a long answer of one, such as a video, takes no thread from the others.
    workers = {name: anyio.CapacityLimiter(cores()) for name in desks}
    pages = Counter[str]()

    async def asset(request: Request) -> Response:
        name = request.path_params.get("name") or index
        if name not in assets:
            return PlainTextResponse("The page has no such file.", 404)
        return Response(assets[name].content, media_type=assets[name].type)

    async def talk(socket: WebSocket) -> None:
        name = socket.path_params["desk"]
        desk = desks.get(name)
        if desk is None:
            await socket.close(1008, f"the studio has desks for {', '.join(desks)} alone")
            return
        if pages[name] >= MAX_PAGES:
            await socket.close(1013, f"the studio serves at most {MAX_PAGES} pages at once")
            return
        pages[name] += 1
        try:
            await Conversation(socket, desk, workers[name]).run()
        finally:
            pages[name] -= 1

    routes = [
        WebSocketRoute("/{token}/socket/{desk}", talk),
        Route("/{token}/", asset),
        Route("/{token}/{name}", asset),
    ]
    return Access(Starlette(routes=routes), token, hosts)


class StudioServer(uvicorn.Server):
    """A server that leaves signals to the command, and keeps no log."""

    def __init__(self, app: ASGIApp) -> None:
        """Args: app: of a studio."""
        super().__init__(
            uvicorn.Config(
                app, log_level="error", access_log=False, server_header=False, lifespan="off",
                ws="websockets-sansio", ws_max_size=MAX_MESSAGE, limit_concurrency=MAX_REQUESTS,
                timeout_graceful_shutdown=1,
            )
        )  # fmt: skip

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Captures none."""
        yield
