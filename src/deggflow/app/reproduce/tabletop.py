"""Success on the tabletop: over team sizes, and over families of requirements."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from deggflow.schema import parse_as
from deggflow.statistics import Rate
from deggflow.tasks.tabletop.evaluate import Evaluation, evaluate
from deggflow.tasks.tabletop.field import load_field
from deggflow.view.rates import RateSeries, rates_by_name, rates_over_size
from deggflow.view.style import GUIDED, NATURAL, NOMINAL

from .experiment import (
    UNMET,
    DataTable,
    Experiment,
    Finding,
    Plot,
    Progress,
    Section,
    Settings,
)
from .paper import CASES, TASK2_FAMILIES, TASK2_SUCCESS, SceneSuccess, overall
from .words import listed, proportion

SIZES = tuple(TASK2_SUCCESS)
LARGE = 12  # objects: one of every type
SEEN = 6  # most objects in a training scene
MAX_DRAWS = 8
TITLES = {
    "default": "Default",
    "opposite": "Opposite-side access",
    "side": "Side-direction access",
    "larger": "Larger affordance region",
    "combined": "Combined",
}
_WORDS = ("nominal default", "nominal changed", "guided, first draw")


class TabletopSuccess:
    """tab:task2_success."""

    name = "tabletop_success"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Nominal and guided scenes under randomly changed requirements, N = 4 to 8; a full run adds 12."""
        sizes = SIZES if settings.quick else (*SIZES, LARGE)
        grid = [("changed", size) for size in sizes]
        return _evaluated(grid, settings.cases(1_000, 16), settings.seed, say)

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """The table with the paper's values, and both as curves over N."""
        rows = _rows(result)
        of_paper = [row for row in rows if row.size in SIZES]
        ours, theirs = _sum(of_paper), _paper_sum(list(TASK2_SUCCESS.values()))
        lines = [_line(_size_title(row.size), [row], TASK2_SUCCESS.get(row.size)) for row in rows]
        lines.append(_line(f"{SIZES[0]} to {SIZES[-1]}", of_paper, theirs))
        table = DataTable(
            "tabletop_success",
            "Success for Task 2. Nominal default: the nominal scene under the default requirements; nominal changed: "
            "the same scene under the changed ones; guided: from the same z(0). Unsatisfied: cases that none of "
            f"{MAX_DRAWS} draws satisfied. Refuted: claims of success that an independent oracle (Shapely) found false. "
            f"The paper has {CASES} cases per row.",
            _columns("N"),
            lines,
        )
        plot = Plot(
            "tabletop_success",
            "Success for Task 2 over the number of objects, with 95% Wilson intervals. Open markers: the paper's.",
            rates_over_size(_size_series(rows), seen=SEEN),
        )
        return Section(
            title="Task 2: success over the number of objects",
            paper="tab:task2_success. 50 cases for each N = 4 to 8; guided scenes satisfy all requirements in all 250.",
            text=(_method(result), _difference(), _conditions(rows)),
            tables=(table,),
            plots=(plot,),
            command=_command(result, ("changed",)),
            summary=(
                Finding(
                    "Task 2, N = 4 to 8: nominal default / nominal changed / guided",
                    listed(list(theirs)),
                    listed(list(ours)),
                ),
            ),
        )


class TabletopFamilies:
    """tab:task2_families."""

    name = "tabletop_families"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Every family of requirements at N = 4 to 8."""
        grid = [(family, size) for family in TITLES for size in SIZES]
        return _evaluated(grid, settings.cases(128, 4), settings.seed, say)

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """The table over all N with the paper's values, the same for each N, and a figure."""
        rows = _rows(result)
        family = {name: [row for row in rows if row.requirements == name] for name in TITLES}
        whole = DataTable(
            "tabletop_families",
            f"Success under five families of requirements, N = {SIZES[0]} to {SIZES[-1]} together. The paper has {CASES} "
            "cases per row.",
            _columns("requirements"),
            [_line(TITLES[name], family[name], TASK2_FAMILIES[name]) for name in TITLES],
        )
        each = DataTable(
            "tabletop_families_by_size",
            "The same for each number of objects.",
            _columns("requirements", "N", paper=False),
            [[TITLES[row.requirements], row.size, *_ours([row])] for row in rows],
        )
        plot = Plot(
            "tabletop_families",
            "Success under five families of requirements, with 95% Wilson intervals. Open markers: the paper's.",
            rates_by_name(_family_series(family)),
        )
        theirs = _paper_sum(list(TASK2_FAMILIES.values()))
        return Section(
            title="Task 2: families of requirements",
            paper="tab:task2_families. Five families, 50 cases each (10 for each N = 4 to 8); all guided scenes satisfy their requirements.",
            text=(
                _method(result)
                + " All families use the same objects and the same z(0), so nominal default is the same in each "
                "row; the paper drew different cases for each family.",
            ),
            tables=(whole, each),
            plots=(plot,),
            command=_command(result, tuple(TITLES)),
            summary=(
                Finding(
                    "Task 2, five families: nominal changed / guided",
                    listed([theirs.nominal_changed, theirs.guided]),
                    listed(list(_sum(rows))[1:]),
                ),
            ),
        )


