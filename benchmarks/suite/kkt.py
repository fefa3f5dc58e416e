"""How far a claimed solution of an agent's QP is from its KKT conditions."""

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls


def kkt_residual(
    ell: Float[np.ndarray, "rows inputs"],
    b: Float[np.ndarray, " rows"],
    u: Float[np.ndarray, " inputs"],
    metric: Float[np.ndarray, "inputs inputs"] | None = None,
) -> float:
    """Of `min u @ H @ u / 2`, where the metric H is the identity if None, subject to `ell @ u + b <= 0`, relative to 1 + |u|, in float64.

    The larger of the greatest violation and of what the best nonnegative multipliers leave of stationarity and
    of complementary slackness. Rows are scaled to length one first; no row may be zero.
    """
    ell, b, u = (np.asarray(part, np.float64) for part in (ell, b, u))
    if not np.isfinite(u).all():
        return float("inf")
    if metric is not None:
        root = np.linalg.cholesky(metric)
        ell, u = np.linalg.solve(root, ell.T).T, root.T @ u
    length = np.linalg.norm(ell, axis=1)
    unit = ell / length[:, None]
    slack = unit @ u + b / length
    # Which rows bind needs no tolerance: a row with slack s costs its multiplier times s.
    left = nnls(np.vstack([unit.T, np.diag(slack)]), np.concatenate([-u, np.zeros(len(b))]))[1]
    return float(max(left, slack.max(initial=0.0)) / (1 + np.linalg.norm(u)))
