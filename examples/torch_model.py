"""Trains a small PyTorch model and guides it: three relays around a fire are linked by a cable of limited length.

Run `pip install 'deggflow[torch]'`, then `python examples/torch_model.py`. The model learns where the relays usually
stand, in a triangle of a given size. It does not know the cable, whose length is a requirement during generation.
"""

import jax
import jax.numpy as jnp
import torch

from deggflow import SharedFactor, SharedRequirements, TighteningBound, safe_norm, sample
from deggflow.field.torch import TorchField

RELAYS = 3
BUFFER = 0.02  # fraction of the cable kept free, which absorbs discretisation errors


class Velocity(torch.nn.Module):
    """An MLP of joint states with the convention of facebookresearch/flow_matching: `forward(x, t, **extras)`."""

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.net = torch.nn.Sequential(
            torch.nn.Linear(2 * RELAYS + 2, width),
            torch.nn.SiLU(),
            torch.nn.Linear(width, width),
            torch.nn.SiLU(),
            torch.nn.Linear(width, 2 * RELAYS),
        )

    def forward(self, x: torch.Tensor, t: torch.Tensor, size: torch.Tensor) -> torch.Tensor:
        """Velocity of shape (samples, 6)."""
        return self.net(torch.cat([x, t[:, None], size[:, None]], dim=1))


def triangles(size: torch.Tensor, random: torch.Generator) -> torch.Tensor:
    """Training data: randomly rotated triangles, with some noise in each corner's distance from the centre."""
    samples = len(size)
    turn = 2 * torch.pi * (torch.rand(samples, 1, generator=random) + torch.arange(RELAYS) / RELAYS)
    radius = size[:, None] * (1 + 0.15 * torch.randn(samples, RELAYS, generator=random))
    return torch.stack([radius * turn.cos(), radius * turn.sin()], dim=-1).flatten(1)


def train(steps: int = 800, batch: int = 256, seed: int = 0) -> Velocity:
    """Conditional flow matching on straight paths."""
    torch.manual_seed(seed)
    random = torch.Generator().manual_seed(seed)
    model = Velocity()
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    for _ in range(steps):
        size = 0.5 + torch.rand(batch, generator=random)
        x1 = triangles(size, random)
        x0 = torch.randn(x1.shape, generator=random)
        t = torch.rand(batch, generator=random)
        x = (1 - t[:, None]) * x0 + t[:, None] * x1
        loss = (model(x, t, size) - (x1 - x0)).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return model.eval()


def length(z):
    """Length of a closed cable through all relays."""
    return jnp.sum(safe_norm(z - jnp.roll(z, 1, axis=0)))


def too_long(tau, z, condition):
    """q: the missing length of the cable, as a fraction of its length; positive if it is too short."""
    return length(z) / condition["cable"] - 1


def main(samples: int = 200, steps: int = 800) -> None:
    """Prints how many samples satisfy the cable's length, nominal and guided, from the same initial states."""
    torch.set_num_threads(1)  # a network this small is slower on several threads
    field = TorchField(train(steps), extras=lambda c: {"size": c["size"]}, flat=True)
    factor = SharedFactor(too_long, TighteningBound(least=0.0), buffer=BUFFER, name="cable")
    cable = SharedRequirements((factor,))
    sizes = jnp.linspace(0.6, 1.4, samples)
    conditions = {"size": sizes, "cable": 5.0 * sizes}  # the triangle needs 5.2 times its size
    for name, guided in (("nominal", False), ("guided", True)):
        result = sample(
            field, (cable,), key=jax.random.key(0), count=samples, shape=(RELAYS, 2),
            conditions=conditions, guided=guided,
        )  # fmt: skip
        print(f"{name:8} {result.satisfied.sum()} of {samples} within the cable")
    tightest = min(result.certificates, key=lambda each: each.min_margin)
    print(tightest.table())


if __name__ == "__main__":
    main()