def _evaluated(
    grid: Sequence[tuple[str, int]], cases: int, seed: int, say: Progress
) -> dict[str, Any]:
    field, rows = load_field(), []
    for family, size in grid:
        say(f"N = {size}, {family} requirements, {cases} cases")
        rows.append(evaluate(field, size, family, cases, seed, MAX_DRAWS))
    unmet = [text for row in rows for text in _unmet(row)]
    return {
        "cases": cases,
        "seed": seed,
        "max_draws": MAX_DRAWS,
        "rows": [asdict(row) for row in rows],
        UNMET: unmet,
    }


def _unmet(row: Evaluation) -> list[str]:
    place = f"tabletop, N = {row.size}, {row.requirements} requirements"
    counts = {
        f"not satisfied within {MAX_DRAWS} draws": row.cases - row.satisfied,
        "claimed satisfied and refuted": row.refuted,
        "not satisfied although the theorem's hypotheses hold": row.contradicted,
    }
    return [f"{place}: {n} of {row.cases} {what}" for what, n in counts.items() if n]


def _rows(result: Mapping[str, Any]) -> list[Evaluation]:
    return [parse_as(Evaluation, row) for row in result["rows"]]


def _sum(rows: Sequence[Evaluation]) -> SceneSuccess:
    """Rates over all cases of the rows; guided on the first draw."""
    counts = [(row.nominal_default, row.nominal_changed, row.first_draw) for row in rows]
    cases = sum(row.cases for row in rows)
    return SceneSuccess(*(Rate(sum(column), cases) for column in zip(*counts, strict=True)))


def _paper_sum(rows: Sequence[SceneSuccess]) -> SceneSuccess:
    return SceneSuccess(*(overall(list(column)) for column in zip(*rows, strict=True)))


def _columns(*first: str, paper: bool = True) -> list[str]:
    of_paper = [f"{word}, paper" for word in _WORDS]
    pairs = zip(of_paper, _WORDS, strict=True)
    rates = [word for pair in pairs for word in pair] if paper else _WORDS
    return [*first, "cases", *rates, "unsatisfied", "refuted"]


def _line(first: str, rows: Sequence[Evaluation], theirs: SceneSuccess | None) -> list[Any]:
    cases, *rates, never, refuted = _ours(rows)
    of_paper = theirs or (None, None, None)
    pairs = [each for pair in zip(map(proportion, of_paper), rates, strict=True) for each in pair]
    return [first, cases, *pairs, never, refuted]


def _ours(rows: Sequence[Evaluation]) -> list[Any]:
    cases = sum(row.cases for row in rows)
    never = sum(row.cases - row.satisfied for row in rows)
    return [cases, *map(str, _sum(rows)), never, sum(row.refuted for row in rows)]


def _size_title(size: int) -> str:
    return f"{size} (unseen)" if size > SEEN else str(size)


def _size_series(rows: Sequence[Evaluation]) -> list[RateSeries]:
    looks = zip(_WORDS, (NATURAL, NOMINAL, GUIDED), SceneSuccess._fields, strict=True)
    out = []
    for word, colour, field in looks:
        ours = {row.size: getattr(_sum([row]), field) for row in rows}
        theirs = {size: getattr(row, field) for size, row in TASK2_SUCCESS.items()}
        out.append(RateSeries(word, colour, ours))
        out.append(RateSeries("paper", colour, theirs, hollow=True))
    return out


def _family_series(family: Mapping[str, Sequence[Evaluation]]) -> list[RateSeries]:
    looks = zip(_WORDS, (NATURAL, NOMINAL, GUIDED), SceneSuccess._fields, strict=True)
    out = []
    for word, colour, field in looks:
        ours = {TITLES[name]: getattr(_sum(rows), field) for name, rows in family.items()}
        theirs = {TITLES[name]: getattr(row, field) for name, row in TASK2_FAMILIES.items()}
        out.append(RateSeries(word, colour, ours))
        out.append(RateSeries("paper", colour, theirs, hollow=True))
    return out


def _method(result: Mapping[str, Any]) -> str:
    return (
        f"{result['cases']:,} random cases per row, seed {result['seed']}, judged by exact geometry in float64. The field was "
        f"trained on scenes of 4, 5 and {SEEN} objects under default requirements only."
    )


def _difference() -> str:
    return (
        "Our nominal field satisfies the default requirements more often than the paper's because its training scenes have "
        "free space around objects and regions. How often a nominal scene satisfies changed requirements depends on their "
        "distribution, which the paper does not specify in full; here each object draws one of the four changes. Compare "
        "our guided column with the paper's guided column, and each nominal column with the guided column of the same study."
    )


def _conditions(rows: Sequence[Evaluation]) -> str:
    hold, cases = sum(row.hypotheses_hold for row in rows), sum(row.cases for row in rows)
    wrong = sum(row.contradicted for row in rows)
    return (
        f"The theorem's hypotheses (rows feasible, V below its limit at every accepted point) hold along {hold:,} of {cases:,} "
        f"first draws; the verdict refused {wrong} of these."
    )


def _command(result: Mapping[str, Any], families: Sequence[str]) -> str:
    sizes = dict.fromkeys(str(row["size"]) for row in result["rows"])
    return (
        f"deggflow tabletop evaluate --cases {result['cases']} --seed {result['seed']} "
        f"--sizes {' '.join(sizes)} --requirements {' '.join(families)}"
    )


EXPERIMENTS: tuple[Experiment, ...] = (TabletopSuccess(), TabletopFamilies())
