"""Processes with several agents each, which are told their neighbours' states alone."""

import queue
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    AfterPrediction,
    DecoupledGuidance,
    EveryStep,
    Held,
    PrivateRequirement,
    certify,
    distances,
    generate,
)
from deggflow.guidance import Local, Pairs, Pooled
from deggflow.runtime import (
    Exchange,
    PartProgram,
    PartStart,
    TeamError,
    Timing,
    owners_of,
    run_part,
)
from deggflow.runtime.part import within_links
from deggflow.step_guard import StepGuard

AGENTS, PROCESSES = 16, 4
BUFFER, APART = 0.02, 0.3
OWNERS = np.append(owners_of(AGENTS - 1, PROCESSES), -1)  # the last agent is absent


def guidance_with(allocation, **settings):
    apart = PrivateRequirement(
        lambda z, condition: distances(z, condition) - APART, BUFFER, allocation=allocation, name="apart", **settings,
    )  # fmt: skip
    return DecoupledGuidance((apart,))


GUIDANCE = guidance_with(Local(), per_owner_gain=True)


class Points:
    """Points of the plane, closer than a distance to one another."""

    skin = 0.02

    def pairs(self, z, condition):
        near = distances(z, condition) < APART + BUFFER + self.skin
        one, other = (each.ravel() for each in jnp.indices(near.shape))
        return Pairs(one, other, near.ravel()), jnp.asarray(True)

    def way(self, before, after, condition):
        return jnp.linalg.norm(after - before, axis=-1)

    def only(self, mask, condition):
        return condition & mask


class Queues:
    """Carries messages between threads; loses those that `lose` names."""

    def __init__(self, count, lose=lambda: False):
        self.waiting = [queue.SimpleQueue() for _ in range(count)]
        self.lose, self.sent = lose, set()

    def of(self, number):
        one = Queues(0, self.lose)
        one.waiting, one.number, one.sent = self.waiting, number, self.sent
        return one

    def send(self, number, message):
        self.sent.add((number, message))
        if not self.lose():
            self.waiting[number].put(message)

    def receive(self, seconds):
        try:
            return self.waiting[self.number].get(timeout=max(seconds, 1e-6))
        except queue.Empty:
            return None

    def gone(self):
        return frozenset()


def together(work, count):
    """What each of some threads returns or raises."""
    out = [None] * count

    def run(number):
        try:
            with jax.enable_x64(True):
                out[number] = work(number)
        except Exception as error:
            out[number] = error

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    for one in out:
        if isinstance(one, Exception) and not isinstance(one, TeamError):
            raise one
    return out


def field(tau, z, condition):
    return jnp.where(condition[:, None], 0.3 * jnp.sin(3 * z), 0.0)


def points(seed):
    """Points along a line, as a strip of which each process has a piece."""
    rng = np.random.default_rng(seed)
    line = np.linspace(0.0, 3.2, AGENTS)
    return np.stack([line, np.zeros(AGENTS)], axis=-1) + rng.normal(size=(AGENTS, 2)) * 0.05


def program(grid):
    return PartProgram(
        field, GUIDANCE, Points(), grid=grid, drift=AfterPrediction(Held(2)), guard=StepGuard()
    )


