"""The websocket of one page: its messages are answered in order; once the page is closed, its work stops."""

import json
import sys
import traceback
from collections.abc import Mapping
from functools import partial
from typing import Any

import anyio
import anyio.from_thread
from anyio.streams.memory import MemoryObjectReceiveStream, MemoryObjectSendStream
from starlette.websockets import WebSocket, WebSocketDisconnect

from deggflow.jsonl import InputError, expect_integer, expect_text, parse_line

from .desk import AbstractDesk, ClosedError
from .limits import MAX_MESSAGE, MAX_WAITING, RateLimit

_MAX_ID = 2**53 - 1  # integers that a page counts without rounding


class Conversation:
    """One page's websocket."""

    def __init__(
        self, socket: WebSocket, desk: AbstractDesk, workers: anyio.CapacityLimiter
    ) -> None:
        """Args: socket: of the page; desk: answers its messages; workers: limits the threads of all pages."""
        self.socket, self.desk, self.workers = socket, desk, workers
        self.rate = RateLimit()
        self.closed = False

    async def run(self) -> None:
        """Until the page is closed."""
        await self.socket.accept()
        waiting, messages = anyio.create_memory_object_stream[str](MAX_WAITING)
        async with waiting, messages, anyio.create_task_group() as tasks:
            tasks.start_soon(self._answer_all, messages)
            try:
                while True:
                    await self._take(await self.socket.receive_text(), waiting)
            except WebSocketDisconnect:
                pass
            except KeyError:  # bytes instead of text
                await self.socket.close(1003, "messages are text")
            finally:
                self.closed = True
                tasks.cancel_scope.cancel()

    async def _take(self, text: str, waiting: MemoryObjectSendStream[str]) -> None:
        if len(text) > MAX_MESSAGE:
            await self._refuse(f"the message is longer than {MAX_MESSAGE} bytes")
        elif not self.rate.allows():
            await self._refuse(f"more than {self.rate.rate:.0f} messages a second")
        else:
            try:
                waiting.send_nowait(text)
            except anyio.WouldBlock:
                await self._refuse(f"more than {MAX_WAITING} messages wait for an answer")

    async def _refuse(self, reason: str) -> None:
        await self._send({"id": None, "error": reason})

    async def _answer_all(self, messages: MemoryObjectReceiveStream[str]) -> None:
        async for text in messages:
            answer = await anyio.to_thread.run_sync(
                self._answer, text, abandon_on_cancel=True, limiter=self.workers
            )
            await self._send(answer)

    async def _send(self, answer: Mapping[str, Any]) -> None:
        try:
            await self.socket.send_text(json.dumps(answer, allow_nan=False))
        except (WebSocketDisconnect, RuntimeError):  # closed meanwhile
            self.closed = True

    def _tell(self, number: int, part: Mapping[str, Any]) -> None:
        """Called from a worker's thread."""
        self._check()
        anyio.from_thread.run(self._send, {"id": number, "part": part})

    def _check(self) -> None:
        if self.closed:
            raise ClosedError

    def _answer(self, text: str) -> dict[str, Any]:
        """Whatever happens, an answer: the page shows errors and goes on."""
        number: int | None = None
        try:
            message = parse_line(text.encode("utf-8", "surrogatepass"))
            if not isinstance(message, dict):
                raise InputError("a message must be a JSON object")
            fields = dict(message)
            number = expect_integer(fields.pop("id", None), "id", 0, _MAX_ID)
            ask = expect_text(fields.pop("ask", None), "ask")
            tell = partial(self._tell, number)
            return {"id": number, "answer": self.desk.answer(ask, fields, self._check, tell)}
        except InputError as error:
            return {"id": number, "error": str(error)}
        except ClosedError:
            return {"id": number, "error": "the page was closed"}
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            return {"id": number, "error": f"unforeseen error, {type(error).__name__}: {error}"}
