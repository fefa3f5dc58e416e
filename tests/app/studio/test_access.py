"""Nobody but a page that the studio has served is answered."""

import re

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from deggflow.studio.desk import AbstractDesk
from deggflow.studio.server import page_assets, studio_app

TOKEN, HOST = "a-token-of-the-tests", "127.0.0.1:8765"
ORIGIN = {"origin": f"http://{HOST}"}
SOCKET = f"ws://{HOST}/{TOKEN}/socket/echo"


class Echo(AbstractDesk):
    def answer(self, ask, fields, check, tell):
        return {"ask": ask, **fields}

    def warm_up(self):
        pass


@pytest.fixture
def client():
    return TestClient(studio_app({"echo": Echo()}, TOKEN, [HOST]), base_url=f"http://{HOST}")


def test_the_page_and_all_its_files_are_served(client):
    page = client.get(f"/{TOKEN}/")
    assert page.status_code == 200
    assert "deggflow studio" in page.text
    for name, asset in page_assets().items():
        answer = client.get(f"/{TOKEN}/{name}")
        assert answer.content == asset.content
        assert answer.headers["content-type"] == asset.type


def test_pages_have_the_parts_that_they_share():
    pages = {name: asset.content for name, asset in page_assets().items() if name.endswith(".html")}
    assert set(pages) == {"index.html", "bridge.html", "show.html"}
    for page in pages.values():
        assert page.startswith(b"<!DOCTYPE html>\n")
        assert page.rstrip().endswith(b"</html>")
        assert b"<!-- part" not in page


def test_the_page_asks_nothing_of_another_host(client):
    policy = client.get(f"/{TOKEN}/").headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name, asset in page_assets().items():
        addresses = re.findall(rb"https?://[^\s\"')]+", asset.content)
        assert set(addresses) <= {b"http://www.w3.org/2000/svg"}, name


@pytest.mark.parametrize("token", ["", "wrong", TOKEN[:-1], TOKEN + "x", TOKEN.upper(), "ä"])
@pytest.mark.parametrize("path", ["", "main.js", "socket/echo"])
def test_without_the_token_nothing_is_served(client, token, path):
    answer = client.get(f"/{token}/{path}")
    assert answer.status_code == 404
    assert "deggflow studio" in answer.text  # what to do instead
    assert TOKEN not in answer.text


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1", "127.0.0.1:80", "", "localhost:8765.evil.example"])  # fmt: skip
def test_a_name_that_is_not_the_studios_is_refused(client, host):
    """A page elsewhere can let its own name point to this machine."""
    assert client.get(f"/{TOKEN}/", headers={"host": host}).status_code == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8765", "http://127.0.0.1:9"])  # fmt: skip
def test_another_pages_requests_are_refused(client, origin):
    assert client.get(f"/{TOKEN}/", headers={"origin": origin}).status_code == 403
    with pytest.raises(WebSocketDisconnect) as refused, client.websocket_connect(SOCKET, headers={"origin": origin}):  # fmt: skip
        pass
    assert refused.value.code == 1008


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        (SOCKET, {}),
        (SOCKET.replace(TOKEN, "wrong"), ORIGIN),
        (SOCKET, {**ORIGIN, "host": "evil.example"}),
    ],
    ids=["no origin", "wrong token", "foreign host"],
)
def test_a_websocket_needs_host_origin_and_token(client, path, headers):
    with pytest.raises(WebSocketDisconnect), client.websocket_connect(path, headers=headers):
        pass


def test_the_pages_own_websocket_is_let_in(client):
    with client.websocket_connect(SOCKET, headers=ORIGIN) as socket:
        socket.send_text('{"id": 1, "ask": "hello"}')
        assert socket.receive_json() == {"id": 1, "answer": {"ask": "hello"}}


@pytest.mark.parametrize("path", ["../pyproject.toml", "..%2f..%2fpyproject.toml", "%2e%2e/server.py", "/etc/passwd", "%2fetc%2fpasswd", "server.py", "page/main.js", "main.js%00"])  # fmt: skip
def test_no_path_reaches_the_file_system(client, path):
    assert client.get(f"/{TOKEN}/{path}").status_code in (404, 400)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_files_are_only_read(client, method):
    assert client.request(method, f"/{TOKEN}/").status_code == 405
