"""All who go on have the same rounds and lose the same members, whatever the network does."""

import random

import numpy as np
import pytest
from logger_cases import SIZE, play

from deggflow.runtime.agreement import (
    Agreement,
    DisagreementError,
    MembersLost,
    RoundComplete,
    SuspectedError,
    TeamError,
    TooManyLostError,
)
from deggflow.runtime.simulation import Fault, Network

SEEDS = 60
QUIET = Network(loss=0.0, duplication=0.0, partitions=0)


def results(team):
    return [logger.result for logger in team if logger.result is not None]


def lost_in(log):
    return {one for kind, lost in log if kind == "lost" for one in lost}


def some_faults(rng, agents, faults, most, frozen=False):
    """Up to `faults` agents that crash or freeze somewhere in their first `most` copies."""
    count = rng.randint(0, faults)
    freeze = [rng.choice([float("inf"), rng.uniform(0.2, 9.0)]) for _ in range(count)]
    return [
        Fault(agent, rng.randrange(most), long if frozen else float("inf"))
        for agent, long in zip(rng.sample(range(agents), count), freeze, strict=True)
    ]


def test_without_faults_all_have_the_contents_of_all():
    team, outcome = play(1, network=QUIET)
    assert not outcome.errors
    [log, *others] = results(team)
    assert [kind for kind, _ in log] == ["round"] * 6
    assert others == [log] * 3


