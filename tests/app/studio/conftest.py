"""The studio's parts: without its extra, their tests are skipped."""

import pytest

EXTRA = "the studio's extra is not installed: pip install 'deggflow[studio]'"
for package in ("starlette", "uvicorn", "websockets", "httpx2"):
    pytest.importorskip(package, reason=EXTRA)

from deggflow.studio.tabletop import TabletopDesk  # noqa: E402
from deggflow.tasks.tabletop.field import load_field  # noqa: E402


@pytest.fixture(scope="session")
def desk():
    """The desk that the command serves; programs are compiled for up to six objects alone."""
    return TabletopDesk(load_field)


@pytest.fixture
def ask(desk):
    """Asks the desk as a page does that stays open."""

    def asking(what, **fields):
        return desk.answer(what, fields, lambda: None)

    return asking
