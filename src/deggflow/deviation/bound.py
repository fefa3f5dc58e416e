"""The Wasserstein bound on the deviation, from a generation's corrections and the field's growth.

Logarithms throughout: exp(int L) of a trained field may be beyond any float.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from .coupling import Coupled
from .growth import Growth


@dataclass(frozen=True)
class Bounds:
    """Natural logarithms of bounds on the RMS of |Delta(1)|, and so on W2(mu_1, nu_1)."""

    theorem: float  # L(tau) is the largest over samples
    held: float  # the same, as `log_held_bound`
    samples: float  # each sample with its own L(tau), and no need of Minkowski's inequality
    quotient: float  # L(tau) is the least that the theorem's proof needs of these samples
    secant: float  # each pair with the growth it had; what is left is the direction of Gamma


def log_bound(
    tau: Float[np.ndarray, " points"],
    correction: Float[np.ndarray, "*samples points"],
    growth: Float[np.ndarray, "*samples points"],
) -> Float[np.ndarray, "*samples"]:
    """Logarithm of int_0^1 exp(int_s^1 L) |Gamma(s)| ds, both integrals by the trapezoidal rule on the grid.

    The rule is too large where an integrand is convex, as the outer one mostly is, and too small where it is concave;
    its error falls with the square of the steps.
    """
    step = np.diff(tau)
    area = step * (growth[..., 1:] + growth[..., :-1]) / 2
    exponent = np.concatenate([_ahead(area), np.zeros_like(area[..., :1])], axis=-1)
    weight = (np.append(step, 0.0) + np.append(0.0, step)) / 2
    return _log_sum(exponent, weight * correction)


def log_held_bound(
    tau: Float[np.ndarray, " points"],
    correction: Float[np.ndarray, "*samples points"],
    lipschitz: Float[np.ndarray, "*samples points"],
) -> Float[np.ndarray, "*samples"]:
    """The same with L and Gamma held over each step at their values at its start, as Euler's scheme holds velocities.

    |Delta_{k+1}| <= (1 + h L_k) |Delta_k| + h |Gamma_k| for fixed Euler steps, whose samples it bounds without an
    error of quadrature.
    """
    step = np.diff(tau)
    factor = np.log1p(step * lipschitz[..., :-1])
    return _log_sum(_ahead(factor) - factor, step * correction[..., :-1])


def _ahead(area: Float[np.ndarray, "*samples steps"]) -> Float[np.ndarray, "*samples steps"]:
    """Sums from each step to the last."""
    return np.cumsum(area[..., ::-1], axis=-1)[..., ::-1]


def _log_sum(
    exponent: Float[np.ndarray, "*samples points"], weight: Float[np.ndarray, "*samples points"]
) -> Float[np.ndarray, "*samples"]:
    with np.errstate(divide="ignore"):  # no correction, no weight
        return np.asarray(logsumexp(exponent + np.log(weight), axis=-1))


def _log_rms(logs: Float[np.ndarray, " samples"]) -> float:
    return float((logsumexp(2 * logs) - np.log(len(logs))) / 2)


def bounds(coupled: Coupled, growth: Growth) -> Bounds:
    """The theorem's bound over these samples, and what sharper growth makes of it.

    The mean over samples stands for the integral over p_0, so what is bounded is the distance between these two sets of
    samples. The last one uses d|Delta| / dtau = Delta . (f(z) - f(y) + Gamma) / |Delta| <= m |Delta| + |Gamma| with each
    pair's own m(tau).

    Source: paper, thm:wasserstein.
    """
    tau, correction, lipschitz, quotient, secant = (
        np.asarray(each, np.float64) for each in (coupled.tau, coupled.correction, *growth)
    )
    together, most = np.sqrt(np.mean(correction**2, axis=0)), np.max(lipschitz, axis=0)
    return Bounds(
        theorem=float(log_bound(tau, together, most)),
        held=float(log_held_bound(tau, together, most)),
        samples=_log_rms(log_bound(tau, correction, lipschitz)),
        quotient=float(log_bound(tau, together, np.max(quotient, axis=0))),
        secant=_log_rms(log_bound(tau, correction, secant)),
    )
