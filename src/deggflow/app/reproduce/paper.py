"""The paper's own numbers, as printed.

Lin, Egerstedt, Pasqualetti: Multi-Agent Flow Matching with Decoupled Generative Guidance.
"""

from typing import NamedTuple

from deggflow.statistics import Rate

CASES = 50  # per row


class BridgeSuccess(NamedTuple):
    """A row of tab:task1_results."""

    nominal: Rate
    guided: Rate


class SceneSuccess(NamedTuple):
    """A row of tab:task2_success or tab:task2_families."""

    nominal_default: Rate
    nominal_changed: Rate
    guided: Rate


class Range(NamedTuple):
    """The least and the greatest ratio that the text states."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{100 * self.low:.1f}% to {100 * self.high:.1f}%"


def _bridge(nominal: int, guided: int) -> BridgeSuccess:
    return BridgeSuccess(Rate(nominal, CASES), Rate(guided, CASES))


def _scenes(nominal_default: int, nominal_changed: int, guided: int) -> SceneSuccess:
    return SceneSuccess(
        Rate(nominal_default, CASES), Rate(nominal_changed, CASES), Rate(guided, CASES)
    )


# tab:task1_results, by N
TASK1_SUCCESS = {
    4: _bridge(46, 50),
    5: _bridge(45, 50),
    6: _bridge(43, 50),
    7: _bridge(42, 50),
    8: _bridge(42, 50),
}

# tab:task2_success, by N
TASK2_SUCCESS = {
    4: _scenes(44, 36, 50),
    5: _scenes(35, 31, 50),
    6: _scenes(32, 26, 50),
    7: _scenes(16, 13, 50),
    8: _scenes(8, 6, 50),
}

# tab:task2_families, by family; 10 cases for each N = 4..8
TASK2_FAMILIES = {
    "default": _scenes(27, 27, 50),
    "opposite": _scenes(27, 23, 50),
    "side": _scenes(31, 23, 50),
    "larger": _scenes(23, 22, 50),
    "combined": _scenes(27, 17, 50),
}

# fig:task2_w2 and its text: W2 over the RMS pairwise distance of nominal scenes, N = 4 and N = 8
TASK2_W2_STATE = {4: 0.206, 8: 0.345}
TASK2_W2_POSE = {4: 0.205, 8: 0.337}
TASK2_W2_SCENES = 50  # M

# Spread of guided scenes over that of nominal ones, range over N = 4..8
TASK2_SPREAD_STATE = Range(0.983, 0.999)
TASK2_SPREAD_POSE = Range(0.991, 1.005)

TRAINING_SEEDS = 3  # of fig:task1_learning and fig:task2_learning


def overall(rates: list[Rate]) -> Rate:
    """The rate over all cases of several rows."""
    return Rate(sum(rate.successes for rate in rates), sum(rate.cases for rate in rates))
