"""The studio's parts: without its extra, their tests are skipped.

Chromium is looked for on the PATH (Debian: `apt-get install chromium`), or where DEGGFLOW_CHROMIUM says.
"""

import os
import shutil
import socket
import threading

import pytest

EXTRA = "the studio's extra is not installed: pip install 'deggflow[studio]'"
for package in ("starlette", "uvicorn", "websockets", "httpx2"):
    pytest.importorskip(package, reason=EXTRA)

from deggflow.studio.bridge import BridgeDesk  # noqa: E402
from deggflow.studio.films import FilmDesk  # noqa: E402
from deggflow.studio.server import StudioServer, studio_app  # noqa: E402
from deggflow.studio.tabletop import TabletopDesk  # noqa: E402
from deggflow.tasks.bridge.field import load_field as load_bridge_field  # noqa: E402
from deggflow.tasks.tabletop.field import load_field  # noqa: E402

CHROMIUM = os.environ.get("DEGGFLOW_CHROMIUM") or next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
TOKEN = "token-of-the-browser-tests"


@pytest.fixture(scope="session")
def desk():
    """The desk that the command serves; programs are compiled for up to six objects alone."""
    return TabletopDesk(load_field)


@pytest.fixture(scope="session")
def bridge_desk():
    """The bridge's desk that the command serves."""
    return BridgeDesk(load_bridge_field)


class Served:
    """A studio that can be stopped and started at the same address."""

    def __init__(self, desks):
        self.desks, self.port = desks, 0
        self.start()

    def start(self):
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", self.port))
        self.port = listener.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        self.server = StudioServer(studio_app(self.desks, TOKEN, [self.host]))
        self.thread = threading.Thread(target=self.server.run, args=([listener],), daemon=True)
        self.thread.start()

    def stop(self):
        self.server.should_exit = True
        self.thread.join(30)

    @property
    def address(self):
        return f"http://{self.host}/{TOKEN}/"


@pytest.fixture(scope="session")
def served(desk, bridge_desk):
    studio = Served({"tabletop": desk, "bridge": bridge_desk, "film": FilmDesk()})
    yield studio
    studio.stop()


@pytest.fixture(scope="session")
def browser():
    if CHROMIUM is None:
        pytest.skip("no Chromium on the PATH")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with api.sync_playwright() as playwright:
        # No name is resolved: whatever is not the studio itself can't be reached.
        arguments = ["--no-sandbox", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def ask(desk):
    """Asks the desk as a page does that stays open."""

    def asking(what, **fields):
        return desk.answer(what, fields, lambda: None)

    return asking
