"""Receding horizon: a policy is generated, its first actions are executed, and again (paper, Task 1).

A guided policy is executed only if both factors are below their bounds at its end and exact geometry finds
nothing broken on the way; else it is drawn again, and where no draw serves, the team stops where it stands.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from deggflow.divergence import has_diverged
from deggflow.drift import AbstractDrift
from deggflow.guidance import AbstractGuidance, NoGuidance
from deggflow.redraw import Candidate, redraw_until_satisfied

from .codec import continuation
from .condition import BridgeCondition, TrialCondition, padded_robots, take
from .field import BridgeField
from .policies import STEPS, Policies, PolicyGenerator, initial_noise
from .rollout import Rollout
from .trial import MAX_SPEED, PolicyRecord, Trial, TrialCertificate
from .verdict import Verdict, execute, margins
from .world import EXECUTED, HORIZON

MAX_DRAWS = 8
COARSE_DRAWS = 4  # that a policy has before it is drawn with finer steps
FINER = 4  # times as many steps: what opposes each other beside a wall may ask for them
MAX_POLICIES = 60  # of a trial: 48 s
_DIVERGED = 1e9  # q of a policy whose generation diverged; files hold finite numbers


class Round(NamedTuple):
    """The next policy of every trial under way, about to be generated."""

    policy: int  # its number in the trial, from 0
    trials: tuple[int, ...]  # their numbers in the run
    condition: BridgeCondition  # of these trials; numpy arrays in float64


class Progress(NamedTuple):
    """What one policy has done to a trial."""

    trial: int  # its number in the run
    poses: Float[np.ndarray, "poses 3"]  # of the plank, from the initial one
    record: PolicyRecord  # of the policy, accepted or refused


class Replay(NamedTuple):
    """A trial, and what each of its policies was conditioned on."""

    trial: Trial
    conditions: list[BridgeCondition]  # of one trial each; numpy arrays in float64


class Start(NamedTuple):
    """A state from which one policy is wanted."""

    condition: TrialCondition  # the plank's present pose, goal and contact points
    twist: Float[np.ndarray, " 3"]  # present body twist
    previous: Float[np.ndarray, "horizon 3"]  # body twists of the policy that led there


class Single(NamedTuple):
    """One policy from a start."""

    condition: TrialCondition
    twists: Float[np.ndarray, "actions 3"]  # executed; none where no draw was accepted
    record: PolicyRecord
    first_met: bool  # the first draw ends with both factors below their bounds
    reason: str | None  # why no draw was accepted


class _Refusal(NamedTuple):
    """A policy that is not executed."""

    record: PolicyRecord
    reason: str


def _nobody(_: Round) -> None:
    """Watches no round."""


def _unseen(_: Progress) -> None:
    """Watches no progress."""


class PolicyRollout:
    """A rollout under policies: what is left of the previous one, and the record of each."""

    def __init__(self, start: Start, number: int) -> None:
        self.rollout, self.number = Rollout(start.condition, start.twist), number
        self.previous = start.previous
        self.first_met: bool | None = None
        self.records: list[PolicyRecord] = []

    @property
    def condition(self) -> TrialCondition:
        """Of the trial."""
        return self.rollout.condition

    def carry_out(
        self, plan: Float[np.ndarray, "horizon 3"], verdict: Verdict, record: PolicyRecord
    ) -> None:
        """Executes a policy that was accepted."""
        self.records.append(record)
        self.rollout.carry_out(plan, verdict)
        self.previous = plan

    def stop(self, record: PolicyRecord, reason: str) -> None:
        """Ends the trial where it stands, as no draw was accepted."""
        self.records.append(record)
        self.rollout.stop(reason)

    def progress(self) -> Progress:
        """Its poses so far and the record of its last policy."""
        return Progress(self.number, np.array(self.rollout.poses), self.records[-1])

    def finish(self, seed: int, speed_limit: float | None) -> Trial:
        """The trial with its certificate."""
        twists, bridged = self.rollout.executed(), self.rollout.bridged
        verdict = execute(self.rollout.poses[0], twists, self.condition.contacts)
        failure = self.rollout.failure
        if failure is None and not bridged:
            failure = f"not bridged after {MAX_POLICIES} policies"
        accepted = [record for record in self.records if record.accepted]
        broken = sum(not record.met for record in accepted)
        reason = failure
        if reason is None and broken:
            reason = f"{broken} of {len(accepted)} executed policies missed a bound"
        certificate = TrialCertificate(
            satisfied=reason is None,
            min_margin=verdict.margin,
            violation=max((record.excess for record in accepted), default=0.0),
            draws=max((record.draws for record in self.records), default=1),
            reason=reason,
            policies=tuple(self.records),
            speed_limit=speed_limit,
        )
        return Trial(
            self.condition, twists, verdict.poses, bridged and failure is None, failure,
            certificate, seed,
        )  # fmt: skip


def stacked(runs: Sequence[PolicyRollout], agents: int) -> BridgeCondition:
    """What the next policies are conditioned on; numpy arrays in float64."""
    contacts, mask = np.zeros((len(runs), agents, 2)), np.zeros((len(runs), agents), bool)
    for k, run in enumerate(runs):
        contacts[k, : len(run.condition.contacts)] = run.condition.contacts
        mask[k, : len(run.condition.contacts)] = True
    motion = np.array([run.rollout.twist for run in runs])
    before = np.array([run.previous for run in runs])
    ahead = continuation(jnp.asarray(before, jnp.float32), jnp.asarray(motion, jnp.float32))
    leaves: Any = (
        np.array([run.rollout.pose for run in runs]),
        motion,
        np.array([run.condition.goal for run in runs]),
        contacts,
        mask,
        np.asarray(ahead, np.float64),
    )
    return BridgeCondition(*leaves)  # not yet on a device, where float64 would be cut


class BridgeGenerator:
    """Runs trials in receding horizon, all trials of a batch at once."""

    def __init__(
        self,
        field: BridgeField,
        guidance: AbstractGuidance | None = None,
        *,
        drift: AbstractDrift | None = None,
        steps: int = STEPS,
        speed_limit: float | None = None,
    ) -> None:
        """One field, one guidance.

        Args:
            field: Nominal field.
            guidance: `NoGuidance()` if None.
            drift: How often the field is evaluated, as of `generate`; 12 times if None.
            steps: Equal ones, of the guidance.
            speed_limit: Of contact points (m/s); guided policies that exceed it are refused. Guidance that
                leads there has it, too.
        """
        policies = partial(PolicyGenerator, field, guidance, drift=drift)
        self.policies, self.finer = policies(steps=steps), policies(steps=FINER * steps)
        self.guided = not isinstance(self.policies.guidance, NoGuidance)
        self.speed_limit = speed_limit if self.guided else None

    def of_draw(self, number: int) -> PolicyGenerator:
        """What makes a policy's draw of this number, from 1: a policy that is refused again and again gets finer steps."""
        return self.policies if number <= COARSE_DRAWS else self.finer

    def draw(
        self, number: int, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> Policies:
        """A policy's draw of this number, from 1, of some trials from given z(0)."""
        return self.of_draw(number).batch(noise, condition)

    def trials(
        self,
        conditions: Sequence[TrialCondition],
        *,
        seed: int = 0,
        first: int = 0,
        max_draws: int = MAX_DRAWS,
        on_round: Callable[[Round], None] = _nobody,
    ) -> list[Trial]:
        """Trials with certificates; arguments as of `stream`."""
        return [
            trial
            for some in self.stream(
                conditions, seed=seed, first=first, max_draws=max_draws, on_round=on_round
            )
            for trial in some
        ]

    def stream(
        self,
        conditions: Sequence[TrialCondition],
        *,
        seed: int = 0,
        first: int = 0,
        max_draws: int = MAX_DRAWS,
        on_round: Callable[[Round], None] = _nobody,
        on_policy: Callable[[Progress], None] = _unseen,
    ) -> Iterator[list[Trial]]:
        """Trials with certificates, in order, as soon as they and those before them are over.

        Args:
            conditions: Where plank, goal and contact points are.
            seed: With a trial's, a policy's and a draw's number, decides z(0).
            first: Number of the first condition in the run.
            max_draws: Limit for each policy; without guidance every policy is executed as it is drawn.
            on_round: Told before each policy what it is conditioned on.
            on_policy: Told of each trial after each of its policies.
        """
        if max_draws < 1:
            raise ValueError(f"`max_draws` must be at least 1; got {max_draws}.")
        rest = np.zeros(3), np.zeros((HORIZON, 3))
        runs = [PolicyRollout(Start(each, *rest), first + k) for k, each in enumerate(conditions)]
        agents = padded_robots(max((len(c.contacts) for c in conditions), default=0))
        count = 0
        for policy in range(MAX_POLICIES):
            under_way = [run for run in runs if not run.rollout.over]
            if not under_way:
                break
            condition = stacked(under_way, agents)
            on_round(Round(policy, tuple(run.number for run in under_way), condition))
            self.advance(under_way, condition, seed, policy, max_draws)
            for run in under_way:
                on_policy(run.progress())
            over = list(takewhile(lambda run: run.rollout.over, runs[count:]))
            count += len(over)
            if over:
                yield [run.finish(seed, self.speed_limit) for run in over]
        if runs[count:]:
            yield [run.finish(seed, self.speed_limit) for run in runs[count:]]

    def single(
        self, starts: Sequence[Start], *, seed: int = 0, max_draws: int = MAX_DRAWS
    ) -> list[Single]:
        """One policy from each start, of at least one robot; arguments as in `trials`."""
        runs = [PolicyRollout(start, number) for number, start in enumerate(starts)]
        agents = padded_robots(max(len(start.condition.contacts) for start in starts))
        self.advance(runs, stacked(runs, agents), seed, 0, max_draws)
        return [
            Single(
                run.condition,
                run.rollout.executed(),
                run.records[0],
                bool(run.first_met),
                run.rollout.failure,
            )
            for run in runs
        ]

    def replay(
        self, condition: TrialCondition, *, seed: int, number: int, max_draws: int = MAX_DRAWS
    ) -> Replay:
        """One trial of a run again, with what its policies were conditioned on; arguments as in `trials`."""
        rounds: list[Round] = []
        (trial,) = self.trials(
            [condition], seed=seed, first=number, max_draws=max_draws, on_round=rounds.append
        )
        return Replay(trial, [take(each.condition, 0) for each in rounds])

    def advance(
        self,
        runs: list[PolicyRollout],
        condition: BridgeCondition,
        seed: int,
        policy: int,
        max_draws: int,
    ) -> None:
        """Carries out the next policy of each run, or stops it where no draw is accepted."""

        def attempt(pending: Sequence[int], number: int) -> list[Candidate[_Refusal | None]]:
            numbers = np.array([runs[k].number for k in pending])
            noise = initial_noise(seed, numbers, policy, number)
            policies = self.draw(number + 1, noise, take(condition, np.array(pending)))
            refusals = [
                self._try(runs[k], policies, row, number + 1, policy)
                for row, k in enumerate(pending)
            ]
            return [
                Candidate(each, each is None, 0.0 if each is None else -each.record.excess)
                for each in refusals
            ]

        limit = max_draws if self.guided else 1
        for run, candidate in zip(
            runs, redraw_until_satisfied(attempt, len(runs), limit), strict=True
        ):
            if candidate.sample is not None:
                run.stop(
                    replace(candidate.sample.record, draws=candidate.draws), candidate.sample.reason
                )

    def _try(
        self, run: PolicyRollout, policies: Policies, row: int, draws: int, policy: int
    ) -> _Refusal | None:
        """Executes a policy, or returns why it is refused."""
        plan = policies.twists[row]
        made = policies.record(row, len(run.condition.contacts))
        if has_diverged(plan, MAX_SPEED):
            bound = float(policies.bound[row])
            record = PolicyRecord(_DIVERGED, bound, _DIVERGED, draws, False, generation=made)
            run.first_met = bool(run.first_met)
            return _Refusal(record, f"policy {policy + 1}: the generation diverged")
        record = PolicyRecord(
            float(policies.q_task[row]),
            float(policies.bound[row]),
            float(policies.q_safe[row]),
            draws,
            True,
            float(policies.speed[row].max()),
            made,
        )
        run.first_met = record.met if run.first_met is None else run.first_met
        verdict = execute(run.rollout.pose, plan[:EXECUTED], run.condition.contacts)
        too_fast = self.speed_limit is not None and record.speed > self.speed_limit
        if self.guided and (not record.met or verdict.reason is not None or too_fast):
            reason = _refusal(run, policies, row, verdict, policy, self.speed_limit)
            return _Refusal(replace(record, accepted=False), reason)
        run.carry_out(plan, verdict, record)
        return None


def _refusal(
    run: PolicyRollout,
    policies: Policies,
    row: int,
    verdict: Verdict,
    policy: int,
    speed_limit: float | None,
) -> str:
    """Which factor is missed, which robots could not meet their rows, and what stands in the way."""
    reasons = []
    if policies.q_task[row] > policies.bound[row]:
        reasons.append(
            f"q_task misses its bound by {policies.q_task[row] - policies.bound[row]:.3g}"
        )
    if policies.q_safe[row] > 0:
        reasons.append(f"q_safe misses its bound by {policies.q_safe[row]:.3g}")
    if verdict.reason is not None:
        reasons.append(f"on the way {verdict.reason}")
    speed = policies.speed[row]
    if speed_limit is not None and speed.max() > speed_limit:
        fastest = int(speed.argmax())
        reasons.append(f"robot {fastest + 1} would move at {speed[fastest]:.3f} m/s")
    robots = ", ".join(str(k + 1) for k in np.flatnonzero(policies.infeasible(row)))
    text = f"blocked at policy {policy + 1}: {' and '.join(reasons)}"
    input_norm = policies.summary.largest_input_norm[row][: len(run.condition.contacts)]
    if robots:
        text += f"; no input of robot {robots} met its rows"
    else:
        hardest = int(np.argmax(input_norm))
        text += f"; its rows oppose each other most at robot {hardest + 1} (|u| = {input_norm[hardest]:.3g})"
    place = margins(verdict.poses[-1:], run.condition.contacts)
    return f"{text}; closest there: {place.nearest(0)}"
