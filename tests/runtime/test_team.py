"""Agents that hear one another's messages generate what the batched program generates."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    AfterPrediction,
    DecoupledGuidance,
    EveryStep,
    Extrapolated,
    ExtrapolatedEndpoint,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    certify,
    distances,
    generate,
    refined_grid,
)
from deggflow.guidance import Recovering
from deggflow.runtime import Agent, TeamProgram
from deggflow.runtime.messages import RECORD_ONLY, AgentMessage, Layout

AGENTS = 4
GRID = refined_grid(12)
APART = PrivateRequirement(lambda z, condition: distances(z) - 0.5, 0.05, name="apart")
CENTRE = SharedRequirements(
    (
        SharedFactor(
            lambda tau, z, condition: jnp.sum(jnp.mean(z, axis=0) ** 2) - 0.25,
            alpha=Recovering(), buffer=0.02, name="centre",
        ),
    )
)  # fmt: skip
BOTH = DecoupledGuidance((APART, CENTRE))


def field(tau, z, condition):
    return 2.0 * (0.3 * jnp.roll(z, 1, axis=0) - z) + condition * jnp.sin(3 * z)


def control(tau, z, condition):
    turn = jnp.array([[1.0, -0.5], [0.5, 1.0]], z.dtype)
    return turn[None] * (1 + 0.1 * jnp.tanh(z[:, :1, None]))


def a_start(seed, dtype=np.float32):
    return np.random.default_rng(seed).normal(size=(AGENTS, 2)).astype(dtype)


def in_lockstep(agents, tamper=lambda number, data: data, lose=()):
    """Every agent's messages to all, round by round, until all have the sample; returns the number of rounds.

    Args:
        agents: By number.
        tamper: Changes an agent's message on its way to all.
        lose: (round, number): who falls silent before which round.
    """
    here = dict(enumerate(agents))
    messages = {k: agent.first_message() for k, agent in here.items()}
    lose = dict(lose)
    for number in range(1, 1000):
        if number in lose:
            del here[lose[number]]
            leavers = frozenset({lose[number]})
            messages = {k: agent.message_without(leavers) for k, agent in here.items()}
        contents = {k: tamper(k, data) for k, data in messages.items()}
        messages = {k: agent.next_message(contents) for k, agent in here.items()}
        if all(agent.generated is not None for agent in here.values()):
            return number
    raise AssertionError("the team did not finish")


def team(program, z0, condition, mask=None):
    start = program.start(z0, condition, mask)
    present = range(AGENTS) if mask is None else np.flatnonzero(mask)
    return [Agent(program, int(k), start) for k in present]


def assert_same(one, other):
    assert jax.tree.all(
        jax.tree.map(lambda a, b: np.asarray(a).tobytes() == np.asarray(b).tobytes(), one, other)
    )


CASES = {
    "private": (DecoupledGuidance((APART,)), EveryStep()),
    "shared and private": (BOTH, EveryStep()),
    "few evaluations": (BOTH, Extrapolated(4)),
    "endpoint": (BOTH, ExtrapolatedEndpoint(4)),
    "after a prediction": (BOTH, AfterPrediction(ExtrapolatedEndpoint(4))),
    "control map": (DecoupledGuidance((APART, CENTRE), control=control), EveryStep()),
}


@pytest.mark.parametrize("case", CASES)
def test_a_team_generates_what_the_batched_program_does(case):
    """In float64, where programs that are compiled apart differ by 1e-13 or so; all of a certificate's numbers, too."""
    guidance, drift = CASES[case]
    with jax.enable_x64(True):
        z0, condition = a_start(3, np.float64), jnp.asarray(0.3)
        settings = {"grid": np.asarray(GRID, np.float64), "drift": drift}
        settings["grid"][-1] = 1.0
        program = TeamProgram(field, guidance, **settings, keep_trace=True, keep_path=True)
        agents = team(program, z0, condition)
        in_lockstep(agents)
        whole = generate(field, guidance, z0, condition, **settings, keep_path=True)
        result = agents[0].generated
        for agent in agents[1:]:
            assert_same(agent.generated, result)
        ours, theirs = jax.tree.leaves(result.generation), jax.tree.leaves(whole)
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-9)
        certificate = result.certify(guidance, condition)
        same = certify(whole, guidance, condition)
    assert certificate.satisfied
    assert same.satisfied
    assert type(certificate) is type(same)
    assert certificate.generation.hypotheses_hold == same.generation.hypotheses_hold
    assert certificate.to_json().keys() == same.to_json().keys()


