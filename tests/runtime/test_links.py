"""Transports are opened by name and address, and sort what they receive."""

import pytest

from deggflow.runtime import loopback_addresses, open_transport, sorted_by


@pytest.mark.parametrize(
    ("name", "addresses", "match"),
    [
        ("udp", ["127.0.0.1", "127.0.0.1:1"], "must be HOST:PORT.* got 127.0.0.1"),
        ("udp", ["127.0.0.1:0", "127.0.0.1:1"], "must be HOST:PORT.* got 127.0.0.1:0"),
        ("udp", ["127.0.0.1:1", "127.0.0.1:1"], "must differ from one another"),
        ("zenoh", ["127.0.0.1:1", "127.0.0.1:2"], r"PROTOCOL/HOST:PORT, such as .tcp/127.0.0.1:1"),
    ],
)
def test_addresses_are_checked(name, addresses, match):
    with pytest.raises(ValueError, match=match):
        open_transport(name, 0, addresses)


def test_who_is_not_among_the_addresses_is_named():
    with pytest.raises(ValueError, match=r"`number` must be in \[0, 1\]; got 2"):
        open_transport("udp", 2, ["127.0.0.1:1", "127.0.0.1:2"])


def test_each_part_gets_its_own_messages():
    """Whatever arrives while the other part is waiting is kept, in order."""
    addresses = loopback_addresses("udp", 2)
    here, there = (open_transport("udp", k, addresses) for k in range(2))
    mine, others = sorted_by(here, b"world")
    messages = [b"world 1", b"a", b"b", b"world 2", b"world 3", b"c"]
    for message in messages:
        there.broadcast(message)
    assert [others.receive(60.0) for _ in range(3)] == [b"a", b"b", b"c"]
    assert [mine.receive(60.0) for _ in range(3)] == [b"world 1", b"world 2", b"world 3"]
    assert mine.receive(0.0) is None
    assert others.gone() == frozenset()
    mine.close()
    there.close()
