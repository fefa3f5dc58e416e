"""A message has the fields of its type, at fixed places, and no room for an input."""

import numpy as np
import pytest

from deggflow.runtime.messages import NUMBERS, RECORD_ONLY, AgentMessage, Layout

DIM, ROWS = 24, 2


def some_message(rng, dim=DIM, rows=ROWS):
    layout = Layout(dim=dim, rows=rows, dtype="float32")
    values = {}
    for name in AgentMessage._fields:
        shape = layout.fields[name].shape
        random = rng.normal(size=shape).astype(np.float32)
        values[name] = np.asarray(random if name in NUMBERS else random > 0)
    return AgentMessage(**values)


def test_a_message_is_what_was_encoded():
    rng = np.random.default_rng(0)
    layout = Layout(dim=DIM, rows=ROWS, dtype="float32")
    message = some_message(rng)
    for value, copy in zip(message, layout.decode(layout.encode(message)), strict=True):
        np.testing.assert_array_equal(value, copy)
        assert value.dtype == copy.dtype


@pytest.mark.parametrize(
    ("dim", "rows", "dtype", "size"),
    [(3, 1, "float32", 48), (24, 2, "float32", 152), (24, 2, "float64", 292)],
)
def test_bytes_are_counted(dim, rows, dtype, size):
    """tau, z, two numbers of the agent and four of each row; one byte for each flag, four of each row."""
    number = np.dtype(dtype).itemsize
    assert size == number * (1 + dim + 2 + 4 * rows) + 4 + 4 * rows
    layout = Layout(dim=dim, rows=rows, dtype=dtype)
    assert layout.size == size == sum(layout.fields[name].itemsize for name in AgentMessage._fields)
    assert layout.table().splitlines()[-1].split() == ["in", "all", str(size)]


def test_no_field_can_hold_an_input():
    """Only the state has as many entries as an input or a drift; everything else is a number or a flag a row."""
    layout = Layout(dim=DIM, rows=ROWS, dtype="float32")
    wide = [name for name in AgentMessage._fields if layout.fields[name].shape == (DIM,)]
    assert wide == ["z"]
    others = {layout.fields[name].shape for name in AgentMessage._fields if name != "z"}
    assert others == {(), (ROWS,)}
    assert {*RECORD_ONLY, "tau", "z", "value", "limit", "last"} == set(AgentMessage._fields)


def test_what_does_not_fit_is_refused():
    layout = Layout(dim=3, rows=1, dtype="float32")
    message = some_message(np.random.default_rng(1), 3, 1)
    with pytest.raises(ValueError, match=r"`z` of a message must have shape \(3,\); got \(4,\)"):
        layout.encode(message._replace(z=np.zeros(4)))
    data = layout.encode(message)
    with pytest.raises(ValueError, match="`data` must have the layout's 48 bytes; got 47"):
        layout.decode(data[:-1])
    with pytest.raises(ValueError, match="`last` of a message must be 0 or 1; got 7"):
        layout.decode(data[:-1] + b"\7")
