"""Wrong wirings: each has to raise an error of the library's own."""

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
    Trajectory,
    certify,
    certify_batch,
    distances,
    generate,
    generate_batch,
    sample,
)

WRONG = (TypeError, ValueError)


def pull(tau, z, condition):
    """To the origin."""
    return -z


def far(z, condition):
    """Right margins."""
    return distances(z) - condition["least"]


def middle(tau, z, condition):
    """A right value."""
    return jnp.mean(z[:, 0]) - condition["least"]


def apart(margins=far, **options):
    """A private requirement."""
    return PrivateRequirement(margins, **({"buffer": 0.02} | options))


def factor(value=middle, **options):
    """A shared requirement."""
    return SharedRequirements((SharedFactor(value, **options),))


def make(requirement, z0, condition, moves=pull, **options):
    """A short generation, in a compiled program."""
    guidance = DecoupledGuidance((requirement,))
    options = {"grid": np.linspace(0, 1, 6)} | options
    return jax.jit(lambda z0, c: generate(moves, guidance, z0, c, **options))(z0, condition)


def by_grid(grid):
    """A grid whose values a compiled program does not know; `certify` has to look at it."""

    def call(z0, condition, rng):
        guidance = DecoupledGuidance((apart(),))
        run = jax.jit(lambda z0, c, grid: generate(pull, guidance, z0, c, grid=grid))
        certify(run(z0, condition, grid(rng)), guidance, condition)

    return call


def at_once(grid):
    """A grid that `generate` sees."""
    return lambda z0, condition, rng: generate(
        pull, DecoupledGuidance((apart(),)), z0, condition, grid=grid(rng)
    )


def reversed_grid(rng):
    """From 1 to 0."""
    return np.linspace(1.0, 0.0, int(rng.integers(3, 30)))


def early_grid(rng):
    """Ends too early."""
    return np.linspace(0.0, rng.choice([0.02, 0.5, 0.999]), int(rng.integers(3, 30)))


def late_grid(rng):
    """Begins too late."""
    return np.linspace(rng.choice([0.01, 0.5]), 1.0, int(rng.integers(3, 30)))


def shuffled_grid(rng):
    """Two points inside exchanged."""
    grid = np.linspace(0.0, 1.0, int(rng.integers(6, 30)))
    k = int(rng.integers(1, len(grid) - 2))
    grid[[k, k + 1]] = grid[[k + 1, k]]
    return grid


def beyond_grid(rng):
    """Past 1 and back."""
    return np.array([0.0, 0.5, 1.5, 1.0])


def standing_grid(rng):
    """A point twice."""
    return np.array([0.0, 0.3, 0.3, 1.0])


GRIDS = (reversed_grid, early_grid, late_grid, shuffled_grid, beyond_grid)


def made_by(requirement, **options):
    """Generating under a requirement is refused."""
    return lambda z0, condition, rng: make(requirement, z0, condition, **options)


def asked_by(requirement):
    """Certifying a nominal sample by a requirement is refused."""

    def call(z0, condition, rng):
        steps = np.linspace(0, 1, 6)
        made = jax.jit(lambda z: generate(pull, NoGuidance(), z, condition, grid=steps))(z0)
        certify(made, (requirement,), condition)

    return call


def of_batch(call):
    """`call(made, guidance, condition, condition of a batch)` of a batch is refused."""

    def outer(z0, condition, rng):
        guidance = DecoupledGuidance((apart(),))
        many = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (3, *jnp.shape(leaf))), condition)
        z0, steps = jnp.stack([z0] * 3), np.linspace(0, 1, 6)
        made = jax.jit(lambda z, c: generate_batch(pull, guidance, z, c, grid=steps))(z0, many)
        call(made, guidance, condition, many)

    return outer


def padded(requirement):
    """A padded team, and a requirement that forgets the mask: every absent agent counts."""

    def call(z0, condition, rng):
        mask = np.arange(len(z0)) < rng.integers(1, len(z0))
        made = make(requirement, z0, condition, mask=mask)
        certify(made, (requirement,), condition, mask=mask)

    return call


def rounded(z, condition):
    """Margins in half of the precision that is asked for."""
    return (distances(z) - 0.1).astype(jnp.float32)


