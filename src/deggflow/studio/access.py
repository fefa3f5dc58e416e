"""Who may talk to the studio: pages that the studio itself has served, opened with its token."""

import hmac
import secrets
from collections.abc import Iterable
from typing import Any

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

NO_TOKEN = "Open the address that `deggflow studio` has printed; it holds a token, which this address lacks."
FOREIGN = "The studio answers requests of its own page alone."
_HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


def new_token() -> str:
    """A token that can't be guessed, of characters that stay as they are in an address."""
    return secrets.token_urlsafe(24)


class Access:
    """Lets requests through that name one of the studio's hosts, come from its page, and begin with its token.

    The host is checked because a page elsewhere can let its own name point to this machine (DNS rebinding); the
    origin, because a page elsewhere may send requests here.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: Iterable[str]) -> None:
        """One studio.

        Args:
            app: What answers the requests that are let through.
            token: First part of every path.
            hosts: "address:port" as it stands in the browser's address line.
        """
        self.app, self.token = app, token.encode()
        self.hosts = frozenset(hosts)
        self.origins = frozenset(f"http://{host}" for host in self.hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request, or refuses it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if scope["type"] == "websocket":
            if refusal is None:
                await self.app(scope, receive, send)
            else:
                await send({"type": "websocket.close", "code": 1008, "reason": refusal[1]})
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", ()), *extra]}
            await send(message)

        answer = self.app if refusal is None else PlainTextResponse(refusal[1], refusal[0])
        await answer(scope, receive, send_guarded)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and text with which a request is refused; None if it is let through."""
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts:
            return 421, FOREIGN
        needed = scope["type"] == "websocket"
        if len(origins) > 1 or (needed and not origins) or not self.origins.issuperset(origins):
            return 403, FOREIGN
        if not hmac.compare_digest(_first_part(scope), self.token):
            return 404, NO_TOKEN
        return None


def _first_part(scope: Any) -> bytes:
    path: str = scope["path"]
    return path.removeprefix("/").partition("/")[0].encode("utf-8", "surrogateescape")
