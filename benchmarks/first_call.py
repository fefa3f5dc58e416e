"""What a user waits for first: the first `generate` of a small problem, and the first `certify` after it.

Both compile a program, in a process of its own and without a cache. Run: python benchmarks/first_call.py [--runs 3]
"""

import argparse
import statistics
import subprocess
import sys

PROGRAM = """
import time
import jax, jax.numpy as jnp
from deggflow import DecoupledGuidance, PrivateRequirement, certify, distances, generate, safe_norm

def field(tau, z, condition):
    return (condition["targets"] - z) / (1.5 - tau)

def margins(z, condition):
    outside = safe_norm(z - condition["disk"][None]) - 0.6
    return jnp.concatenate([distances(z) - 0.5, outside[:, None]], axis=1)

angle = jnp.linspace(0.0, 1.2, 5)
targets = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
condition = {"targets": targets, "disk": jnp.array([1.0, 0.0])}
guidance = DecoupledGuidance((PrivateRequirement(margins, buffer=0.02, name="apart"),))
z0 = jax.random.normal(jax.random.key(2), (5, 2))
times = [time.perf_counter()]
sample = jax.block_until_ready(jax.jit(lambda z: generate(field, guidance, z, condition))(z0))
times.append(time.perf_counter())
for _ in range(2):
    certify(sample, guidance, condition)
    times.append(time.perf_counter())
print(*(after - before for before, after in zip(times, times[1:])))
"""


def main() -> None:
    """Prints medians over processes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    rows = []
    for _ in range(runs):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
        )
        rows.append([float(each) for each in done.stdout.split()])
    generate, first, again = (statistics.median(column) for column in zip(*rows, strict=True))
    ratio = statistics.median(row[1] / row[0] for row in rows)
    print(
        f"first generate {generate:.2f} s, first certify {first:.2f} s, later {1e3 * again:.1f} ms"
    )
    print(f"first certify / first generate: {ratio:.2f} (median of {runs} processes)")


if __name__ == "__main__":
    main()
