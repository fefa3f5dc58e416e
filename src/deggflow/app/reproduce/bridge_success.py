"""How often robots bridge the gap, nominal and guided (paper: tab:task1_results)."""

from collections.abc import Mapping, Sequence
from typing import Any

from deggflow.schema import parse_as
from deggflow.statistics import Rate
from deggflow.tasks.bridge.evaluate import KINDS, Evaluation, evaluate
from deggflow.tasks.bridge.field import BridgeField, load_field
from deggflow.tasks.bridge.generator import MAX_DRAWS
from deggflow.tasks.bridge.options import BridgeEvaluate
from deggflow.view.rates import SuccessBars, success_bars
from deggflow.view.style import GUIDED, NOMINAL

from .experiment import UNMET, DataTable, Finding, Plot, Progress, Section, Settings
from .paper import CASES, TASK1_SUCCESS, overall

PAPER_NOMINAL = {size: row.nominal for size, row in TASK1_SUCCESS.items()}
PAPER_GUIDED = {size: row.guided for size, row in TASK1_SUCCESS.items()}
TRAINED = (4, 5, 6)  # robots in the training data, the paper's and ours
TRIALS, QUICK_TRIALS = 128, 3  # a row; 128 trials fill one compiled batch
QUICK_SIZES = (4, 8)

KIND_TITLES = dict(
    zip(
        (*KINDS, "other"),
        (
            "plank leaves the workspace",
            "plank loses its support",
            "a robot leaves the workspace",
            "a robot enters the gap",
            "not bridged in time",
            "other",
        ),
        strict=True,
    )
)


class BridgeSuccess:
    """tab:task1_results."""

    name = "bridge_success"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Nominal and guided trials of every size, from the same initial conditions and z(0)."""
        sizes = QUICK_SIZES if settings.quick else tuple(PAPER_NOMINAL)
        trials = settings.cases(TRIALS, QUICK_TRIALS)
        return measure_rows(load_field(), sizes, trials, settings.seed, say)

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """Success compared with the paper's, and the failures of nominal trials."""
        rows = [parse_as(Evaluation, row) for row in result["rows"]]
        trials, seed = result["trials"], result["seed"]
        sizes = " ".join(str(row.size) for row in rows)
        nominal, guided = _overall(rows)
        paper = [rate.proportion for rate in _paper_overall(rows)]
        return Section(
            title="Task 1: success of bridge building",
            paper="tab:task1_results. 50 trials for each N = 4 to 8: nominal 46, 45, 43, 42, 42, guided 50 each. Training data "
            "have 4, 5 and 6 robots.",
            text=_text(rows, result["max_draws"]),
            tables=(_success(rows), _failures(rows), _policies(rows, result["max_draws"])),
            plots=(Plot("bridge_success", _caption(trials), _figure(rows)),),
            command=f"deggflow bridge evaluate --trials {trials} --sizes {sizes} --seed {seed}",
            summary=(
                Finding(
                    f"Task 1, N = {', '.join(str(row.size) for row in rows)}: nominal / guided",
                    " / ".join(f"{100 * proportion:.1f}%" for proportion in paper),
                    f"{100 * nominal.proportion:.1f}% / {100 * guided.proportion:.1f}%",
                ),
            ),
        )


def measure_rows(
    field: BridgeField, sizes: Sequence[int], trials: int, seed: int, say: Progress
) -> dict[str, Any]:
    """One row for each size."""
    options = BridgeEvaluate(trials=trials, seed=seed, max_draws=MAX_DRAWS)
    rows = []
    for size in sizes:
        say(f"N = {size}: {trials} trials, nominal and guided")
        rows.append(evaluate(field, size, options).to_json())
    unmet = [text for row in rows for text in (*row["blocked"], *row["refuted"])]
    return {"trials": trials, "seed": seed, "max_draws": MAX_DRAWS, "rows": rows, UNMET: unmet}


def size_title(size: int) -> str:
    """A row's label, as in the paper."""
    return str(size) if size in TRAINED else f"{size} (unseen)"


def _overall(rows: Sequence[Evaluation]) -> tuple[Rate, Rate]:
    """Nominal and guided, all sizes together."""
    trials = sum(row.trials for row in rows)
    return (
        Rate(sum(row.nominal for row in rows), trials),
        Rate(sum(row.guided for row in rows), trials),
    )


def _paper_overall(rows: Sequence[Evaluation]) -> tuple[Rate, Rate]:
    """The paper's rates, for the same sizes."""
    return (
        overall([PAPER_NOMINAL[row.size] for row in rows]),
        overall([PAPER_GUIDED[row.size] for row in rows]),
    )


