"""The tabletop's field in PyTorch, features included: for users of PyTorch, and for comparison."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from deggflow.field.torch import torch
from deggflow.field.torch_export import TorchMessagePassing, export
from deggflow.files import StrPath

from .codec import ANGLE_SCALE
from .condition import Parts, TabletopCondition
from .field import FAR, NEAR, load_field, relative_pose
from .library import MAX_OBJECTS


class Boxes(NamedTuple):
    """Rounded boxes in the world, one per agent; all fields of shape (samples, agents), or broadcast against each other."""

    x: torch.Tensor  # m, centre
    y: torch.Tensor  # m, centre
    cos: torch.Tensor  # of the heading
    sin: torch.Tensor
    half_x: torch.Tensor  # m, half extents of the core
    half_y: torch.Tensor
    radius: torch.Tensor  # m, by which the core is dilated

    def expand(self, dim: int) -> "Boxes":
        """The same boxes with a new axis of length one."""
        return Boxes(*(field.unsqueeze(dim) for field in self))


class TorchTabletopField(torch.nn.Module):
    """`model(x, t, **scene)` of a batch of scenes, of padded sizes; `scene` is `scene_arrays` of their conditions."""

    def __init__(self, network: TorchMessagePassing) -> None:
        super().__init__()
        self.network = network

    def forward(
        self,
        x: torch.Tensor,
        t: torch.Tensor,
        *,
        mask: torch.Tensor,
        kind: torch.Tensor,
        body: torch.Tensor,
        access: torch.Tensor,
        half: torch.Tensor,
    ) -> torch.Tensor:
        """dz/dtau, of shape (samples, agents, 3)."""
        pose = x * torch.cat([half, torch.full_like(half[:, :1], ANGLE_SCALE)], dim=1)[:, None]
        bodies, regions = _placed(body, pose), _placed(access, pose)
        kinds = torch.nn.functional.one_hot(kind.long(), MAX_OBJECTS).to(x.dtype)
        node = torch.cat([_node_features(bodies, regions, half), kinds], dim=-1)
        return self.network(x, t, node, _pair_features(bodies, regions), mask)


def scene_arrays(condition: TabletopCondition) -> dict[str, Array]:
    """The arrays that the module reads, from the condition of one scene or of a stack."""
    agents = condition.mask.shape[-1]

    def first(parts: Parts) -> Array:
        rows = parts.x, parts.y, parts.half_x, parts.half_y, parts.radius
        return jnp.stack([row[..., :agents] for row in rows], axis=-1)

    return {
        "mask": jnp.asarray(condition.mask),
        "kind": jnp.asarray(condition.kind),
        "body": first(condition.primitives),
        "access": first(condition.access),
        "half": jnp.stack([condition.half_width, condition.half_depth], axis=-1),
    }


def load_torch_field(path: StrPath | None = None) -> TorchTabletopField:
    """A trained field as a PyTorch module in evaluation mode; the shipped one if no path is given."""
    return TorchTabletopField(export(load_field(path))).eval()


def _placed(parts: torch.Tensor, pose: torch.Tensor) -> Boxes:
    """Parts of shape (samples, agents, 5), fixed to the agents' poses, in the world."""
    x, y, half_x, half_y, radius = parts.unbind(-1)
    cos, sin = pose[..., 2].cos(), pose[..., 2].sin()
    return Boxes(
        pose[..., 0] + cos * x - sin * y,
        pose[..., 1] + sin * x + cos * y,
        cos,
        sin,
        half_x,
        half_y,
        radius,
    )


def _graded(gap: torch.Tensor) -> list[torch.Tensor]:
    return [torch.nn.functional.softsign(gap / scale) for scale in (NEAR, FAR)]


def _node_features(bodies: Boxes, regions: Boxes, half: torch.Tensor) -> torch.Tensor:
    """Headings, and the distances to the walls."""
    graded = []
    for box in (bodies, regions):
        cos, sin = box.cos.abs(), box.sin.abs()
        graded += _graded(
            half[:, :1] - box.x.abs() - box.half_x * cos - box.half_y * sin - box.radius
        )
        graded += _graded(
            half[:, 1:] - box.y.abs() - box.half_x * sin - box.half_y * cos - box.radius
        )
    return torch.stack([bodies.cos, bodies.sin, *graded], dim=-1)


def _pair_features(bodies: Boxes, regions: Boxes) -> torch.Tensor:
    """Relative poses and gaps, of shape (samples, receivers, senders, 12)."""
    receiver, sender = bodies.expand(2), bodies.expand(1)
    blocked = _separating_gap(regions.expand(2), sender)
    features = [
        *relative_pose(receiver, sender),
        *_graded(_separating_gap(receiver, sender)),
        *_graded(blocked),
        *_graded(blocked.transpose(1, 2)),
    ]
    return torch.stack(features, dim=-1)


def _separating_gap(a: Boxes, b: Boxes) -> torch.Tensor:
    """Largest gap along the four face normals minus the radii, in m."""
    cos = (a.cos * b.cos + a.sin * b.sin).abs()
    sin = (a.cos * b.sin - a.sin * b.cos).abs()
    dx, dy = b.x - a.x, b.y - a.y
    gaps = [
        (a.cos * dx + a.sin * dy).abs() - a.half_x - b.half_x * cos - b.half_y * sin,
        (a.cos * dy - a.sin * dx).abs() - a.half_y - b.half_x * sin - b.half_y * cos,
        (b.cos * dx + b.sin * dy).abs() - b.half_x - a.half_x * cos - a.half_y * sin,
        (b.cos * dy - b.sin * dx).abs() - b.half_y - a.half_x * sin - a.half_y * cos,
    ]
    return torch.stack(gaps).amax(dim=0) - a.radius - b.radius