def test_a_crash_at_any_message_is_seen_alike_by_all_others():
    """Of three agents one crashes after any number of copies, in the middle of broadcasts too."""
    _, whole = play(5, agents=3, rounds=3, network=QUIET)
    for message in range(whole.copies // 3):
        team, outcome = play(5, agents=3, rounds=3, network=QUIET, plan=[Fault(0, message)])
        assert not outcome.errors
        [one, other] = results(team[1:])
        assert one == other
        assert lost_in(one) <= {0}


@pytest.mark.parametrize("agents", [4, 5, 7])
def test_survivors_agree_and_lose_only_who_crashed(agents):
    """Losses, duplicates, delays, partitions and crashes within the fault model."""
    faults = (agents - 1) // 2
    for seed in range(SEEDS):
        rng = random.Random(seed)
        plan = some_faults(rng, agents, faults, 12 * agents)
        team, outcome = play(seed, agents=agents, faults=faults, plan=plan)
        assert not outcome.errors, (seed, outcome.errors)
        logs = results(team)
        survivors = [logger for logger in team if logger.number not in outcome.crashed]
        assert all(logger.result is not None for logger in survivors), seed
        assert all(log == logs[0] for log in logs), (
            seed
        )  # also of those that crashed after they had finished
        assert lost_in(logs[0]) <= outcome.crashed, seed


def test_outside_of_the_fault_model_no_two_results_differ():
    """Outages and freezes that last longer than the deadline: agents may give up, but never disagree."""
    network = Network(outage=4.0, partitions=3, loss=0.3)
    ends = gave_up = 0
    for seed in range(SEEDS):
        rng = random.Random(seed)
        agents = rng.choice([3, 5, 6])
        faults = (agents - 1) // 2
        plan = some_faults(rng, agents, faults, 40, frozen=True)
        team, outcome = play(
            seed, agents=agents, faults=faults, network=network, plan=plan, deadline=0.9
        )
        assert all(isinstance(error, TeamError) for error in outcome.errors.values())
        assert not any(isinstance(error, DisagreementError) for error in outcome.errors.values())
        logs = results(team)
        assert all(log == logs[0] for log in logs), seed
        ends, gave_up = ends + len(logs), gave_up + len(outcome.errors)
    assert ends > SEEDS
    assert gave_up > SEEDS / 4


def test_a_frozen_agent_that_thaws_leaves_by_itself():
    team, outcome = play(3, network=QUIET, plan=[Fault(2, 7, frozen=60.0)])
    assert lost_in(results(team)[0]) == {2}
    late = team[0].agreement._header(1, 9, 0, frozenset({2}))
    with pytest.raises(SuspectedError, match="agent 2 was not heard in time"):
        team[2].agreement.receive(late + bytes(SIZE), 60.0)
    assert set(outcome.errors) <= {2}


def pair(faults=1):
    return [
        Agreement(k, 3, team=7, size=SIZE, faults=faults, deadline=1.0, now=0.0) for k in range(3)
    ]


def exchange(agreements, contents):
    """Everybody publishes and hears everybody; returns the events of each."""
    events = [one.publish(content) for one, content in zip(agreements, contents, strict=True)]
    for one in agreements:
        for other in agreements:
            if other is not one:
                for message in one.outbox:
                    events[other.number] += other.receive(message, 0.0)
    for one in agreements:
        one.outbox = []
    return events


def test_a_round_is_complete_when_all_contents_are_there():
    contents = [bytes([k]) * SIZE for k in range(3)]
    for events in exchange(pair(), contents):
        assert events == [RoundComplete(dict(enumerate(contents)))]


def test_another_past_is_an_error():
    """Members whose contents of a round were not the same do not go on together."""
    honest, traitors = pair(), pair()
    exchange(honest, [b"a" * SIZE] * 3)
    exchange(traitors, [b"a" * SIZE, b"b" * SIZE, b"a" * SIZE])
    traitors[1].publish(b"c" * SIZE)
    with pytest.raises(DisagreementError, match="agents 0 and 1 hold different contents"):
        honest[0].receive(traitors[1].outbox[-1], 0.0)


def test_more_silent_agents_than_the_team_is_made_for():
    one = pair(faults=1)[0]
    one.publish(bytes(SIZE))
    with pytest.raises(TooManyLostError, match=r"\[1, 2\] are silent; .* at most 1"):
        one.tick(5.0)


def test_the_only_one_left_goes_on_alone():
    one = pair(faults=2)[0]
    one.publish(bytes(SIZE))
    assert one.tick(5.0) == [MembersLost(frozenset({1, 2}))]
    assert one.members == {0}
    [alone] = one.publish(b"x" * SIZE)
    assert alone == RoundComplete({0: b"x" * SIZE})


def test_foreign_and_broken_messages_are_counted_and_dropped():
    rng = np.random.default_rng(0)
    one, other, _ = pair()
    other.publish(bytes(SIZE))
    [message] = other.outbox
    stranger = Agreement(1, 3, team=8, size=SIZE, faults=1, deadline=1.0, now=0.0)
    stranger.publish(bytes(SIZE))
    garbage = [message[:-1], message + b"\0", b"", b"x" * 60, *stranger.outbox]
    garbage += [rng.bytes(rng.integers(0, 80)) for _ in range(200)]
    for data in garbage:
        assert one.receive(data, 0.0) == []
    assert one.refused == len(garbage)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"agents": 65}, "`agents` must be between 1 and 64; got 65"),
        ({"number": 3}, r"`number` must be one of \[0, 1, 2\]; got 3"),
        ({"number": 1, "absent": [1]}, r"`number` must be one of \[0, 2\]; got 1"),
        ({"faults": 3}, "`faults` must be at least 0 and leave one of 3 agents; got 3"),
        ({"deadline": 0.0}, "`deadline` must be positive, in seconds; got 0.0"),
    ],
)
def test_bad_settings_are_named(change, match):
    settings = {"number": 0, "agents": 3, "team": 0, "size": SIZE, "faults": 1}
    settings |= {"deadline": 1.0, "now": 0.0} | change
    with pytest.raises(ValueError, match=match):
        Agreement(settings.pop("number"), settings.pop("agents"), **settings)


def test_contents_have_one_size_and_are_published_once():
    one = pair()[0]
    with pytest.raises(ValueError, match="`content` must have 8 bytes; got 3"):
        one.publish(b"abc")
    one.publish(bytes(SIZE))
    with pytest.raises(ValueError, match="`content` of round 1 was published before"):
        one.publish(bytes(SIZE))
