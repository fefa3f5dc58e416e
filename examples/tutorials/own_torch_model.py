"""
# A PyTorch model of your own

A trained `torch.nn.Module` is guided as it is, with requirements written in PyTorch, and without a line of JAX. Install
`deggflow[torch]`.
"""

# %%
import torch

from deggflow import PrivateRequirement, SharedFactor, SharedRequirements, TighteningBound
from deggflow.torch import TorchMargins, TorchValue, sample

torch.manual_seed(0)
torch.set_num_threads(1)  # a small network is slower on several threads

# %%
# ## A model, trained by conditional flow matching
#
# Three agents stand on a circle around the origin, turned at random. The module is called as `model(x, t)` with x of
# shape (samples, agents, dim) and t of shape (samples,), the convention of facebookresearch/flow_matching. Other
# conventions: wrap the module in a [`TorchField`](../foreign.md).


class Velocity(torch.nn.Module):
    def __init__(self, width=64):
        super().__init__()
        sizes = [(7, width), (width, width), (width, 6)]
        layers = [torch.nn.Linear(*size) for size in sizes]
        self.net = torch.nn.Sequential(
            layers[0], torch.nn.SiLU(), layers[1], torch.nn.SiLU(), layers[2]
        )

    def forward(self, x, t):
        return self.net(torch.cat([x.flatten(1), t[:, None]], dim=1)).view_as(x)


def circles(count):
    turn = 2 * torch.pi * (torch.rand(count, 1) + torch.arange(3) / 3)
    radius = 1 + 0.1 * torch.randn(count, 3)
    return torch.stack([radius * turn.cos(), radius * turn.sin()], dim=-1)


model = Velocity()
optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
for _ in range(300):
    x1 = circles(256)
    x0, t = torch.randn_like(x1), torch.rand(256)
    x = torch.lerp(x0, x1, t[:, None, None])
    loss = (model(x, t) - (x1 - x0)).square().mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
model.eval()
print(f"loss {loss.item():.2f}")

# %%
# ## Requirements in PyTorch
#
# Functions receive a batch: z of shape (samples, agents, dim), and the condition's tensors with a leading axis of samples.
# Margins have shape (samples, agents, margins), `>= 0` where they hold. A shared factor has one number for each sample,
# at most zero in the end. Gradients come from autograd.
#
# Here every agent keeps out of a disc at (1, 0), and the three together stay within a cable of limited length. The model
# knows nothing of either. (`z.norm()` has no gradient at zero; add a tiny number inside the root where that can happen.)


def clearance(z, condition):
    centre = torch.tensor([1.0, 0.0], dtype=z.dtype)
    return (z - centre).norm(dim=2, keepdim=True) - condition["radius"][:, None, None]


def cable(t, z, condition):
    length = (z - z.roll(1, dims=1)).square().sum(dim=2).add(1e-12).sqrt().sum(dim=1)
    return length / condition["cable"] - 1


outside = PrivateRequirement(TorchMargins(clearance), buffer=0.02, name="outside")
factor = SharedFactor(TorchValue(cable), TighteningBound(least=0.0), buffer=0.02, name="cable")
requirements = (outside, SharedRequirements((factor,)))

# %%
# ## Tensors in, tensors out

condition = {"radius": torch.tensor(0.5), "cable": torch.tensor(5.0)}
result = sample(model, requirements, condition, seed=0, count=64, shape=(3, 2))
print(result)
print(result.z.shape, result.z.dtype)
print(result.certificates[0].table())

# %%
# ## Traps
#
# - *float64.* Verdicts are made in float64. Functions receive float64 then, and must compute in the type of z: constants
#   need `dtype=z.dtype`. The module itself is called in the type of its own weights.
# - *Devices.* JAX must compute on the CPU (`JAX_PLATFORMS=cpu`). The module may be on a GPU, at the cost of two transfers
#   for each call; functions of requirements receive tensors on the CPU.
# - *Threads.* PyTorch and XLA share the cores. For a small network, `torch.set_num_threads(1)` may be several times as
#   fast.
# - *Mode.* A module in training mode raises an error; call `eval()` first.
# - *Speed.* Requirements in PyTorch cost a call at each point that guidance evaluates. The
#   [named requirements](requirements.md) are compiled, and can be mixed with your own.
