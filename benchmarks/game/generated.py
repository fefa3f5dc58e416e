"""Kinds of problems that the library generates and certifies in batches, one by one, or with `sample`."""

from dataclasses import dataclass, replace

import jax
import numpy as np

from deggflow import certify, certify_batch, generate, sample

from .draw import draw
from .spec import (
    OBSTACLES,
    OF_WAYPOINTS,
    Factor,
    Private,
    Problem,
    Shared,
    random_private,
    random_shared,
    random_steps,
)
from .tally import judge_hypotheses, judge_verdicts
from .truth import exact, steepest_row, take
from .wired import field, guidance_of, precision, program_of, steps_of, still

ROWS = 32  # samples of a case whose hypotheses are said to hold and whose rows are worked out again


@dataclass(frozen=True)
class Case:
    """One batch of one kind: all that it draws follows from these numbers."""

    seed: int
    kind: str
    number: int
    batch: int

    def rng(self, *more):
        """Its own random numbers."""
        return np.random.default_rng([self.seed, *self.kind.encode(), self.number, *more])

    def __str__(self):
        return f"--seed {self.seed} --batch {self.batch} --only {self.kind} --case {self.number}"


def problem_rng(kind, structure):
    """For what is compiled: the same for all seeds, so that few programs are."""
    return np.random.default_rng([77, *kind.encode(), structure])


def private(kind, structure):
    """Obstacles in the plane."""
    rng = problem_rng(kind, structure)
    agents = int(rng.integers(2, 7))
    one = random_private(rng, OBSTACLES)
    return random_steps(rng, Problem((one,), agents=agents, fine=structure % 4 == 3))


def waypoints(kind, structure):
    """Agents whose state is a trajectory of a few points in the plane."""
    rng = problem_rng(kind, structure)
    one = random_private(rng, (*OF_WAYPOINTS, "discs", "boxes", "apart"))
    one = replace(one, pieces=tuple({*one.pieces, str(rng.choice(OF_WAYPOINTS))}))
    return random_steps(rng, Problem((one,), agents=3, waypoints=int(rng.integers(3, 6))))


def walls(kind, structure):
    """Thin walls, which a step may jump over."""
    rng = problem_rng(kind, structure)
    one = replace(random_private(rng, ("wall",)), pieces=("wall", "apart")[: 1 + structure % 2])
    return random_steps(rng, Problem((one,), agents=4))


def hinges(kind, structure):
    """Thousands of hinge terms for each agent."""
    rng = problem_rng(kind, structure)
    one = replace(random_private(rng, ("dots",)), pieces=("dots",), allocation="pooled")
    return replace(random_steps(rng, Problem((one,), agents=3)), grid="short", solver="euler")


def shared(kind, structure):
    """Factors of the team."""
    rng = problem_rng(kind, structure)
    agents = int(rng.integers(2, 7))
    parts = (random_shared(rng),)
    return random_steps(rng, Problem(parts, agents=agents, fine=structure % 4 == 3))


def both(kind, structure):
    """Shared and private requirements together, twice of one sort sometimes."""
    rng = problem_rng(kind, structure)
    parts = [random_shared(rng, 2), random_private(rng, OBSTACLES, 2)]
    if structure % 3 == 2:
        parts.append(random_private(rng, ("discs", "planes"), 1))
    return random_steps(rng, Problem(tuple(parts), agents=int(rng.integers(2, 6))))


def limits(kind, structure):
    """Control maps, metrics, boxes and norms: often infeasible."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 2), random_shared(rng, 1))
    problem = Problem(parts[: 1 + structure % 2], agents=4)
    given = (
        {"control": "turned", "box": 2.0},
        {"metric": "one", "norm": 3.0},
        {"control": "weak", "metric": "each"},
        {"box": 0.3},
        {"metric": "each", "box": 5.0, "norm": 5.0},
        {"norm": 0.5},
    )
    return random_steps(rng, replace(problem, **given[structure % len(given)]))


def padded(kind, structure):
    """Teams with absent agents, and agents that stop."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 2), random_shared(rng, 1))
    parts = parts if structure % 3 == 0 else parts[structure % 2 : structure % 2 + 1]
    problem = Problem(parts, agents=5, padded=structure % 4 != 3, stops=structure % 2 == 1)
    return random_steps(rng, problem)


def double(kind, structure):
    """Under x64: float64 states, or float32 ones."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 2), random_shared(rng, 2))
    parts = (parts[:1], parts[1:], parts)[structure % 3]
    dtype = "float32" if structure % 3 == 1 else "float64"
    return random_steps(rng, Problem(parts, agents=4, x64=True, dtype=dtype))


def nominal(kind, structure):
    """No guidance: certificates have a verdict and no record."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 3), random_shared(rng, 2))[: 1 + structure % 2]
    return replace(random_steps(rng, Problem(parts, agents=4)), nominal=True, grid="short")


