"""Compares the statements of a trial's line with its twists and poses and with each other."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow import consistency
from deggflow.consistency import Line, Unverified, Wrong
from deggflow.jsonl import shorten

from .condition import TrialCondition
from .oracle import SAGITTA, least_margin
from .recomputed import PROGRESS, q_safe, q_task, speed_violation, speeds
from .world import EXECUTED

TOLERANCE = (
    1e-6  # of q_task, bound and q_safe, and of speeds in m/s, as poses may be rounded by 1e-8 m
)
SINGLE = 1e-4  # of 1 + |q|, and of speeds in m/s: tolerance for values that a generation computed in float32
DIVERGED = 1e9  # stands for q_task and q_safe of a generation that diverged
UNVERIFIED: Unverified = {
    "condition.goal": "except with --conditions",
    "condition.contacts": "but where a margin, a factor or a speed shows it, or by --conditions",
    "seed": "",
    "certificate.draws": "but that it is the most of a policy",
    "certificate.speed_limit": "but that it was kept",
    "certificate.reason": "the words of a refusal",
    "outcome.reason": "likewise",
    "certificate.policies[].draws": "",
    "certificate.policies[].q_task": "where the policy was refused, or cut short by the bridge",
    "certificate.policies[].q_safe": "likewise",
    "certificate.policies[].speed": "likewise, and where it is left out, as in files of earlier versions",
    "certificate.policies[].generation": "that it is there",
    **consistency.unverified_record("certificate.policies[].generation"),
    "certificate.policies[].generation.requirements[].value": "of a speed limit, as q_safe of the policy",
}
_STOPPED = re.compile(r"(?:blocked at policy|policy) ([0-9]{1,6}): ")
_OVER = re.compile(r"not bridged after ([0-9]{1,6}) policies")


class _Policy(NamedTuple):
    """One policy of a trial, and its executed part."""

    record: Line
    field: str
    poses: Float[np.ndarray, "poses 3"]  # where it began, and after each action
    twists: Float[np.ndarray, "actions 3"]
    contacts: Float[np.ndarray, "robots 2"]
    limit: float | None  # m/s

    @property
    def whole(self) -> bool:
        """Whether all actions that are to be executed were executed."""
        return bool(self.record["accepted"]) and len(self.twists) == EXECUTED

    @property
    def met(self) -> bool:
        return bool(self.record["q_task"] <= self.record["bound"] and self.record["q_safe"] <= 0)

    @property
    def excess(self) -> float:
        """By how much a factor ends above its bound."""
        return max(self.record["q_task"] - self.record["bound"], self.record["q_safe"], 0.0)


def contradictions(line: Line) -> list[Wrong]:
    """All contradictions in a line that `parse_trial` accepts, besides those that `oracle.refutation` finds.

    Args:
        line: A trial as it stands in a file.
    """
    policies = _policies(line)
    return [
        *_claim(line, policies),
        *_numbers(line, policies),
        *_sequence(line, policies),
        *(wrong for policy in policies for wrong in _factors(policy)),
        *(wrong for policy in policies for wrong in _acceptance(policy)),
        *_generations(line, policies),
    ]


def _policies(line: Line) -> list[_Policy]:
    certificate = line["certificate"]
    twists = np.array(line["twists"], np.float64).reshape(-1, 3)
    poses = np.array(line["poses"], np.float64).reshape(-1, 3)
    contacts = np.array(line["condition"]["contacts"], np.float64)
    out, executed = [], 0
    for k, record in enumerate(certificate["policies"]):
        begin = min(EXECUTED * executed, len(twists))
        end = min(begin + EXECUTED, len(twists)) if record["accepted"] else begin
        field, limit = f"certificate.policies[{k}]", certificate.get("speed_limit")
        motion = poses[begin : end + 1], twists[begin:end], contacts, limit
        out.append(_Policy(record, field, *motion))
        executed += bool(record["accepted"])
    return out


def _claim(line: Line, policies: list[_Policy]) -> Iterator[Wrong]:
    """Outcome, satisfied and reason."""
    certificate, failure = line["certificate"], line["outcome"]["reason"]
    executed = [policy for policy in policies if policy.record["accepted"]]
    broken = sum(not policy.met for policy in executed)
    reason = failure
    if failure is None and broken:
        reason = f"{broken} of {len(executed)} executed policies missed a bound"
    if certificate["satisfied"] != (reason is None):
        text = (
            f"is true, but {reason}"
            if reason
            else "is false, but the trial bridges the gap and met every bound"
        )
        yield Wrong("certificate.satisfied", shorten(text, 300))
    yield from consistency.check_claim(certificate, "certificate")
    if reason and certificate["reason"] and certificate["reason"] != reason:
        text = f"is not what the outcome and the policies say: {reason}"
        yield Wrong("certificate.reason", shorten(text, 300))


def _numbers(line: Line, policies: list[_Policy]) -> Iterator[Wrong]:
    """Least margin, violation and draws."""
    certificate = line["certificate"]
    least, spread = least_margin(line)
    if not abs(certificate["min_margin"] - least) <= max(SAGITTA, spread):
        yield Wrong("certificate.min_margin", f"is not the least margin, {least:.4f} m")
    worst = max((each.excess for each in policies if each.record["accepted"]), default=0.0)
    if not abs(certificate["violation"] - worst) <= TOLERANCE:
        text = f"is not the largest excess of an executed policy, {worst:.6g}"
        yield Wrong("certificate.violation", text)
    draws = max((each.record["draws"] for each in policies), default=1)
    if certificate["draws"] != draws:
        yield Wrong("certificate.draws", f"is not the most of a policy, {draws}")


def _sequence(line: Line, policies: list[_Policy]) -> Iterator[Wrong]:
    """How many policies there are, and which was refused."""
    accepted = [bool(policy.record["accepted"]) for policy in policies]
    required = -(-len(line["twists"]) // EXECUTED)
    if sum(accepted) != required:
        text = f"has {sum(accepted)} accepted policies; {len(line['twists'])} actions are of {required}"
        yield Wrong("certificate.policies", text)
    for policy in policies[:-1]:
        if not policy.record["accepted"]:
            yield Wrong(f"{policy.field}.accepted", "is false, but the trial went on")
    reason = line["outcome"]["reason"] or ""
    stopped, over = _STOPPED.match(reason), _OVER.fullmatch(reason)
    last_refused = bool(accepted) and not accepted[-1]
    if last_refused != bool(stopped):
        what = "was refused" if last_refused else "was executed"
        yield Wrong("outcome.reason", f"and the last policy contradict, which {what}")
    for count in (stopped, over):
        if count and int(count[1]) != len(policies):
            yield Wrong("outcome.reason", f"counts another number of policies than {len(policies)}")


def _factors(policy: _Policy) -> Iterator[Wrong]:
    """q_task, its bound, q_safe and the speed of the executed actions, recomputed from the plank's poses."""
    record, field = policy.record, policy.field
    bound = float(q_task(policy.poses[:1])[0]) - PROGRESS
    if not _close(record["bound"], bound):
        yield Wrong(f"{field}.bound", f"is not q_task before less {PROGRESS}, {bound:.6f}")
    if not len(policy.twists):
        return
    task, safe = float(q_task(policy.poses[-1:])[0]), q_safe(policy.poses[1:], policy.contacts)
    fastest = float(speeds(policy.twists, policy.contacts).max())
    if policy.whole and not _close(record["q_task"], task):
        yield Wrong(f"{field}.q_task", f"is not that of the pose that was reached, {task:.6f}")
    for name, recomputed in (("q_safe", safe), ("speed", fastest)):
        stated = record.get(name, recomputed)  # files of earlier versions have no `speed`
        if not _close(stated, recomputed) and (policy.whole or stated < recomputed):
            least = "" if policy.whole else "at least "
            yield Wrong(
                f"{field}.{name}", f"is not that of the executed actions, {least}{recomputed:.6f}"
            )