def test_in_float32_samples_differ_by_rounding():
    program = TeamProgram(field, BOTH, grid=GRID)
    agents = team(program, a_start(3), jnp.asarray(0.3))
    in_lockstep(agents)
    whole = generate(field, BOTH, a_start(3), jnp.asarray(0.3), grid=GRID)
    np.testing.assert_allclose(agents[2].generated.generation.z, whole.z, atol=1e-4)


PROGRAM = TeamProgram(field, BOTH, grid=GRID)
PREDICTED = TeamProgram(field, BOTH, grid=GRID, drift=AfterPrediction(ExtrapolatedEndpoint(4)))
CONDITION = jnp.asarray(0.3)


def test_absent_agents_say_nothing():
    mask = np.array([True, True, False, True])
    apart = PrivateRequirement(
        lambda z, condition: distances(z, condition) - 0.5, 0.05, name="apart"
    )
    guidance = DecoupledGuidance((apart,))

    def present_only(tau, z, condition):
        return jnp.where(condition[:, None], -z, 0.0)

    z0, condition = a_start(5), jnp.asarray(mask)
    agents = team(TeamProgram(present_only, guidance, grid=GRID), z0, condition, mask)
    messages = {agent.number: agent for agent in agents}
    assert set(messages) == {0, 1, 3}
    contents = {k: agent.first_message() for k, agent in messages.items()}
    while agents[0].generated is None:
        contents = {k: agent.next_message(contents) for k, agent in messages.items()}
    whole = generate(present_only, guidance, z0, condition, grid=GRID, mask=mask)
    result = agents[0].generated
    np.testing.assert_allclose(result.generation.z, whole.z, atol=1e-4)
    assert result.certify(guidance, condition, mask=mask).satisfied


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_lost_agents_stop_where_all_know_them(seed):
    """As in the batched program with `stops` at the last point that all had accepted.

    In float64: with seed 0, differences of rounding grow a billionfold on the way.
    """
    with jax.enable_x64(True):
        grid = np.append(np.asarray(GRID, np.float64)[:-1], 1.0)
        program = TeamProgram(field, BOTH, grid=grid)
        z0, condition = a_start(seed, np.float64), jnp.asarray(0.3)
        agents = team(program, z0, condition)
        in_lockstep(agents, lose=[(4, 1), (9 + seed, 3)])
        result = agents[0].generated
        assert_same(agents[2].generated, result)
        assert np.isfinite(result.stops).tolist() == [False, True, False, True]
        whole = generate(field, BOTH, z0, condition, grid=grid, stops=result.stops)
        np.testing.assert_allclose(result.generation.z, whole.z, atol=1e-6)
        assert result.generation.work == jax.tree.map(np.asarray, whole.work)
        certificate = result.certify(BOTH, condition, agents=["a", "b", "c", "d"])
    losses = [(each.agent, each.tau) for each in certificate.generation.lost]
    assert losses == [("b", result.stops[1]), ("d", result.stops[3])]
    assert "lost: b at tau = " in certificate.table()
    assert [each["agent"] for each in certificate.to_json()["generation"]["lost"]] == ["b", "d"]


@pytest.mark.parametrize("program", ["PROGRAM", "PREDICTED"])
def test_agents_that_were_lost_before_stay_where_they_begin(program):
    """In a prediction, too."""
    program = {"PROGRAM": PROGRAM, "PREDICTED": PREDICTED}[program]
    start = program.start(a_start(1), CONDITION, lost=[2])
    agents = [Agent(program, k, start) for k in start.present]
    assert [agent.number for agent in agents] == [0, 1, 3]
    contents = {agent.number: agent.first_message() for agent in agents}
    while agents[0].generated is None:
        contents = {agent.number: agent.next_message(contents) for agent in agents}
    result, stops = agents[0].generated, np.array([np.inf, np.inf, -1, np.inf], np.float32)
    whole = generate(
        field, BOTH, a_start(1), CONDITION, grid=GRID, drift=program.drift, stops=stops
    )
    np.testing.assert_allclose(result.generation.z, whole.z, atol=1e-4)
    np.testing.assert_array_equal(result.generation.z[2], a_start(1)[2])
    assert [each.tau for each in result.certify(BOTH, CONDITION).generation.lost] == [0.0]