def trajectory(change):
    """A trajectory of wrong shape or tau."""

    def call(z0, condition, rng):
        tau = np.linspace(0.0, 1.0, 9)
        z = np.broadcast_to(np.asarray(z0, np.float64), (9, *z0.shape))
        certify(Trajectory(*change(tau, z, rng)), (apart(),), condition)

    return call


def of_sample(**options):
    """`sample` refuses these arguments."""

    def call(z0, condition, rng):
        given = {"key": jax.random.key(0), "count": 2, "shape": (3, 2), "condition": condition}
        sample(pull, (apart(),), **(given | options))

    return call


WIRINGS = {
    "boolean margins": made_by(apart(lambda z, c: far(z, c) >= 0)),
    "integer margins": made_by(apart(lambda z, c: jnp.round(far(z, c)).astype(int))),
    "boolean margins, certified": asked_by(apart(lambda z, c: far(z, c) >= 0)),
    "integer margins, certified": asked_by(apart(lambda z, c: jnp.sign(far(z, c)).astype(int))),
    "margins of shape (agents,)": made_by(apart(lambda z, c: jnp.sum(z**2, axis=1))),
    "margins of shape ()": made_by(apart(lambda z, c: jnp.sum(z))),
    "transposed margins": made_by(apart(lambda z, c: z.T)),
    "margins of one agent": asked_by(apart(lambda z, c: far(z, c)[:1])),
    "no margins": made_by(apart(lambda z, c: far(z, c)[:, :0])),
    "margins of shape (agents,), certified": asked_by(apart(lambda z, c: jnp.min(far(z, c), axis=1))),
    "rounded margins": asked_by(apart(rounded)),
    "half margins": asked_by(apart(lambda z, c: far(z, c).astype(jnp.float16))),
    "rounded value": asked_by(factor(lambda t, z, c: middle(t, z, c).astype(jnp.float32))),
    "boolean value": made_by(factor(lambda t, z, c: middle(t, z, c) <= 0)),
    "a value for each agent": made_by(factor(lambda t, z, c: z[:, 0])),
    "a value of shape (1,)": made_by(factor(lambda t, z, c: middle(t, z, c)[None])),
    "a Python number as value": made_by(factor(lambda t, z, c: 0.0)),
    "integer value, certified": asked_by(factor(lambda t, z, c: jnp.sum(z > 0))),
    "one requirement, no tuple": lambda z0, c, rng: DecoupledGuidance(apart()),
    "no requirements": lambda z0, c, rng: DecoupledGuidance(()),
    "two of one name": lambda z0, c, rng: DecoupledGuidance((apart(), apart())),
    "two factors of one name": lambda z0, c, rng: DecoupledGuidance(
        (SharedRequirements((SharedFactor(middle), SharedFactor(middle))),)
    ),
    "certify by one requirement": lambda z0, c, rng: certify(make(apart(), z0, c), apart(), c),
    "certify a batch": of_batch(lambda made, guidance, c, many: certify(made, guidance, c)),
    "certify a batch, many conditions": of_batch(lambda made, g, c, many: certify(made, g, many)),
    "certify_batch, one condition": of_batch(lambda made, g, c, many: certify_batch(made, g, c)),
    "certify_batch of one": lambda z0, c, rng: certify_batch(make(apart(), z0, c), (apart(),), c),
    "certify something else": lambda z0, c, rng: certify(z0, (apart(),), c),
    "one condition in a batch": lambda z0, c, rng: generate_batch(
        pull, DecoupledGuidance((apart(),)), jnp.stack([z0] * 2), c
    ),
    "integer z0": lambda z0, c, rng: make(apart(), np.round(np.asarray(z0)).astype(int), c),
    "z0 of one agent": lambda z0, c, rng: make(apart(), z0[0], c),
    "a batch in generate": lambda z0, c, rng: make(apart(), jnp.stack([z0] * 2), c),
    "one sample in generate_batch": lambda z0, c, rng: generate_batch(
        pull, NoGuidance(), z0, {"least": jnp.ones(3)}
    ),
    "field of shape (2,)": made_by(apart(), moves=lambda tau, z, c: jnp.zeros(2)),
    "field of shape ()": made_by(apart(), moves=lambda tau, z, c: jnp.zeros(())),
    "field that is transposed": made_by(apart(), moves=lambda tau, z, c: z.T),
    "field of integers": made_by(apart(), moves=lambda tau, z, c: jnp.zeros(z.shape, int)),
    "field that is a number": made_by(apart(), moves=lambda tau, z, c: 0.0),
    "mask of integers": lambda z0, c, rng: make(apart(), z0, c, mask=np.ones(len(z0), int)),
    "mask of wrong length": lambda z0, c, rng: make(apart(), z0, c, mask=np.ones(9, bool)),
    "certify, mask of wrong length": lambda z0, c, rng: certify(
        make(apart(), z0, c), (apart(),), c, mask=np.ones(9, bool)
    ),
    "certify, nobody present": lambda z0, c, rng: certify(
        make(apart(), z0, c), (apart(),), c, mask=np.zeros(len(z0), bool)
    ),
    "margins forget the mask": padded(apart()),
    "value forgets the mask": padded(factor()),
    "trajectory of one point": trajectory(lambda tau, z, rng: (tau[:1], z[:1])),
    "trajectory that ends early": trajectory(lambda tau, z, rng: (tau * 0.7, z)),
    "trajectory backwards": trajectory(lambda tau, z, rng: (tau[::-1].copy(), z)),
    "trajectory that stands": trajectory(lambda tau, z, rng: (np.sort(np.r_[tau[:8], tau[3]]), z)),
    "trajectory, tau too short": trajectory(lambda tau, z, rng: (tau[:5], z)),
    "trajectory of one sample": trajectory(lambda tau, z, rng: (tau, z[:, 0])),
    "trajectory of NaN times": trajectory(lambda tau, z, rng: (np.where(tau == 0.5, np.nan, tau), z)),
    "trajectory of booleans": trajectory(lambda tau, z, rng: (tau, z > 0)),
    "sample, count 0": of_sample(count=0),
    "sample, shape (3,)": of_sample(shape=(3,)),
    "sample, conditions too short": of_sample(condition=None, conditions={"least": np.ones(5)}),
    "sample, two conditions": of_sample(conditions={"least": np.ones(2)}),
    "sample, wrong mask": of_sample(mask=np.ones(4, bool)),
    "sample, one requirement": lambda z0, c, rng: sample(
        pull, apart(), c, key=jax.random.key(0), count=2, shape=(3, 2)
    ),
    "negative buffer": lambda z0, c, rng: apart(buffer=-0.1),
    "infinite buffer": lambda z0, c, rng: apart(buffer=float("inf")),
    "margins that are no function": lambda z0, c, rng: apart(3.0),
    "an end that is a number": lambda z0, c, rng: TighteningBound(end=0.0),  # type: ignore[arg-type]
    "negative slack": lambda z0, c, rng: TighteningBound(slack=-0.1),
    "kappa below 1": lambda z0, c, rng: apart(kappa=0.5),
    "rho of 1": lambda z0, c, rng: apart(rho=1.0),
    **{f"{grid.__name__}, known": at_once(grid) for grid in (*GRIDS, standing_grid)},
    **{f"{grid.__name__}, compiled": by_grid(grid) for grid in (*GRIDS, standing_grid)},
}  # fmt: skip


def play_wirings(case, tally, also=()):
    """Each wiring once, with states of its own; `also`: errors of type checkers that stand before the library."""
    for number, (name, call) in enumerate(WIRINGS.items()):
        rng = case.rng(number)
        z0 = jnp.asarray(rng.normal(size=(3, 2)), jnp.float32)
        condition = {"least": jnp.asarray(rng.uniform(0.1, 0.5), jnp.float32)}
        try:
            call(z0, condition, rng)
        except (*WRONG, *also) as error:
            message = str(error).strip()
            # JAX's own complaints of shapes are no answer to a user.
            if not message or ("`" not in message and "'" not in message):
                tally.note("errors that do not say what", case=case, wiring=name, said=message[:90])
            tally.add("errors raised")
        except Exception as error:
            kind = f"{type(error).__name__}: {str(error)[:90]}"
            tally.note("errors missing", case=case, wiring=name, instead=kind)
        else:
            tally.note("errors missing", case=case, wiring=name, instead="nothing")