def _text(rows: Sequence[Evaluation], max_draws: int) -> list[str]:
    nominal, guided = _overall(rows)
    refuted = [text for row in rows for text in row.refuted]
    texts = [
        f"From the same initial conditions and z(0), nominal policies bridge the gap in {nominal.successes} of "
        f"{nominal.cases} trials, {nominal}, guided ones in {guided.successes}, {guided} (95% Wilson intervals). "
        "Success and failure are decided by exact geometry, without the factors' buffers.",
        f"Every outcome, nominal or guided, was replayed by an independent integrator and judged by Shapely: "
        f"{len(refuted)} of {2 * nominal.cases} were refuted. A guided policy that misses a bound is redrawn, "
        f"with at most {max_draws} draws; the last table shows how often that was needed.",
    ]
    texts += [
        f"Guided, but the gap is not bridged: {text}." for row in rows for text in row.blocked
    ]
    return texts + [f"Refuted: {text}." for text in refuted]


def _of_paper(rate: Rate) -> str:
    return f"{rate.successes}/{rate.cases} ({100 * rate.proportion:.3g}%)"


def _success(rows: Sequence[Evaluation]) -> DataTable:
    lines: list[tuple[str | int, ...]] = []
    for row in rows:
        lines.append(
            (
                size_title(row.size),
                row.trials,
                row.nominal,
                str(row.rate(row.nominal)),
                row.guided,
                str(row.rate(row.guided)),
                len(row.refuted),
                _of_paper(PAPER_NOMINAL[row.size]),
                _of_paper(PAPER_GUIDED[row.size]),
            )
        )
    nominal, guided = _overall(rows)
    refuted = sum(len(row.refuted) for row in rows)
    proportions = nominal.successes, str(nominal), guided.successes, str(guided)
    of_paper = (_of_paper(rate) for rate in _paper_overall(rows))
    lines.append(("overall", nominal.cases, *proportions, refuted, *of_paper))
    return DataTable(
        "bridge_success",
        "Trials that bridge the gap, with 95% Wilson intervals, beside the paper's (tab:task1_results).",
        (
            "N",
            "trials",
            "nominal",
            "nominal [95%]",
            "guided",
            "guided [95%]",
            "refuted by Shapely",
            "nominal (paper)",
            "guided (paper)",
        ),
        lines,
    )


def _failures(rows: Sequence[Evaluation]) -> DataTable:
    return DataTable(
        "bridge_failures",
        "Failures of nominal trials.",
        ("N", "failed", *KIND_TITLES.values()),
        [
            (
                size_title(row.size),
                row.trials - row.nominal,
                *(row.failures[kind] for kind in KIND_TITLES),
            )
            for row in rows
        ],
    )


def _policies(rows: Sequence[Evaluation], max_draws: int) -> DataTable:
    lines = []
    for row in rows:
        nominal, guided = row.policies["nominal"], row.policies["guided"]
        lines.append(
            (
                size_title(row.size),
                nominal.generated,
                nominal.met,
                guided.generated,
                guided.met_at_once,
                guided.met,
                guided.most_draws,
                1000 * row.least_margin,
            )
        )
    return DataTable(
        "bridge_policies",
        "Policies of these trials that end with q_task and q_safe below their bounds, and the least margin to any "
        "failure over all executed guided motions.",
        (
            "N",
            "nominal policies",
            "both met",
            "guided policies",
            "both met, first draw",
            f"both met, <= {max_draws} draws",
            "most draws",
            "least margin, guided (mm)",
        ),
        lines,
    )


def _caption(trials: int) -> str:
    return (
        f"Trials that bridge the gap: ours ({trials} for each N) and the paper's ({CASES} for each N), with "
        "95% Wilson intervals, those of the paper's counts computed here."
    )


def _figure(rows: Sequence[Evaluation]) -> Any:
    bars = []
    for name, colour, rates in (
        ("nominal", NOMINAL, PAPER_NOMINAL),
        ("guided", GUIDED, PAPER_GUIDED),
    ):
        paper = [rates[row.size] for row in rows]
        ours = [row.rate(getattr(row, name)) for row in rows]
        bars += [
            SuccessBars(f"{name} (paper)", colour, paper, quoted=True),
            SuccessBars(f"{name} (ours)", colour, ours),
        ]
    return success_bars(
        [size_title(row.size) for row in rows],
        bars,
        xlabel="number of robots $N$",
        ylabel="trials that bridge the gap (%)",
    )
