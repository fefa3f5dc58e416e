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
    """Natural logarithms of bounds on the RMS of |Delta(1)|, and so on W2(mu_1, nu_1).

    The first is the theorem's integral, by quadrature. The others bound samples made by fixed Euler steps, as a
    recursion over the steps and without an error of quadrature: `secant` <= `samples` <= `held`, and
    `secant` <= `quotient` <= `held`.
    """

    theorem: float  # L(tau) is the largest over samples
    held: float  # the same, Euler step by Euler step
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
    its error falls with the square of the steps. It is about trajectories in continuous time. With a one-sided growth
    in the place of L it does not bound Euler samples: where a field only turns, at a rate q, the growth is zero, and a
    step h stretches by sqrt(1 + h^2 q^2).
    """
    step = np.diff(tau)
    area = step * (growth[..., 1:] + growth[..., :-1]) / 2
    weight = (np.append(step, 0.0) + np.append(0.0, step)) / 2
    return _log_sum(_including(area), weight * correction)


def log_held_bound(
    tau: Float[np.ndarray, " points"],
    correction: Float[np.ndarray, "*samples points"],
    lipschitz: Float[np.ndarray, "*samples points"],
) -> Float[np.ndarray, "*samples"]:
    """The same of fixed Euler steps: |Delta_{k+1}| <= (1 + h L_k) |Delta_k| + h |Gamma_k|."""
    step = np.diff(tau)
    return _log_recursion(step, correction, np.log1p(step * lipschitz[..., :-1]))


def log_secant_bound(
    tau: Float[np.ndarray, " points"],
    correction: Float[np.ndarray, "*samples points"],
    secant: Float[np.ndarray, "*samples points"],
    quotient: Float[np.ndarray, "*samples points"],
) -> Float[np.ndarray, "*samples"]:
    """The same with the factor by which an Euler step of the field alone stretches the gap Delta of a pair.

    With m its secant and q its quotient, |Delta + h (f(z) - f(y))|^2 = (1 + 2 h m + h^2 q^2) |Delta|^2, hence
    |Delta_{k+1}| <= sqrt(1 + 2 h m_k + h^2 q_k^2) |Delta_k| + h |Gamma_k|. The factor is at most 1 + h q.
    """
    step = np.diff(tau)
    along, size = step * secant[..., :-1], step * quotient[..., :-1]
    across = np.maximum(size**2 - along**2, 0.0)  # |m| <= q but for rounding
    with np.errstate(divide="ignore"):  # a step may bring the two together
        return _log_recursion(step, correction, np.log((1 + along) ** 2 + across) / 2)


def _log_recursion(
    step: Float[np.ndarray, " steps"],
    correction: Float[np.ndarray, "*samples points"],
    log_factor: Float[np.ndarray, "*samples steps"],
) -> Float[np.ndarray, "*samples"]:
    """Logarithm of what x' = factor x + h |Gamma| makes of x = 0, with all of a step's values those at its start."""
    return _log_sum(_including(log_factor)[..., 1:], step * correction[..., :-1])


def _including(each: Float[np.ndarray, "*samples steps"]) -> Float[np.ndarray, "*samples points"]:
    """Sums over the steps that begin at each point or after it."""
    ahead = np.cumsum(each[..., ::-1], axis=-1)[..., ::-1]
    return np.concatenate([ahead, np.zeros_like(each[..., :1])], axis=-1)


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
    samples. All but the first are about samples made by Euler steps on the grid of `coupled`.

    Source: paper, thm:wasserstein.
    """
    tau, correction, lipschitz, quotient, secant = (
        np.asarray(each, np.float64) for each in (coupled.tau, coupled.correction, *growth)
    )
    together, most = np.sqrt(np.mean(correction**2, axis=0)), np.max(lipschitz, axis=0)
    return Bounds(
        theorem=float(log_bound(tau, together, most)),
        held=float(log_held_bound(tau, together, most)),
        samples=_log_rms(log_held_bound(tau, correction, lipschitz)),
        quotient=float(log_held_bound(tau, together, np.max(quotient, axis=0))),
        secant=_log_rms(log_secant_bound(tau, correction, secant, quotient)),
    )