def boundary(kind, structure):
    """Samples that end on the boundary of what is allowed, up to the last digits."""
    dtype = ("float32", "float64")[structure % 2]
    parts = (Private(("apart", "discs", "planes", "boxes", "room"), buffer=0.0),)
    return Problem(
        parts, agents=3, dtype=dtype, x64=dtype == "float64", nominal=True, grid="coarse"
    )


def epsilon(problem):
    """Precision of a problem's states."""
    return float(np.finfo(problem.dtype).eps)


def play_batch(case, problem, tally):
    """`generate_batch` and `certify_batch`; everything that is said is judged."""
    condition, z0, mask, stops = draw(problem, case.rng(), case.batch)
    with precision(problem):
        made = jax.tree.map(np.asarray, program_of(problem)(z0, condition, mask, stops))
        said = certify_batch(made, guidance_of(problem), condition, mask=mask)
    judge_verdicts(tally, case, problem, made.z, condition, mask, said)
    if problem.nominal:
        if any(each.generation is not None for each in said):
            tally.note("broken promises", case=case, why="a nominal sample has a record")
        return
    part = 1 if "dots" in getattr(problem.requirements[0], "pieces", ()) else 16
    tau, path = made.trace.tau[0], made.path
    if part == 1:  # thousands of margins: some of the points
        kept = np.unique(np.r_[0, np.linspace(0, len(tau) - 1, 15).astype(int), len(tau) - 1])
        tau, path = tau[kept], path[:, kept]
    eps = epsilon(problem)
    hold = judge_hypotheses(tally, case, problem, tau, path, condition, mask, said, eps, part)
    judge_rows(tally, case, problem, tau, path, condition, mask, hold, eps)
    ends = np.isin(made.path[:, -1], made.z) | np.isnan(made.z)
    if not ends.all():
        tally.note("broken promises", case=case, why="path does not end in z")


def judge_rows(tally, case, problem, tau, path, condition, mask, hold, eps):
    """Rows of explicit Euler steps with one private requirement, of a few samples whose hypotheses are said to hold."""
    (first, *more), plain = problem.requirements, problem.solver == "euler"
    plain &= problem.guard != "default" and not (problem.stops or problem.control)
    if more or not plain or not isinstance(first, Private) or "dots" in first.pieces:
        return
    index = np.flatnonzero(hold)[:ROWS]
    if not len(index):
        return
    asked, present = take(exact(condition), index), take(mask, index)
    way = np.asarray(path[index], np.float64)
    over = steepest_row(problem, np.asarray(tau, np.float64), way, asked, present, eps)
    tally.add("rows worked out", len(index))
    for k, excess in zip(index, over, strict=True):
        if excess > 0:
            tally.note(
                "false hypotheses", case=case, sample=int(k), why="a row", above=float(excess)
            )


def play_boundary(case, problem, tally):
    """Agents put on boundaries, moved by the last digits; nobody moves then."""
    rng = case.rng()
    condition, z, _, _ = draw(problem, rng, case.batch)
    c, z = condition["r0"], np.asarray(z, np.float64) * 0.5
    samples, which = np.arange(case.batch), rng.integers(4, size=case.batch)
    angle = rng.uniform(0, 2 * np.pi, case.batch)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    nudge = rng.choice([0.0, 1e-8, -1e-8, 1e-7, -1e-7, 1e-6, -1e-6], case.batch)[:, None]
    normal = np.asarray(c["planes"]["normal"][:, 0], np.float64)
    room, half = c["room"]["center"], c["room"]["half"]
    spots = np.stack(
        [
            z[:, 1] + along * (c["apart"]["least"][:, None] + nudge),
            c["discs"]["center"][:, 0] + along * (c["discs"]["radius"][:, :1] + nudge),
            normal * (c["planes"]["offset"][:, :1] + nudge),
            np.stack([room[:, 0] + half[:, 0] + nudge[:, 0], room[:, 1]], axis=-1),
        ],
        axis=1,
    )
    z[:, 0] = spots[samples, which]
    # The other requirements are out of the way, mostly.
    easy = {("apart", "least"): 1e-3, ("discs", "center"): 9.0, ("boxes", "center"): 9.0}
    easy |= {("planes", "offset"): -9.0, ("room", "half"): 9.0}
    for (name, leaf), value in easy.items():
        own = {"apart": 0, "discs": 1, "planes": 2, "room": 3}.get(name, -1)
        c[name][leaf][(which != own) & (rng.random(case.batch) < 0.9)] = value
    c["discs"]["center"][:, 1:] = 9.0
    c["planes"]["offset"][:, 1:] = -9.0
    z = z.astype(problem.dtype)
    with precision(problem):
        made = jax.tree.map(np.asarray, program_of(problem, moves=still)(z, condition, None, None))
        said = certify_batch(made, guidance_of(problem), condition)
    judge_verdicts(tally, case, problem, made.z, condition, None, said)