def test_who_is_lost_after_the_end_took_part_to_the_end():
    agents = team(PROGRAM, a_start(1), CONDITION)
    rounds = in_lockstep(team(PROGRAM, a_start(1), CONDITION))
    in_lockstep(agents, lose=[(rounds, 2)])
    assert not np.isfinite(agents[0].generated.stops).any()


def test_nothing_else_crosses():
    """What agents say beside states, values and limits changes no state and no decision."""
    plain, told_nonsense = (team(PROGRAM, a_start(2), CONDITION) for _ in range(2))
    layout = plain[0].layout
    rng = np.random.default_rng(0)

    def nonsense(number, data):
        message = layout.decode(data)._asdict()
        for name in RECORD_ONLY:
            other = rng.normal(size=message[name].shape) * 1e3
            message[name] = np.asarray(other if message[name].dtype != bool else other > 0)
        return layout.encode(AgentMessage(**message))

    assert in_lockstep(plain) == in_lockstep(told_nonsense, nonsense)
    for one, other in zip(plain, told_nonsense, strict=True):
        assert_same(one.generated.generation.z, other.generated.generation.z)
        assert one.generated.generation.work == other.generated.generation.work


def test_an_agent_needs_nobody_elses_drift():
    """Each agent has a field of its own, which is poison wherever another agent's drift would be."""
    start = PROGRAM.start(a_start(2), CONDITION)

    def own(number):
        def own_field(tau, z, condition):
            mine = jnp.arange(AGENTS)[:, None] == number
            return jnp.where(mine, field(tau, z, condition), jnp.nan)

        return Agent(TeamProgram(own_field, BOTH, grid=GRID), number, start)

    plain, loners = team(PROGRAM, a_start(2), CONDITION), [own(k) for k in range(AGENTS)]
    assert in_lockstep(plain) == in_lockstep(loners)
    for one, other in zip(plain, loners, strict=True):
        np.testing.assert_allclose(
            one.generated.generation.z, other.generated.generation.z, atol=1e-5
        )
        assert not other.generated.generation.summary.not_a_number


class Strict:
    """The program of an agent that finds a point above its limit, which for the others is below."""

    def __init__(self):
        self.settle, self.generation, self.drift = PROGRAM.settle, PROGRAM.generation, PROGRAM.drift
        self.refused = []

    def assess(self, start, number, at, drift, stops):
        own = PROGRAM.assess(start, number, at, drift, stops)
        if not 0.2 < float(at.proposed_tau) < 0.4:
            return own
        self.refused.append(float(at.proposed_tau))
        limit = jnp.full_like(own.report.limit, -1.0)
        return own._replace(report=own.report._replace(limit=limit))


def test_one_agent_that_finds_a_value_above_its_limit_makes_all_refuse():
    """All had proposed the next point; they propose again, half way."""
    strict, plain = (team(PROGRAM, a_start(4), CONDITION) for _ in range(2))
    strict[1]._program = Strict()
    rounds, of_plain = in_lockstep(strict), in_lockstep(plain)
    for agent in strict[1:]:
        assert_same(agent.generated, strict[0].generated)
    work = strict[0].generated.generation.work
    repeats = rounds - work.evaluations
    assert repeats > of_plain - plain[0].generated.generation.work.evaluations
    assert len(strict[1]._program.refused) > 0


def test_bytes_of_a_message_are_those_of_its_layout():
    agent = team(PROGRAM, a_start(0), CONDITION)[0]
    assert len(agent.first_message()) == Layout(dim=2, rows=2, dtype="float32").size == 64


def test_who_is_not_of_the_team_is_named():
    start = PROGRAM.start(a_start(0), CONDITION)
    with pytest.raises(ValueError, match=r"`number` must be one of \[0, 1, 2, 3\]; got 4"):
        Agent(PROGRAM, 4, start)
