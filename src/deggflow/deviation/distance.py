"""Wasserstein distance between two equally large sets of samples, compared with the samples' own spread.

Source: paper, app:task2_results.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import t as student

LEAST = 3  # samples; the jackknife leaves one out, and a spread needs two
CONFIDENCE = 0.95

Interval = tuple[float, float]


@dataclass(frozen=True)
class Deviation:
    """Distance between nominal and guided samples from the same z(0), in the unit of their metric; 95% intervals.

    Attributes:
        samples: Number of samples.
        w2: Distance under the optimal assignment.
        paired: RMS distance between a nominal sample and the guided sample from the same z(0); at least `w2`.
        identity: Proportion of samples that the optimal assignment maps to the guided sample from the same z(0).
        spread: RMS distance between two nominal samples.
        ratio: w2 / spread.
        ratio_interval: 95% interval of `ratio`.
        spread_ratio: Spread of guided samples / spread of nominal samples.
        spread_interval: 95% interval of `spread_ratio`.
    """

    samples: int
    w2: float
    paired: float
    identity: float
    spread: float
    ratio: float
    ratio_interval: Interval
    spread_ratio: float
    spread_interval: Interval

    def to_json(self) -> dict[str, Any]:
        """The fields by name, as JSON values."""
        return asdict(self)


def squared_distances(
    first: Float[np.ndarray, "samples agents dim"], second: Float[np.ndarray, "others agents dim"]
) -> Float[np.ndarray, "samples others"]:
    """Squared Euclidean distances between joint states, summed over agents, in float64."""
    rows, columns = (each.reshape(len(each), -1).astype(np.float64) for each in (first, second))
    return cdist(rows, columns, "sqeuclidean")


def assignment(cross: Float[np.ndarray, "samples samples"]) -> Int[np.ndarray, " samples"]:
    """The column assigned to each row, which minimises the sum of squared distances."""
    return linear_sum_assignment(cross)[1]


def wasserstein(cross: Float[np.ndarray, "samples samples"]) -> float:
    """W2 between two equally large sets of samples, from the squared distances between them."""
    return float(np.sqrt(np.mean(cross[np.arange(len(cross)), assignment(cross)])))


def measure(
    cross: Float[np.ndarray, "samples samples"],
    nominal: Float[np.ndarray, "samples samples"],
    guided: Float[np.ndarray, "samples samples"],
) -> Deviation:
    """All figures of a set of pairs (nominal, guided) from three matrices of squared distances.

    Intervals are computed by the jackknife, which leaves out one pair at a time. (A bootstrap would contain copies of
    samples at distance zero from each other, which reduce spreads. Where the optimal assignment is not the identity, it
    would also draw partners unequally often, which increases the assignment's cost.)

    The assignment is not recomputed. W2^2 is the mean of phi_m + psi_m, the potentials (dual variables) of the optimal
    assignment at nominal sample m and at its guided sample. The variance of phi_m + psi_m is that of W2^2 in its central
    limit theorem (del Barrio and Loubes, 2019). This is exact where the assignment is the identity: an assignment that
    no exchange improves stays optimal when one pair is left out.

    Intervals concern the value expected for this number of samples, as that value depends on the number.

    Args:
        cross: Distances from each nominal sample (row) to each guided sample; pairs are on the diagonal.
        nominal: Distances between nominal samples.
        guided: Distances between guided samples.

    Raises:
        ValueError: There are fewer than three samples.
    """
    count = len(cross)
    if count < LEAST:
        raise ValueError(
            f"`cross` must have at least {LEAST} samples, to leave one out; got {count}."
        )
    best = assignment(cross)
    subsets = np.vstack([np.ones(count), 1 - np.eye(count)])  # all, then all but one
    square = np.maximum(subsets @ _contributions(cross, best) / np.sum(subsets, axis=1), 0.0)
    spread, guided_spread = _spread(nominal, subsets), _spread(guided, subsets)
    ratio, spread_ratio = np.sqrt(square) / spread, guided_spread / spread
    return Deviation(
        count,
        w2=float(np.sqrt(square[0])),
        paired=float(np.sqrt(np.mean(np.diag(cross)))),
        identity=float(np.mean(best == np.arange(count))),
        spread=float(spread[0]),
        ratio=float(ratio[0]),
        ratio_interval=_interval(ratio),
        spread_ratio=float(spread_ratio[0]),
        spread_interval=_interval(spread_ratio),
    )


def _interval(values: Float[np.ndarray, " estimates"]) -> Interval:
    """Student's interval of the logarithm, as ratios are skewed, from the estimate and the leave-one-out estimates."""
    estimate, leave_one_out = float(values[0]), values[1:]
    if estimate == 0:
        return 0.0, 0.0
    freedom = len(leave_one_out) - 1
    error = np.sqrt(freedom * np.var(leave_one_out)) / estimate
    factor = float(np.exp(student.ppf((1 + CONFIDENCE) / 2, freedom) * error))
    return estimate / factor, estimate * factor


def _spread(
    square: Float[np.ndarray, "samples samples"], subsets: Float[np.ndarray, "sets samples"]
) -> Float[np.ndarray, " sets"]:
    """RMS distance over pairs of different samples, for each subset (one in each row, as zeros and ones)."""
    size = np.sum(subsets, axis=1)
    return np.sqrt(np.sum((subsets @ square) * subsets, axis=1) / (size * (size - 1)))


def _contributions(
    cross: Float[np.ndarray, "samples samples"], best: Int[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    """phi_m + psi_m of each pair m; their mean is W2^2."""
    cost = cross[:, best]
    own = np.diag(cost)
    phi = _potential(cost - own[None])
    psi = np.empty_like(phi)
    psi[best] = own - phi
    return phi + psi


def _potential(
    slack: Float[np.ndarray, "samples samples"],
) -> Float[np.ndarray, " samples"]:
    """Potentials phi with phi_i - phi_j <= slack_ij: the mean of the greatest and the least, by Bellman and Ford."""
    above, below = np.zeros(len(slack)), np.zeros(len(slack))
    for _ in range(len(slack)):  # at most this many edges per path
        lower = np.min(above[None] + slack, axis=1)
        higher = np.max(below[None] - slack.T, axis=1)
        if np.array_equal(lower, above) and np.array_equal(higher, below):
            break
        above, below = lower, higher
    return (above + below) / 2