def test_parts_generate_what_the_batched_program_does_from_borders_alone():
    """In float64, with refused steps and lists that are made again. All that the summary holds is compared."""
    with jax.enable_x64(True):
        grid, z0, mask = np.linspace(0.0, 1.0, 13), points(1), OWNERS >= 0
        team, transport, events = program(grid), Queues(PROCESSES), [[] for _ in range(PROCESSES)]

        def part(number):
            exchange = Exchange(
                number,
                PROCESSES,
                transport.of(number),
                Timing(deadline=60.0),
                events[number].append,
            )
            return run_part(
                team, PartStart(number, OWNERS, z0, jnp.asarray(mask)), exchange, patience=60.0
            )

        results = together(part, PROCESSES)
        whole = generate(
            field, GUIDANCE, z0, jnp.asarray(mask), grid=grid, drift=AfterPrediction(Held(2)), mask=mask, keep_trace=False,
        )  # fmt: skip
        for one in results[1:]:
            assert jax.tree.all(jax.tree.map(np.array_equal, one.generation.summary, results[0].generation.summary))  # fmt: skip
        one, other = (jax.tree.leaves(one.summary) for one in (results[0].generation, whole))
        for mine, theirs in zip(one, other, strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-6, atol=1e-8)
        assert results[0].certify(GUIDANCE, jnp.asarray(mask), mask=mask).satisfied
        assert certify(whole, GUIDANCE, jnp.asarray(mask), mask=mask).satisfied
    work = whole.work
    assert work.refused_steps > 0
    rounds = len(events[0])
    # One round for all states at first, one for each refusal, and two at the end; the others are of new lists.
    new_lists = rounds - int(work.evaluations) - int(work.refused_steps) - 3
    assert new_lists > 0
    sums, state = 12 + 4 * 8 + 2, 2 * 8
    states = [(len(message) - sums) / state for _, message in transport.sent]
    state_counts = [count for count in states if count >= 0]
    assert np.mean(state_counts) < AGENTS / PROCESSES / 2
    assert max(state_counts) > 0


def test_three_links_of_a_chain_in_both_directions():
    one, other = jnp.arange(7), jnp.arange(7) + 1
    pairs = Pairs(one, other, one != 5)  # 5 and 6 are not linked
    for some, near in ((0, [0, 1, 2, 3]), (4, [1, 2, 3, 4, 5]), (7, [6, 7])):
        assert np.flatnonzero(within_links(pairs, np.arange(8) == some)).tolist() == near


def test_rounds_are_complete_although_messages_are_lost():
    """Until one has completed its rounds: whose last messages are lost would be waited for until the deadline."""
    chance, complete = np.random.default_rng(0), threading.Event()
    transport = Queues(3, lambda: not complete.is_set() and chance.random() < 0.4)
    timing = Timing(deadline=60.0, tick=0.002)

    def work(number):
        exchange = Exchange(number, 3, transport.of(number), timing)
        rounds = [
            exchange.swap({k: f"{number} to {k}: {turn}".encode() for k in exchange.others})
            for turn in range(30)
        ]
        complete.set()
        exchange.finish()
        return rounds

    for number, rounds in enumerate(together(work, 3)):
        for turn, one in enumerate(rounds):
            assert one == {k: f"{k} to {number}: {turn}".encode() for k in range(3) if k != number}


def test_who_is_silent_ends_the_team_and_is_named():
    exchange = Exchange(0, 2, Queues(2).of(0), Timing(deadline=0.05, tick=0.01))
    with pytest.raises(TeamError, match=r"process 1 was silent for 0\.05 s in round 1"):
        exchange.swap({1: b""})


def test_processes_that_were_given_something_else_do_not_begin():
    team, transport = program(np.linspace(0.0, 1.0, 5)), Queues(2)

    def work(number):
        exchange = Exchange(number, 2, transport.of(number), Timing(deadline=60.0))
        owners, mask = owners_of(AGENTS, 2), jnp.ones(AGENTS, bool)
        return run_part(
            team, PartStart(number, owners, points(number), mask), exchange, patience=60.0
        )

    for number, error in enumerate(together(work, 2)):
        assert f"process {1 - number} was given another scene" in str(error)


@pytest.mark.parametrize(
    ("guidance", "drift", "error", "match"),
    [
        (guidance_with(Local()), AfterPrediction(Held(2)), ValueError, "`guidance` must have one"),
        (guidance_with(Pooled(), per_owner_gain=True), AfterPrediction(Held(2)), ValueError, "got apart"),
        (GUIDANCE, EveryStep(), TypeError, "`drift` must be an `AfterPrediction`; got EveryStep"),
    ],
)  # fmt: skip
def test_what_would_need_all_states_is_refused(guidance, drift, error, match):
    with pytest.raises(error, match=match):
        PartProgram(field, guidance, Points(), grid=np.linspace(0, 1, 5), drift=drift, guard=StepGuard())  # fmt: skip