def play_single(case, problem, tally, jitted=24, eager=1):
    """`generate` and `certify` of one sample, jitted and not, in JAX and NumPy arrays."""
    jitted = min(jitted, case.batch)
    condition, z0, mask, stops = draw(problem, case.rng(), jitted + eager)
    for k in range(jitted + eager):
        asked, start, present, stop = (take(each, k) for each in (condition, z0, mask, stops))
        with precision(problem):
            if k < jitted:
                made = program_of(problem, single=True)(start, asked, present, stop)
            else:
                made = generate(
                    field, guidance_of(problem), start, asked, mask=present, stops=stop,
                    keep_path=True, **steps_of(problem),
                )  # fmt: skip
            said = certify(made, guidance_of(problem), asked, mask=present)
        many, present = take(condition, [k]), take(mask, [k])
        judge_verdicts(tally, case, problem, made.z[None], many, present, [said])
        tau, path = np.asarray(made.trace.tau), np.asarray(made.path)[None]
        judge_hypotheses(tally, case, problem, tau, path, many, present, [said], epsilon(problem))


def play_sample(case, problem, tally, max_draws=3):
    """`sample`: verdicts, draws, what is unmet, and the same samples for another count."""
    rng = case.rng()
    condition, _, masks, _ = draw(problem, rng, case.batch)
    steps, key = steps_of(problem), jax.random.key(int(rng.integers(2**31)))
    one = case.number % 2 == 1  # one condition for all
    if one:
        condition = jax.tree.map(lambda leaf: np.repeat(leaf[:1], case.batch, axis=0), condition)
        masks = None if masks is None else np.repeat(masks[:1], case.batch, axis=0)
    shape, guidance = (problem.agents, problem.dim), guidance_of(problem)

    def run(count):
        given = {"conditions": jax.tree.map(lambda leaf: leaf[:count], condition)}
        if masks is not None:
            given["masks"] = masks[:count]
        if one:
            given = {"condition": jax.tree.map(lambda leaf: leaf[0], condition)}
            given |= {} if masks is None else {"mask": masks[0]}
        return sample(
            field,
            guidance,
            key=key,
            count=count,
            shape=shape,
            max_draws=max_draws,
            **given,
            **steps,
        )

    found = run(case.batch)
    judge_verdicts(tally, case, problem, found.z, condition, masks, found.certificates)
    # Without a path: the end alone, where the limit is what it is whatever was before.
    end = np.ones(1), found.z[:, None]
    judge_hypotheses(
        tally, case, problem, *end, condition, masks, found.certificates, epsilon(problem)
    )
    refused = [k for k, each in enumerate(found.certificates) if not each.satisfied]
    if sorted(found.unmet) != refused or len(found) != case.batch:
        tally.note("broken promises", case=case, why="`unmet` are not those that are refused")
    for k, each in enumerate(found.certificates):
        full = each.draws == max_draws or each.satisfied
        if not 1 <= each.draws <= max_draws or not full:
            tally.note("broken promises", case=case, sample=k, why=f"{each.draws} draws")
    fewer = run(5)
    _same_samples(case, tally, found, fewer, 5)
    again = run(case.batch)
    if not np.array_equal(again.z, found.z, equal_nan=True):
        tally.note("broken promises", case=case, why="the same call gave other samples")


def _same_samples(case, tally, many, few, count):
    """Up to rounding, which fields that diverge may make anything of: those that are satisfied at the same draw."""
    for k in range(count):
        one, two = many.certificates[k], few.certificates[k]
        if one.draws != two.draws:
            if abs(one.min_margin) > 1e-3 and abs(two.min_margin) > 1e-3:
                tally.note("unlike in another count", case=case, sample=k)
            continue
        far = np.abs(many.z[k] - few.z[k]).max()
        if one.satisfied and far > 1e-3 * (1 + np.abs(many.z[k]).max()):
            tally.note("unlike in another count", case=case, sample=k, far=float(far))


def sampled(kind, structure):
    """For `sample`: both sorts of requirements, padded or not."""
    rng = problem_rng(kind, structure)
    parts = (
        (random_private(rng, OBSTACLES, 2),),
        (Shared((Factor("mean"), Factor("spread"))),),
        (random_private(rng, OBSTACLES, 2), Shared((Factor("top", moving_end=True),))),
    )[structure % 3]
    problem = Problem(parts, agents=4, padded=structure % 2 == 1)
    return replace(random_steps(rng, problem), grid=("refined", "short", "uniform")[structure % 3])
