"""The QP of one agent against solvers that others use: time of an instance, and how far from its KKT conditions they end."""

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from deggflow.guidance import min_norm_input

from .clock import Patience, in_turn
from .kkt import kkt_residual
from .rows import Row, Way, rows_of

INPUTS, SEED = 3, 0  # of an agent of the tabletop
ROWS = (2, 3, 6)
METRIC = ((2.0, 0.5, 0.0), (0.5, 1.0, 0.2), (0.0, 0.2, 0.5))
MANY, FEW = (
    4096,
    256,
)  # instances of solvers that take a batch (8 agents of 512 samples), and of those that loop

Solver = Callable[[np.ndarray, np.ndarray], Callable[[], Any]]
"""(ell, b) of all instances, in float64 -> a call that yields their inputs."""


@dataclass(frozen=True)
class Peer:
    """A solver."""

    what: str
    make: Solver
    module: str = "deggflow"  # that must be installed
    instances: int = MANY
    reference: str | None = "ours, float64"


def instances(rows: int, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """QPs with a solution, most of which ask for an input: ell, b. Rows differ in length by up to 100."""
    rng = np.random.default_rng([seed, rows])
    ell = rng.normal(size=(count, rows, INPUTS)) * 10.0 ** rng.uniform(-1, 1, (count, rows, 1))
    inside = rng.normal(size=(count, INPUTS))  # a point that meets all rows, with some room
    room = rng.exponential(0.3, size=(count, rows)) * np.linalg.norm(ell, axis=-1)
    return ell, -np.einsum("kri,ki->kr", ell, inside) - room


def agents(patience: Patience, quick: bool) -> Iterator[Row]:
    """Every solver on the same instances, with 2, 3 and 6 rows."""
    for rows in ROWS:
        yield from _compared(rows, patience, quick)


def _compared(rows: int, patience: Patience, quick: bool) -> Iterator[Row]:
    ways, calls, figures, missing = {}, {}, {}, []
    share = 8 if quick else 1
    for name, peer in PEERS.items():
        label, count = f"qp/{rows}/{name}", peer.instances // share
        what = f"{peer.what}, {rows} rows, {INPUTS} inputs"
        if importlib.util.find_spec(peer.module) is None:
            missing.append(Row(label, what, note="not installed"))
            continue
        ell, b = instances(rows, count, SEED)
        try:
            call = peer.make(ell, b)
            found = np.asarray(call(), np.float64)
        except (
            Exception
        ) as error:  # a peer may not run beside the JAX or NumPy at hand; the others still do
            missing.append(
                Row(label, what, note=f"doesn't run: {type(error).__name__}: {error}"[:120])
            )
            continue
        metric = np.array(METRIC) if name == "ours, metric" else None
        off = [kkt_residual(*one, metric) for one in zip(ell, b, found, strict=True)]
        reference = None if peer.reference is None else f"qp/{rows}/{peer.reference}"
        ways[label], calls[label] = Way(what, count, reference), call
        median, late, worst = np.quantile(off, (0.5, 0.99, 1.0))
        figures[label] = {"KKT median": float(median), "99%": float(late), "worst": float(worst)}
    yield from rows_of(ways, in_turn(calls, patience), figures)
    yield from missing


def _batched(
    solve: Callable[..., Any], wide: bool, ell: np.ndarray, b: np.ndarray
) -> Callable[[], Any]:
    """All instances in one compiled call."""
    with jax.enable_x64(wide):
        run = jax.jit(jax.vmap(solve))
        given = _given(ell, b, wide)

    def call() -> Any:
        with jax.enable_x64(wide):
            return jax.block_until_ready(run(*given))

    return call


def _one_by_one(solve: Callable[..., Any], ell: np.ndarray, b: np.ndarray) -> Callable[[], Any]:
    """Every instance in a compiled call of its own."""
    with jax.enable_x64(True):
        run = jax.jit(solve)
        given = [_given(*one, True) for one in zip(ell, b, strict=True)]

    def call() -> Any:
        with jax.enable_x64(True):
            return [jax.block_until_ready(run(*one)) for one in given]

    return call


def _given(ell: np.ndarray, b: np.ndarray, wide: bool) -> tuple[Any, Any]:
    dtype = jnp.float64 if wide else jnp.float32
    return jnp.asarray(ell, dtype), jnp.asarray(b, dtype)


def _ours(ell: Any, b: Any) -> Any:
    return min_norm_input(ell, b).u


def _ours_in_metric(ell: Any, b: Any) -> Any:
    return min_norm_input(ell, b, jnp.asarray(METRIC, ell.dtype)).u


def _qpax(ell: Any, b: Any) -> Any:
    import qpax

    inputs = ell.shape[1]
    none = jnp.zeros((0, inputs), ell.dtype), jnp.zeros(0, ell.dtype)
    return qpax.solve_qp(
        jnp.eye(inputs, dtype=ell.dtype), jnp.zeros(inputs, ell.dtype), *none, ell, -b
    )[0]


def _jaxopt(ell: Any, b: Any) -> Any:
    from jaxopt import OSQP

    inputs = ell.shape[1]
    objective = jnp.eye(inputs, dtype=ell.dtype), jnp.zeros(inputs, ell.dtype)
    return OSQP().run(params_obj=objective, params_eq=None, params_ineq=(ell, -b)).params.primal


def _cvxpylayers(ell: np.ndarray, b: np.ndarray) -> Callable[[], Any]:
    import cvxpy
    import torch
    from cvxpylayers.torch import CvxpyLayer

    rows, inputs = ell.shape[1:]
    u, slope, offset = (
        cvxpy.Variable(inputs),
        cvxpy.Parameter((rows, inputs)),
        cvxpy.Parameter(rows),
    )
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(u)), [slope @ u + offset <= 0])
    layer = CvxpyLayer(problem, parameters=[slope, offset], variables=[u])
    given = torch.from_numpy(ell), torch.from_numpy(b)

    @torch.no_grad()
    def call() -> Any:
        return layer(*given)[0]

    return call


