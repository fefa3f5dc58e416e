"""`show`: a page on a sample of any problem in the plane."""

import socket
import sys
import threading
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Array, Bool

from deggflow.generation import Generation
from deggflow.guidance import AbstractRequirement, DecoupledGuidance
from deggflow.jsonl import expect_choice
from deggflow.requirements.layout import Layout

from .access import new_token
from .desk import AbstractDesk, Fields, Tell, unheard
from .problem import Regions, problem_json
from .server import StudioServer, studio_app

PAGE = "show.html"


class ShowDesk(AbstractDesk):
    """Answers pages on one sample."""

    def __init__(self, problem: dict[str, Any]) -> None:
        """Args: problem: of `problem_json`."""
        self.problem = problem

    def answer(
        self, ask: str, fields: Fields, check: Callable[[], None], tell: Tell = unheard
    ) -> dict[str, Any]:
        """The sample, whatever else the message holds."""
        expect_choice(ask, "ask", ("problem",))
        return self.problem

    def warm_up(self) -> None:
        """Nothing is compiled."""


class Show:
    """A page that is served until it is closed.

    Attributes:
        url: Where it is; holds a token.
    """

    def __init__(self, desk: AbstractDesk, port: int = 0) -> None:
        """Args: desk: answers the page; port: at 127.0.0.1, 0 for any free one."""
        listener = socket.create_server(("127.0.0.1", port))
        host, token = f"127.0.0.1:{listener.getsockname()[1]}", new_token()
        self.url = f"http://{host}/{token}/"
        self._server = StudioServer(studio_app({"show": desk}, token, [host], PAGE))
        self._thread = threading.Thread(target=self._server.run, args=([listener],), daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Serves the page until Ctrl-C."""
        try:
            while self._thread.is_alive():
                self._thread.join(0.5)
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """Stops serving the page."""
        self._server.should_exit = True
        self._thread.join(5)

    def _repr_html_(self) -> str:
        """A link, in a notebook."""
        return f'<a href="{escape(self.url)}" target="_blank">Open the sample in the studio</a>'


def show(
    sample: Generation,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    layout: Layout | None = None,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    agents: Sequence[str] | None = None,
    regions: Regions = (),
    browser: bool = True,
    block: bool | None = None,
    port: int = 0,
) -> Show:
    """Opens a page on a sample of any problem in the plane: states over tau, margins, values, inputs.

    The page is served at 127.0.0.1 alone, at an address that holds a token.

    Args:
        sample: `generate(..., keep_path=True)` of one sample.
        requirements: The guidance, or its requirements.
        condition: The condition of the requirements.
        layout: How states are read: `Layout(axes=2)` for points (the default), with a heading for poses, with
            waypoints for trajectories.
        mask: Which agents are present; None: all.
        agents: Names of the agents; "agent 0", ... if None.
        regions: Polygons to be drawn, for example obstacles, each of shape (corners, 2).
        browser: Open the browser.
        block: Serve until Ctrl-C; None: in scripts, but not in notebooks and interactive sessions.
        port: 0: any free one.

    Returns:
        The page: its `url`, `wait()` and `close()`.

    Raises:
        TypeError: `sample` is no generation.
        ValueError: `sample` has no path or has diverged, or the layout has not two axes.

    Example:
        >>> generation = generate(field, guidance, z0, condition, keep_path=True)
        >>> page = show(generation, guidance, condition, browser=False, block=False)
        >>> page.url.startswith("http://127.0.0.1:")
        True
        >>> page.close()
    """
    reading = Layout(axes=2) if layout is None else layout
    problem = problem_json(
        sample, requirements, condition, layout=reading, mask=mask, agents=agents, regions=regions
    )
    page = Show(ShowDesk(problem), port)
    if browser:
        import webbrowser

        webbrowser.open(page.url)
    if block or (block is None and not _interactive()):
        print(f"{page.url}\nThe page is served until Ctrl-C.", flush=True)
        page.wait()
    return page


def _interactive() -> bool:
    """Whether somebody types commands, in a notebook or at a prompt."""
    shell = sys.modules.get("IPython")
    return hasattr(sys, "ps1") or (shell is not None and shell.get_ipython() is not None)
