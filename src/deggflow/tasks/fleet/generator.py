"""Certified plans from a nominal field: nominal paths, choices, guidance, verdicts and redraws."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from deggflow.blocks import blocks, map_blocks
from deggflow.certificate import Certificate, GenerationRecord
from deggflow.divergence import REASON, has_diverged
from deggflow.drift import ExtrapolatedEndpoint
from deggflow.flow import Field
from deggflow.generation import refined_grid
from deggflow.guidance import AbstractGuidance, NoGuidance
from deggflow.recording import records
from deggflow.redraw import Candidate, finished, redraw_until_satisfied, with_draws
from deggflow.sampler import Program, Sampler, numbered_noise
from deggflow.step_guard import StepGuard

from .condition import MAX_ROBOTS, FleetCondition, padding, to_arrays
from .crowding import crowding
from .draws import ChosenThenGuided, Draw, guided_throughout
from .options import FleetFieldOptions
from .paths import DIM, exact_path, to_modes
from .plan import Plan, robot_names
from .requirements import Crowding, fleet_guidance
from .routes import Search, routes
from .verdict import Verdict, judge

STEPS = 100
GUARD = StepGuard(halvings=2, width=8)
CHOICES = 2  # how often the robots of a draw choose; again only those that miss something
ANEW = 4  # every so many draws, all robots draw new paths
ROUTES = 3  # short ways of each robot
HANDICAP = 20.0  # of these ways, in V over the square of its buffer
NEVER = 1e9  # handicap of what is not chosen
MAX_COORDINATE = 1e4  # map units; states beyond have diverged, and are not stored in files


class Batch(NamedTuple):
    """One draw of some plans.

    Attributes:
        z: States, padded.
        paths: In map units, float64.
        verdicts: On these paths.
        diverged: Whether each generation did; its paths are straight lines then.
        records: Of the guidance; None where there was none.
    """

    z: Float[np.ndarray, "plans agents dim"]
    paths: list[Float[np.ndarray, "robots 64 2"]]
    verdicts: list[Verdict]
    diverged: list[bool]
    records: list[GenerationRecord | None]

    def put(self, places: Int[np.ndarray, " part"], part: "Batch") -> None:
        """Puts the plans of another batch into some places."""
        self.z[places] = part.z
        for name in self._fields[1:]:
            for place, value in zip(places, getattr(part, name), strict=True):
                getattr(self, name)[place] = value


class Starts(NamedTuple):
    """What the robots of some plans begin with besides paths of the field; as of `Draw`.

    Attributes:
        kept: States.
        keeps: Which robots keep theirs.
        routes: Short ways of each robot.
        handicap: Of these ways, in V over the square of its buffer.
    """

    kept: Float[np.ndarray, "plans agents dim"]
    keeps: Bool[np.ndarray, "plans agents"]
    routes: Float[np.ndarray, "plans routes agents dim"]
    handicap: Float[np.ndarray, "plans agents"]

    def of(self, rows: Int[np.ndarray, " rows"]) -> "Starts":
        """Those of some plans."""
        return Starts(*(each[rows] for each in self))

    def keep(
        self,
        rows: Int[np.ndarray, " rows"],
        z: Float[np.ndarray, "rows agents dim"],
        keeps: Bool[np.ndarray, "rows agents"],
    ) -> None:
        """Sets what the robots of some plans have and keep."""
        self.kept[rows], self.keeps[rows] = z, keeps

    @classmethod
    def none(cls, plans: int, agents: int) -> "Starts":
        """Nothing: robots keep no path, and no short way is chosen."""
        z, false = np.zeros((plans, agents, DIM), np.float32), np.zeros((plans, agents), bool)
        routes = np.zeros((plans, ROUTES, agents, DIM), np.float32)
        return cls(z, false, routes, np.full((plans, agents), NEVER, np.float32))


def initial_noise(
    seed: int, numbers: Int[np.ndarray, " plans"], draw_number: int, agents: int, candidates: int
) -> Float[np.ndarray, "plans candidates agents dim"]:
    """z(0) of plans by their number in the run: N(0, I), of every robot the same whatever the padding."""
    robots = (numbers[:, None] * MAX_ROBOTS + np.arange(agents)).ravel()
    noise = [
        numbered_noise(seed, robots, draw_number, k, shape=(1, DIM)) for k in range(candidates)
    ]
    whole = np.stack(noise).reshape(candidates, len(numbers), agents, DIM)
    return np.moveaxis(whole, 0, 1)


@cache
def _program(crowding: Crowding) -> Program:
    return ChosenThenGuided(crowding)


def _nobody(number: int, plan: Plan) -> None:
    """Watches no draw."""


class FleetGenerator:
    """Generates plans with one field; compiled programs are kept between calls."""

    def __init__(self, field: Field, options: FleetFieldOptions, *, guided: bool = True) -> None:
        """One field, one way of generating.

        Args:
            field: Nominal field.
            options: How often the field is evaluated, when guidance acts, and number of candidates.
            guided: Whether guidance acts at all.
        """
        self.field, self.guided = field, guided
        self.chooses = guided and options.guidance_phase == "after"
        self.candidates = options.candidates if self.chooses else 1
        self.drift = ExtrapolatedEndpoint(options.evaluations)
        self.grid = refined_grid(max(STEPS, options.evaluations))
        self.guard = GUARD if guided else None
        self._samplers: dict[Crowding, Sampler] = {}

    def _sampler(self, of: Crowding) -> Sampler:
        if of not in self._samplers:
            program = _program(of) if self.chooses else guided_throughout
            self._samplers[of] = Sampler(
                self.field, self.grid, self.guard, program, drift=self.drift
            )
        return self._samplers[of]

    def batch(
        self,
        noise: Float[np.ndarray, "plans candidates agents dim"],
        conditions: Sequence[FleetCondition],
        starts: Starts | None = None,
        among: Sequence[FleetCondition] | None = None,
    ) -> Batch:
        """One draw of each condition from given z(0), and from other paths where there are any.

        `among`: more conditions that the same compiled program serves, as this depends on the floors.
        """
        z = np.zeros((len(conditions), *noise.shape[2:]), np.float32)
        starts = Starts.none(*z.shape[:2]) if starts is None else starts
        among = conditions if among is None else among
        of = crowding(among)
        guidance: AbstractGuidance = fleet_guidance(of) if self.guided else NoGuidance()
        sizes = padding(among)._replace(agents=noise.shape[2])
        rows: Any = starts
        draw = Draw(to_arrays(conditions, sizes), *rows)
        generation = self._sampler(of).draw(guidance, noise, draw)
        z[:] = generation.z
        made: list[GenerationRecord | None] = [None] * len(conditions)
        if self.guided:
            robots = [robot_names(len(condition.robots)) for condition in conditions]
            made = [*records(generation.summary, guidance.names, robots)]
        return _judged(z, conditions, made)

    def plans(
        self,
        conditions: Sequence[FleetCondition],
        *,
        seed: int = 0,
        first: int = 0,
        max_draws: int = 1,
        on_draw: Callable[[int, Plan], None] = _nobody,
    ) -> list[Plan]:
        """Plans with certificates. Where a draw fails, robots that miss a requirement draw again, the others keep their paths.

        Robots begin with one of the field's nominal paths, or, if all of these conflict with obstacles or other robots,
        with one of a few short ways on a roadmap of its own, each of them now, later or sooner. In every draw, robots that
        miss something after guidance choose once more among the paths that they have drawn. Every other draw, robots that
        draw again begin with a short way in any case.

        Args:
            conditions: What to generate.
            seed: With a plan's number and the number of the draw, decides z(0).
            first: Number of the first condition in the run.
            max_draws: Limit per plan; where none is satisfied the closest is returned.
            on_draw: Told of every draw, refused ones too: the plan's number in the run, and the plan as drawn.
        """
        agents = padding(conditions).agents
        starts = Starts.none(len(conditions), agents)

        def draw(rows: Int[np.ndarray, " plans"], number: int) -> list[Plan]:
            noise = initial_noise(seed, rows + first, number, agents, self.candidates)
            if number % ANEW == 0:
                starts.keeps[rows] = False
            if self.chooses:
                self._set_routes(starts, rows.tolist(), conditions, (seed, first, number))
            batch = self._chosen_and_guided(noise, conditions, starts, rows)
            return _certified(batch, [conditions[k] for k in rows], seed)

        def attempt(index: Sequence[int], number: int) -> list[Candidate[Plan]]:
            # While one block is judged, another is guided: a verdict takes no more than one core.
            parts = [np.asarray(index)[rows] for rows in blocks(len(index))]
            of_blocks = map_blocks(lambda rows: draw(rows, number), parts, compiled=number > 0)
            plans = [plan for block in of_blocks for plan in block]
            for k, plan in zip(index, plans, strict=True):
                on_draw(k + first, with_draws(plan, number + 1))
            return [
                Candidate(plan, plan.certificate.satisfied, -plan.certificate.violation)
                for plan in plans
            ]

        return finished(redraw_until_satisfied(attempt, len(conditions), max_draws))

    def _chosen_and_guided(
        self,
        noise: Float[np.ndarray, "rows candidates agents dim"],
        conditions: Sequence[FleetCondition],
        starts: Starts,
        rows: Int[np.ndarray, " rows"],
    ) -> Batch:
        """One draw of some of the plans; `starts` of these plans become what their robots have then.

        Robots that miss a requirement after guidance choose again among the same paths, against those of the others as they
        are by then, and guidance acts once more.
        """

        def guided(part: Int[np.ndarray, " part"]) -> Batch:
            of = rows[part]
            batch = self.batch(noise[part], [conditions[k] for k in of], starts.of(of), conditions)
            starts.keep(of, batch.z, _unblocked(batch, starts.kept.shape[1]))
            return batch

        batch = guided(np.arange(len(rows)))
        for _ in range(CHOICES - 1 if self.chooses else 0):
            left = np.flatnonzero([not verdict.satisfied for verdict in batch.verdicts])
            if not len(left):
                break
            batch.put(left, guided(left))
        return batch

    def _set_routes(
        self,
        starts: Starts,
        index: Sequence[int],
        conditions: Sequence[FleetCondition],
        seeds: tuple[int, int, int],
    ) -> None:
        """Sets the routes of robots that keep no path; every other draw they take them whatever they cost."""
        seed, first, number = seeds
        searches = {}
        for k in index:
            robots = np.flatnonzero(~starts.keeps[k, : len(conditions[k].robots)])
            if len(robots):
                rng = np.random.default_rng([seed, first + k, number])
                searches[k] = Search(conditions[k], robots, rng)
        found = routes([*searches.values()], ROUTES)
        for (k, search), ways in zip(searches.items(), found, strict=True):
            starts.routes[k][:, search.robots] = to_modes(ways)
            starts.handicap[k, search.robots] = -NEVER if number % 2 else HANDICAP


def _unblocked(batch: Batch, agents: int) -> Bool[np.ndarray, "plans agents"]:
    """Robots that miss nothing; none of a plan that diverged."""
    keeps = np.ones((len(batch.verdicts), agents), bool)
    for row, verdict, diverged in zip(keeps, batch.verdicts, batch.diverged, strict=True):
        row[list(verdict.blocked)] = False
        row &= not diverged
    return keeps


def _judged(
    z: Float[np.ndarray, "plans agents dim"],
    conditions: Sequence[FleetCondition],
    records: list[GenerationRecord | None],
) -> Batch:
    paths, diverged = [], []
    for state, condition in zip(z, conditions, strict=True):
        own = state[: len(condition.robots)]
        lost = has_diverged(own, MAX_COORDINATE)
        own = np.zeros_like(own) if lost else own
        paths.append(exact_path(own, condition.starts, condition.goals))
        diverged.append(lost)
    return Batch(z, paths, judge(conditions, paths), diverged, records)


def _certified(batch: Batch, conditions: Sequence[FleetCondition], seed: int) -> list[Plan]:
    """Every plan of a batch with its certificate."""
    plans = []
    for k, (condition, verdict) in enumerate(zip(conditions, batch.verdicts, strict=True)):
        generation, diverged = batch.records[k], batch.diverged[k]
        reason = verdict.reason()
        if reason is not None and generation is not None and generation.first_failure is not None:
            reason += f"; on the way {generation.first_failure}"
        certificate = Certificate(
            verdict.satisfied and not diverged, verdict.min_margin, verdict.violation, 1,
            REASON if diverged else reason, generation,
        )  # fmt: skip
        plans.append(Plan(condition, batch.paths[k], certificate, seed))
    return plans
