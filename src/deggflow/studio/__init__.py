"""The studio: pages on this machine on which requirements are edited by hand and scenes and trials follow at once.

`deggflow studio` starts a server (`server`) for pages that know its token (`access`). A page and the server exchange
messages over one websocket (`conversation`); what the server makes of a message is a task's (`tabletop`, `bridge`).
Videos are drawn by processes of their own (`films`). `show` opens such a page on a sample of any problem in the plane.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .showing import Show, show

__all__ = ["Show", "show"]


def __getattr__(name: str) -> Any:
    """Imports `show` when it is first used: the command's help does without JAX."""
    if name in __all__:
        from . import showing

        return getattr(showing, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
