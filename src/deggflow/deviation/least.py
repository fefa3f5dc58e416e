"""A lower bound on how far a team must move, from inequalities between the distances that its agents move."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls
from scipy.stats import t as student

from .distance import CONFIDENCE


class Cuts(NamedTuple):
    """Inequalities weights . (e_first, e_second) >= least that hold for the distances e_i of all agents.

    Attributes:
        agents: First and second agent of each; any two if a weight is zero.
        weights: Not negative.
        least: Positive, in the unit of the distances.
    """

    agents: Int[np.ndarray, "cuts 2"]
    weights: Float[np.ndarray, "cuts 2"]
    least: Float[np.ndarray, " cuts"]


def least_square_sum(cuts: Cuts, agents: int) -> float:
    """A lower bound on sum_i e_i^2 over all e that satisfy the cuts, valid whatever the solver returns.

    For cuts A e >= s and any u >= 0, s . u <= (A^T u) . e <= |A^T u| |e|, hence |e|^2 >= (s . u)^2 / |A^T u|^2. The
    best u, for which equality holds, is a least-squares problem with u >= 0. A matching is one choice of u: disjoint
    pairs add up. The bound is therefore at least as large as that of every matching.

    Args:
        cuts: Inequalities; none give zero.
        agents: Number of agents.

    Example:
        Agents 0 and 1, and 1 and 2, must part by 1 in all; agent 1 moves by 2/3, the others by 1/3.

        >>> chain = Cuts(np.array([[0, 1], [1, 2]]), np.ones((2, 2)), np.ones(2))
        >>> round(least_square_sum(chain, 3), 6)
        0.666667
    """
    count = len(cuts.least)
    if count == 0:
        return 0.0
    matrix = np.zeros((count, agents))
    np.add.at(matrix, (np.arange(count)[:, None], cuts.agents), cuts.weights)
    scale = np.max(cuts.least)
    try:
        u, _ = nnls(np.vstack([matrix.T, cuts.least / scale]), np.append(np.zeros(agents), 1.0))
    except RuntimeError:  # too many iterations
        u = np.zeros(count)
    # One cut alone is a choice of u, too.
    choices = np.vstack([u, np.eye(count)])
    gain, length = choices @ cuts.least, np.linalg.norm(choices @ matrix, axis=1)
    return float(np.max(np.where(length > 0, gain / np.where(length > 0, length, 1.0), 0.0)) ** 2)


def lower_confidence(squares: Float[np.ndarray, " samples"], level: float = CONFIDENCE) -> float:
    """A lower confidence limit on the root of the expected square, by Student's t.

    The squares are independent, and their distribution has a long right tail. The limit is then conservative, as the
    mean and the standard deviation of a sample are positively correlated.

    Args:
        squares: Independent squared distances.
        level: Probability with which the limit lies below the expected value.

    Raises:
        ValueError: There are fewer than two squares.
    """
    count = len(squares)
    if count < 2:
        raise ValueError(f"`squares` must have at least 2 values, for a variance; got {count}.")
    error = np.std(squares, ddof=1) / np.sqrt(count) * student.ppf(level, count - 1)
    return float(np.sqrt(max(np.mean(squares) - error, 0.0)))
