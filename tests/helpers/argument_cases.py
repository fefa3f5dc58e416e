"""Calls with one wrong argument each, run by plain Python: prints what each of them raises, as JSON.

Under the tests' own type checker wrong shapes never reach the library's checks; users have no type checker.
"""

import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np

import deggflow as dg
from deggflow import requirements as req

Z0 = jnp.zeros((3, 2))
Z64 = np.zeros((3, 2))


def field(tau, z, condition):
    return -z


def far(z, condition):
    return dg.distances(z) - 0.3


APART = dg.PrivateRequirement(far, 0.02, name="apart")
LEFT = dg.SharedRequirements((dg.SharedFactor(lambda tau, z, c: jnp.mean(z[:, 0]), name="left"),))
DISC = req.Disc((0.0, 0.0), 1.0)
GUIDANCE = dg.DecoupledGuidance((APART,))


def generate(requirement=APART, z0=Z0, field=field, condition=None, **options):
    guidance = options.pop("guidance", None) or dg.DecoupledGuidance((requirement,))
    return dg.generate(field, guidance, z0, condition, **options)


def margins(function):
    return generate(dg.PrivateRequirement(function, 0.02, name="apart"))


def factor(function):
    return generate(dg.SharedRequirements((dg.SharedFactor(function, name="left"),)))


def sample(**options):
    given = {"key": jax.random.key(0), "count": 2, "shape": (3, 2), **options}
    return dg.sample(field, (APART,), given.pop("condition", None), **given)


def batch(condition):
    return dg.generate_batch(field, GUIDANCE, jnp.zeros((4, 3, 2)), condition)


def rounded(z, condition):
    return (dg.distances(z) - 0.3).astype(jnp.float32)


def narrow(condition):
    return jnp.eye(2)


