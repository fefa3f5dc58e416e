"""Prints XLA flags under which tests compile in a third of the time, of those that this XLA knows: it aborts on others."""

import os
import subprocess
import sys

FLAGS = (
    "--xla_backend_optimization_level=0",
    "--xla_llvm_disable_expensive_passes=true",
    "--xla_cpu_parallel_codegen_split_count=1",
    "--xla_cpu_use_fusion_emitters=false",  # not of JAX 0.12
)


def known(flags: tuple[str, ...]) -> bool:
    """Whether a process starts with these flags."""
    environment = {**os.environ, "XLA_FLAGS": " ".join(flags)}
    command = [sys.executable, "-c", "import jax; jax.devices()"]
    return subprocess.run(command, env=environment, capture_output=True).returncode == 0


if __name__ == "__main__":
    print(*(FLAGS if known(FLAGS) else [flag for flag in FLAGS if known((flag,))]))
