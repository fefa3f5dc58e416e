"""Wasserstein distance between two equally large sets of samples, beside the samples' own spread.

Source: paper, app:task2_results.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import t as student

LEAST = 3  # samples; of fewer none can be left out
CONFIDENCE = 0.95

Interval = tuple[float, float]


@dataclass(frozen=True)
class Deviation:
    """Nominal against guided samples of the same z(0), in the unit of their metric; 95% intervals."""

    samples: int
    w2: float  # distance under the best assignment
    paired: float  # RMS distance of a sample to its own guided one: at least `w2`
    identity: float  # share of samples that the best assignment leaves with their own
    spread: float  # RMS distance between two nominal samples
    ratio: float  # w2 / spread
    ratio_interval: Interval
    spread_ratio: float  # spread of guided samples / spread of nominal samples
    spread_interval: Interval

    def to_json(self) -> dict[str, Any]:
        """As it stands in a file."""
        return asdict(self)


def squared_distances(
    first: Float[np.ndarray, "samples agents dim"], second: Float[np.ndarray, "others agents dim"]
) -> Float[np.ndarray, "samples others"]:
    """Squared Euclidean distances between joint states, summed over agents, in float64."""
    rows, columns = (each.reshape(len(each), -1).astype(np.float64) for each in (first, second))
    return cdist(rows, columns, "sqeuclidean")


def assignment(cross: Float[np.ndarray, "samples samples"]) -> Int[np.ndarray, " samples"]:
    """Which column each row goes to, so that the sum of squared distances is least."""
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

    Intervals are by the jackknife: pairs are left out one by one. (A bootstrap has copies of samples, at
    distance zero from each other, which shrink spreads; and where the best assignment is not the identity it draws
    partners unequally often, which makes the assignment longer.) The assignment is not made again: W2^2 is the
    mean of phi_m + psi_m, the potentials (dual variables) of the best assignment at sample m and at its guided one, whose
    variance is that of W2^2 in its central limit theorem (del Barrio and Loubes, 2019). Where the assignment is
    the identity that is exact: pairs that no exchange improves stay so when one is left out. Intervals are about
    the value expected for as many samples; for another number it is another one.

    Args:
        cross: From each nominal sample (row) to each guided one; pairs on the diagonal.
        nominal: Among nominal samples.
        guided: Among guided samples.
    """
    count = len(cross)
    if count < LEAST:
        raise ValueError(
            f"`cross` must have at least {LEAST} samples, to leave one out; got {count}."
        )
    best = assignment(cross)
    kept = np.vstack([np.ones(count), 1 - np.eye(count)])  # all, then all but one
    square = np.maximum(kept @ _contributions(cross, best) / np.sum(kept, axis=1), 0.0)
    spread, after = _spread(nominal, kept), _spread(guided, kept)
    ratio, spread_ratio = np.sqrt(square) / spread, after / spread
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
    """Student's interval of the logarithm, as ratios are skewed; first the estimate, then those with one left out."""
    estimate, left = float(values[0]), values[1:]
    if estimate == 0:
        return 0.0, 0.0
    error = np.sqrt((len(left) - 1) * np.var(left)) / estimate
    reach = float(np.exp(student.ppf((1 + CONFIDENCE) / 2, len(left) - 1) * error))
    return estimate / reach, estimate * reach


def _spread(
    among: Float[np.ndarray, "samples samples"], kept: Float[np.ndarray, "sets samples"]
) -> Float[np.ndarray, " sets"]:
    """RMS distance over pairs of different samples, of each set of those that are kept."""
    size = np.sum(kept, axis=1)
    return np.sqrt(np.sum((kept @ among) * kept, axis=1) / (size * (size - 1)))


def _contributions(
    cross: Float[np.ndarray, "samples samples"], best: Int[np.ndarray, " samples"]
) -> Float[np.ndarray, " samples"]:
    """phi_m + psi_m of each pair m: what it adds to the sum of which W2^2 is the mean."""
    cost = cross[:, best]
    own = np.diag(cost)
    phi = _potential(cost - own[None])
    psi = np.empty_like(phi)
    psi[best] = own - phi
    return phi + psi


def _potential(
    slack: Float[np.ndarray, "samples samples"],
) -> Float[np.ndarray, " samples"]:
    """Phi with phi_i - phi_j <= slack_ij: midway between the greatest and the least, by Bellman and Ford."""
    above, below = np.zeros(len(slack)), np.zeros(len(slack))
    for _ in range(len(slack)):  # no path is longer
        lower = np.min(above[None] + slack, axis=1)
        higher = np.max(below[None] - slack.T, axis=1)
        if np.array_equal(lower, above) and np.array_equal(higher, below):
            break
        above, below = lower, higher
    return (above + below) / 2