def _quadprog(ell: np.ndarray, b: np.ndarray) -> Callable[[], Any]:
    import quadprog

    eye, zero = np.eye(INPUTS), np.zeros(INPUTS)
    given = [(-slope.T.copy(), offset) for slope, offset in zip(ell, b, strict=True)]
    return lambda: [quadprog.solve_qp(eye, zero, slope, offset)[0] for slope, offset in given]


def _proxsuite(ell: np.ndarray, b: np.ndarray) -> Callable[[], Any]:
    """Its own batch, set up and solved on all cores."""
    from proxsuite import proxqp

    eye, zero, rows = np.eye(INPUTS), np.zeros(INPUTS), ell.shape[1]
    below = np.full(rows, -np.inf)

    def call() -> Any:
        batch = proxqp.dense.BatchQP(len(ell))
        for slope, offset in zip(ell, b, strict=True):
            qp = batch.init_qp_in_place(INPUTS, 0, rows)
            qp.init(eye, zero, None, None, slope, below, -offset)
        proxqp.dense.solve_in_parallel(batch)
        # Asked for afterwards: what `init_qp_in_place` returns may move when the batch grows.
        return [batch.get(k).results.x.copy() for k in range(len(ell))]

    return call


PEERS = {
    "ours, float64": Peer("ours in float64", partial(_batched, _ours, True), reference=None),
    "ours, float32": Peer("ours in float32", partial(_batched, _ours, False)),
    "ours, metric": Peer("ours in float64, in a metric", partial(_batched, _ours_in_metric, True)),
    "ours, one by one": Peer("ours in float64, one call each", partial(_one_by_one, _ours), instances=FEW),
    "qpax": Peer("qpax in float64", partial(_batched, _qpax, True), "qpax"),
    "qpax, float32": Peer("qpax in float32", partial(_batched, _qpax, False), "qpax", reference="ours, float32"),
    "qpax, one by one": Peer("qpax in float64, one call each", partial(_one_by_one, _qpax), "qpax", FEW, "ours, one by one"),
    "jaxopt": Peer("jaxopt's OSQP in float64", partial(_batched, _jaxopt, True), "jaxopt", 512),
    "cvxpylayers": Peer("cvxpylayers' PyTorch layer", _cvxpylayers, "cvxpylayers", FEW),
    "quadprog": Peer("quadprog, in a loop", _quadprog, "quadprog", FEW),
    "proxsuite": Peer("proxsuite's dense batch, set-up included", _proxsuite, "proxsuite", FEW),
}  # fmt: skip
