"""The studio: pages on this machine on which requirements are edited by hand and scenes and trials follow at once.

`deggflow studio` starts a server (`server`) for pages that know its token (`access`). A page and the server exchange
messages over one websocket (`conversation`); what the server makes of a message is a task's (`tabletop`, `bridge`).
Videos are drawn by processes of their own (`films`). `show` opens such a page on a sample of any problem in the plane.
"""

from typing import TYPE_CHECKING

from deggflow.lazy import lazy_names

if TYPE_CHECKING:
    from .showing import Show, show

__all__ = ["Show", "show"]

# The command's help does without JAX.
__getattr__ = lazy_names(__name__, {"showing": ("Show", "show")})