def _close(stated: float, recomputed: float) -> bool:
    return abs(stated - recomputed) <= TOLERANCE * (1 + abs(recomputed))


def _acceptance(policy: _Policy) -> Iterator[Wrong]:
    """A guided policy is executed only within its bounds, and within its speed limit."""
    record = policy.record
    if not record["accepted"] or record.get("generation") is None:
        return
    if not policy.met:
        yield Wrong(f"{policy.field}.accepted", "is true, but the policy misses a bound")
    if policy.limit is not None and record.get("speed", 0.0) > policy.limit:
        yield Wrong(f"{policy.field}.speed", f"is above the limit, {policy.limit:g} m/s")


def _generations(line: Line, policies: list[_Policy]) -> Iterator[Wrong]:
    limit = line["certificate"].get("speed_limit")
    names = ["q_task", "q_safe", *(["speed"] if limit is not None else [])]
    robots = [f"robot {k + 1}" for k in range(len(line["condition"]["contacts"]))]
    guided = any(policy.record.get("generation") is not None for policy in policies)
    for policy in policies:
        generation, field = policy.record.get("generation"), f"{policy.field}.generation"
        if generation is not None:
            yield from consistency.check_generation(generation, field, names, robots)
            yield from _values(generation, field, policy)
        elif guided:
            yield Wrong(field, "is missing, though other policies of the trial were guided")
    if limit is not None and policies and not guided:
        yield Wrong("certificate.speed_limit", "is of a trial that no requirement guided")


def _values(generation: Line, field: str, policy: _Policy) -> Iterator[Wrong]:
    """The values at z(1), in float32, against those of the policy."""
    record = policy.record
    ends = {
        "q_task": (record["q_task"], record["bound"]),
        "q_safe": (record["q_safe"], 0.0),
    }
    for k, row in enumerate(generation["requirements"]):
        place = f"{field}.requirements[{k}]"
        for name, stated in zip(("value", "limit"), ends.get(row["name"], ()), strict=False):
            comparable = name == "limit" or record["q_task"] < DIVERGED
            if comparable and not abs(row[name] - stated) <= SINGLE * (1 + abs(stated)):
                yield Wrong(f"{place}.{name}", f"is not that of the policy, {stated:.6f}")
        if row["name"] == "speed" and policy.limit:
            exact = speed_violation(policy.twists, policy.contacts, policy.limit)
            less = _length(exact) - _length(row["value"])
            if less > SINGLE or (policy.whole and less < -SINGLE) or row["value"] < 0:
                yield Wrong(f"{place}.value", f"is not V of the executed actions, {exact:.6g}")


def _length(violation: int | float) -> float:
    """The norm in m/s of all shortfalls from the buffers; V is half its square."""
    return float(np.sqrt(2 * max(violation, 0.0)))


def plain(condition: TrialCondition) -> Line:
    """The condition as JSON values."""
    names = ("x", "y", "theta")
    return {
        "plank": dict(zip(names, condition.plank, strict=True)),
        "goal": dict(zip(names, condition.goal, strict=True)),
        "contacts": [list(r) for r in condition.contacts],
    }
