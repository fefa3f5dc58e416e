"""What answers a page's messages: one desk for each task."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from threading import Lock
from typing import Any, NamedTuple

from deggflow.jsonl import expect_choice
from deggflow.schema import parse_as

Fields = Mapping[str, Any]
"""A message without its "id" and "ask"."""

Tell = Callable[[Mapping[str, Any]], None]
"""Sends the page a part of an answer that is still being made, as a JSON object."""


def unheard(part: Mapping[str, Any]) -> None:
    """Sends nothing: for callers who want the answer alone."""


class ClosedError(Exception):
    """The page was closed: nobody waits for the answer."""


class AbstractDesk(ABC):
    """Answers the messages of all pages; keeps nothing of one that another one could see."""

    @abstractmethod
    def answer(
        self, ask: str, fields: Fields, check: Callable[[], None], tell: Tell = unheard
    ) -> dict[str, Any]:
        """The answer to one message, as a JSON object.

        Args:
            ask: What the page asks for.
            fields: The rest of the message, as yet unchecked.
            check: To be called now and then during long work; raises `ClosedError` if the page is gone.
            tell: Sends parts of the answer ahead; raises `ClosedError`, too.

        Raises:
            InputError: The message, or what it asks for, is invalid.
        """

    @abstractmethod
    def warm_up(self) -> None:
        """Does ahead what the first page will have to wait for."""


class LateDesk(AbstractDesk):
    """A desk that is loaded when it is first needed."""

    def __init__(self, load: Callable[[], AbstractDesk]) -> None:
        """Args: load: called once."""
        self._load, self._loading = load, Lock()
        self._desk: AbstractDesk | None = None

    def answer(
        self, ask: str, fields: Fields, check: Callable[[], None], tell: Tell = unheard
    ) -> dict[str, Any]:
        """As the desk answers."""
        return self._loaded().answer(ask, fields, check, tell)

    def warm_up(self) -> None:
        """Loads the desk, and warms it up."""
        self._loaded().warm_up()

    def _loaded(self) -> AbstractDesk:
        with self._loading:
            if self._desk is None:
                self._desk = self._load()
            return self._desk


class Asker(NamedTuple):
    """The page that waits for an answer.

    Attributes:
        check: To be called now and then during long work; raises `ClosedError` if the page is gone.
        tell: Sends parts of the answer ahead.
    """

    check: Callable[[], None]
    tell: Tell


Answers = Mapping[str, tuple[type[Any], Callable[[Any, Asker], dict[str, Any]]]]
"""By what is asked for: the message's fields as a dataclass, and what answers it."""


class TaskDesk(AbstractDesk):
    """A desk with one method for each kind of message."""

    @abstractmethod
    def answers(self) -> Answers:
        """What can be asked for."""

    def answer(
        self, ask: str, fields: Fields, check: Callable[[], None], tell: Tell = unheard
    ) -> dict[str, Any]:
        """The answer of the method for this kind of message, once the message is checked."""
        answers = self.answers()
        kind, respond = answers[expect_choice(ask, "ask", answers)]
        return respond(parse_as(kind, dict(fields)), Asker(check, tell))


NOBODY = Asker(lambda: None, unheard)
"""Asks what is answered to nobody, to have it compiled."""
