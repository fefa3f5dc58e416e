"""One agent as a process: reads where the others are, prints a line for every round, and at the end what it has.

python one_agent.py TRANSPORT NUMBER SEED DEADLINE ADDRESS...
"""

import hashlib
import json
import sys

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import DecoupledGuidance, PrivateRequirement, distances, refined_grid
from deggflow.runtime import TeamError, TeamProgram, Timing, UdpTransport, ZenohTransport, run_agent


def field(tau, z, condition):
    return 2.0 * (0.3 * jnp.roll(z, 1, axis=0) - z)


APART = PrivateRequirement(lambda z, condition: distances(z) - 0.5, 0.05, name="apart")
GUIDANCE = DecoupledGuidance((APART,))


def say(**values):
    print(json.dumps(values), flush=True)


def main():
    kind, number, seed, deadline, *addresses = sys.argv[1:]
    agents = len(addresses)
    z0 = np.random.default_rng(int(seed)).normal(size=(agents, 2)).astype(np.float32)
    program = TeamProgram(field, GUIDANCE, grid=refined_grid(200))
    start = program.start(z0)
    if kind == "udp":
        pairs = [address.split(":") for address in addresses]
        transport = UdpTransport(int(number), [(host, int(port)) for host, port in pairs])
    else:
        transport = ZenohTransport(int(number), addresses, prefix=f"test/{seed}")
    try:
        result = run_agent(
            program, int(number), start, transport, faults=(agents - 1) // 2,
            timing=Timing(deadline=float(deadline), join=600.0),
            on_round=lambda one: say(**one._asdict()),
        )  # fmt: skip
    except TeamError as error:
        say(error=f"{type(error).__name__}: {error}")
        sys.exit(3)
    finally:
        transport.close()
    digest = hashlib.sha256()
    for leaf in jax.tree.leaves(result):
        digest.update(np.asarray(leaf).tobytes())
    certificate = result.certify(GUIDANCE)
    say(
        digest=digest.hexdigest(), satisfied=certificate.satisfied,
        stops=[str(stop) for stop in result.stops], z=result.generation.z.tolist(),
        lost=[each.agent for each in certificate.generation.lost],
    )  # fmt: skip


if __name__ == "__main__":
    main()
