"""A page's messages: bad ones are answered in one line, and what one page does is nothing to another."""

import json
import threading
import time

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from deggflow.jsonl import InputError
from deggflow.studio.desk import AbstractDesk, ClosedError
from deggflow.studio.limits import MAX_MESSAGE, MAX_PAGES, MAX_WAITING, RateLimit
from deggflow.studio.server import studio_app

HOST = "127.0.0.1:8765"


class Counting(AbstractDesk):
    """Counts for as long as somebody waits."""

    def __init__(self):
        self.started, self.stopped = threading.Event(), threading.Event()

    def answer(self, ask, fields, check, tell):
        if ask == "count":
            self.started.set()
            try:
                while True:
                    check()
                    time.sleep(0.005)
            except ClosedError:
                self.stopped.set()
                raise
        if ask == "parts":
            for k in range(3):
                tell({"number": k})
        if ask == "sleep":
            time.sleep(fields["seconds"])
        if ask == "fail":
            raise ZeroDivisionError("by design")
        if ask == "refuse":
            raise InputError("is wrong", field="size")
        return {"ask": ask, **fields}

    def warm_up(self):
        pass


@pytest.fixture
def desk():
    return Counting()


@pytest.fixture
def client(desk):
    with TestClient(
        studio_app({"desk": desk}, "token-of-tests", [HOST]), base_url=f"http://{HOST}"
    ) as client:
        yield client


def connect(client):
    return client.websocket_connect(
        f"ws://{HOST}/token-of-tests/socket/desk", headers={"origin": f"http://{HOST}"}
    )


def told(socket, text):
    socket.send_text(text if isinstance(text, str) else json.dumps(text))
    return json.loads(socket.receive_text())


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "the line is empty"),
        ("nonsense", "not JSON"),
        ("[]", "must be a JSON object"),
        ('{"id": 1, "id": 2}', "field `id`: this key is listed twice"),
        ('{"id": 1, "ask": NaN}', "NaN is not a finite number"),
        ('{"ask": "x"}', "field `id`: must be an integer"),
        ('{"id": true, "ask": "x"}', "field `id`: must be an integer"),
        ('{"id": 1}', "field `ask`: must be text"),
        ('{"id": 1, "ask": "refuse"}', "field `size`: is wrong"),
        ("[" * 100_000, "nested too deeply"),
        ('{"id": 1, "ask": ' + "9" * 5000 + "}", "too many digits"),
    ],
)
def test_a_bad_message_is_answered_in_one_line_and_survived(client, text, error):
    with connect(client) as socket:
        answer = told(socket, text)
        assert error in answer["error"]
        assert "\n" not in answer["error"]
        assert told(socket, {"id": 7, "ask": "echo"}) == {"id": 7, "answer": {"ask": "echo"}}


def test_parts_of_an_answer_come_before_it(client):
    with connect(client) as socket:
        parts = [told(socket, {"id": 4, "ask": "parts"}), *(json.loads(socket.receive_text()) for _ in range(2))]  # fmt: skip
        assert parts == [{"id": 4, "part": {"number": k}} for k in range(3)]
        assert json.loads(socket.receive_text()) == {"id": 4, "answer": {"ask": "parts"}}


def test_an_error_of_the_server_is_told_and_survived(client, capfd):
    with connect(client) as socket:
        answer = told(socket, {"id": 1, "ask": "fail"})
        assert answer == {"id": 1, "error": "unforeseen error, ZeroDivisionError: by design"}
        assert told(socket, {"id": 2, "ask": "echo"})["id"] == 2
    assert "Traceback" in capfd.readouterr().err


def test_two_pages_are_apart(client):
    """Each gets the answers to its own messages, though their numbers are the same."""
    with connect(client) as one, connect(client) as other:
        for k in range(5):
            one.send_text(json.dumps({"id": k, "ask": "one"}))
            other.send_text(json.dumps({"id": k, "ask": "other"}))
        for k in range(5):
            assert json.loads(one.receive_text()) == {"id": k, "answer": {"ask": "one"}}
            assert json.loads(other.receive_text()) == {"id": k, "answer": {"ask": "other"}}


def test_a_closed_page_stops_its_work(client, desk):
    with connect(client) as socket:
        socket.send_text(json.dumps({"id": 1, "ask": "count"}))
        assert desk.started.wait(600)
        assert not desk.stopped.is_set()
    assert desk.stopped.wait(600)
    with connect(client) as socket:
        assert told(socket, {"id": 2, "ask": "echo"})["id"] == 2


def test_a_message_that_is_too_long_is_refused(client):
    with connect(client) as socket:
        answer = told(socket, json.dumps({"id": 1, "ask": "x" * MAX_MESSAGE}))
        assert answer == {"id": None, "error": f"the message is longer than {MAX_MESSAGE} bytes"}


def test_bytes_close_the_connection(client):
    with connect(client) as socket:
        socket.send_bytes(b'{"id": 1, "ask": "echo"}')
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_messages_that_pile_up_are_refused(client):
    with connect(client) as socket:
        socket.send_text(json.dumps({"id": 0, "ask": "sleep", "seconds": 0.5}))
        for k in range(1, MAX_WAITING + 5):
            socket.send_text(json.dumps({"id": k, "ask": "echo"}))
        answers = [json.loads(socket.receive_text()) for _ in range(MAX_WAITING + 5)]
        refused = [each for each in answers if each["id"] is None]
        assert refused
        assert all("wait for an answer" in each["error"] for each in refused)
        assert {"id": 1, "answer": {"ask": "echo"}} in answers


def test_there_are_only_so_many_pages(client):
    pages = [connect(client) for _ in range(MAX_PAGES)]
    for page in pages:
        page.__enter__()
    with pytest.raises(WebSocketDisconnect) as refused, connect(client):
        pass
    assert refused.value.code == 1013
    for page in pages:
        page.__exit__(None, None, None)
    with connect(client) as socket:
        assert told(socket, {"id": 1, "ask": "echo"})["id"] == 1


def test_the_rate_is_limited_over_time():
    now = 0.0
    limit = RateLimit(rate=10.0, burst=5.0, clock=lambda: now)
    assert [limit.allows() for _ in range(7)] == [True] * 5 + [False] * 2
    now = 0.25  # two and a half more
    assert [limit.allows() for _ in range(4)] == [True, True, False, False]
    now = 1000.0
    assert sum(limit.allows() for _ in range(10)) == 5