CASES = {
    "boolean margins": lambda: margins(lambda z, c: dg.distances(z) >= 0.3),
    "integer margins": lambda: margins(lambda z, c: jnp.ones((3, 1), int)),
    "margins without columns": lambda: margins(lambda z, c: z[:, 0]),
    "transposed margins": lambda: margins(lambda z, c: jnp.ones((7, 3)) + 0.0 * z[0, 0]),
    "margins that are no function": lambda: dg.PrivateRequirement(0.3, 0.02),
    "negative buffer": lambda: dg.PrivateRequirement(far, -0.02),
    "buffer that is not a number": lambda: dg.PrivateRequirement(far, float("nan")),
    "negative buffer of a factor": lambda: dg.SharedFactor(lambda t, z, c: 0.0, buffer=-1.0),
    "margins that are rounded": lambda: dg.certify(
        generate(dg.PrivateRequirement(rounded, 0.02, name="apart")),
        (dg.PrivateRequirement(rounded, 0.02, name="apart"),),
    ),
    "boolean value": lambda: factor(lambda tau, z, c: jnp.mean(z) > 0),
    "value for each agent": lambda: factor(lambda tau, z, c: z[:, 0]),
    "profile that does not end": lambda: dg.TighteningBound(profile=lambda tau: 1 - tau / 2),
    "end that is no function": lambda: dg.TighteningBound(end=0.5),
    "factors that are no tuple": lambda: dg.SharedRequirements(LEFT.factors[0]),
    "one requirement": lambda: dg.DecoupledGuidance(APART),
    "a list of requirements": lambda: dg.DecoupledGuidance([APART]),
    "two of one name": lambda: dg.DecoupledGuidance((APART, APART)),
    "metric that is not positive": lambda: dg.DecoupledGuidance((APART,), metric=-jnp.eye(2)),
    "metric that is not symmetric": lambda: dg.DecoupledGuidance(
        (APART,), metric=jnp.array([[1.0, 0.5], [0.0, 1.0]])
    ),
    "metric of another size": lambda: generate(
        guidance=dg.DecoupledGuidance((APART,), metric=jnp.eye(3))
    ),
    "box of zero": lambda: dg.DecoupledGuidance((APART,), box=0.0),
    "box for each input": lambda: dg.DecoupledGuidance((APART,), box=(1.0, 1.0)),
    "control of one matrix": lambda: generate(
        guidance=dg.DecoupledGuidance((APART,), lambda tau, z, c: jnp.eye(2))
    ),
    "control that is no function": lambda: dg.DecoupledGuidance((APART,), jnp.eye(2)),
    "integer z0": lambda: generate(z0=jnp.zeros((3, 2), int)),
    "flat z0": lambda: generate(z0=jnp.zeros(6)),
    "a batch of z0": lambda: generate(z0=jnp.zeros((4, 3, 2))),
    "z0 of one sample": lambda: dg.generate_batch(field, GUIDANCE, Z0, None),
    "field that would be broadcast": lambda: generate(field=lambda tau, z, c: jnp.ones(2)),
    "integer field": lambda: generate(field=lambda tau, z, c: jnp.ones((3, 2), int)),
    "field that returns a number": lambda: generate(field=lambda tau, z, c: 0.0),
    "grid that ends early": lambda: generate(grid=np.linspace(0, 0.02, 3)),
    "grid that is reversed": lambda: generate(grid=np.linspace(1, 0, 11)),
    "grid that goes back": lambda: generate(grid=np.array([0.0, 0.6, 0.4, 1.0])),
    "grid that begins late": lambda: generate(grid=jnp.linspace(0.1, 1, 11)),
    "grid of one point": lambda: generate(grid=np.ones(1)),
    "grid with not a number": lambda: generate(grid=np.array([0.0, np.nan, 1.0])),
    "mask of numbers": lambda: generate(mask=np.ones(3)),
    "mask of another size": lambda: generate(mask=np.ones(4, bool)),
    "stops of another size": lambda: generate(stops=np.ones(4)),
    "condition without samples": lambda: batch({"speed": jnp.ones(()), "goal": jnp.ones((4, 2))}),
    "condition of agents": lambda: batch({"goal": jnp.ones((3, 2))}),
    "certify a batch": lambda: dg.certify(
        dg.generate_batch(field, GUIDANCE, jnp.zeros((4, 3, 2)), None), GUIDANCE
    ),
    "certify an array": lambda: dg.certify(generate().z, GUIDANCE),
    "certify_batch of one": lambda: dg.certify_batch(generate(), GUIDANCE),
    "certify with one requirement": lambda: dg.certify(generate(), APART),
    "certify without agents": lambda: dg.certify(generate(), GUIDANCE, mask=np.zeros(3, bool)),
    "trajectory of text": lambda: dg.certify(
        dg.Trajectory(np.array(["a", "b"]), np.zeros((2, 3, 2))), GUIDANCE
    ),
    "no samples": lambda: sample(count=0),
    "shape of numbers": lambda: sample(shape=(3,)),
    "both conditions": lambda: sample(condition=1.0, conditions=jnp.ones(2)),
    "conditions of another count": lambda: sample(conditions=jnp.ones(3)),
    "mask and masks": lambda: sample(mask=np.ones(3, bool), masks=np.ones((2, 3), bool)),
    "no draws": lambda: sample(max_draws=0),
    "z(0) of another shape": lambda: sample(initial=lambda key, shape: jnp.zeros((2, 2))),
    "key that is a number": lambda: sample(key=0),
    "condition with text": lambda: sample(condition={"name": "kitchen"}),
    "solver by name": lambda: generate(solver="euler"),
    "drift by name": lambda: generate(drift="held"),
    "guard that is a number": lambda: generate(guard=3),
    "no guidance": lambda: generate(guidance=(far,)),
    "formula that is a region": lambda: req.Always(DISC),
    "formulas of which one is a region": lambda: req.Within(DISC) & DISC,
    "window of one waypoint": lambda: req.Eventually(req.Within(DISC), 2),
    "radii of a formula": lambda: req.Within(DISC, np.ones(2)),
    "union of text": lambda: req.Union(("a",)),
    "region of one axis": lambda: generate(req.outside(req.Disc((1.0,), 0.5))),
    "region in space": lambda: generate(req.outside(req.Box(np.zeros(3), np.ones(3)))),
    "numbers of NumPy": lambda: req.apart(
        distance=np.float32(0.3), buffer=np.float32(0.1), layout=req.trajectories(np.int64(2))
    ),
    "a good call": lambda: dg.certify(generate(z0=Z64 + np.eye(3, 2)), GUIDANCE),
}


def outcome(call):
    try:
        call()
    except (TypeError, ValueError) as error:
        return [type(error).__name__, str(error)]
    return None


if __name__ == "__main__":
    # Each call here has other arguments, so that nothing is gained by compiling it.
    warnings.filterwarnings("ignore", "`generate(_batch)?` was called", UserWarning)
    print(json.dumps({name: outcome(call) for name, call in CASES.items()}))
