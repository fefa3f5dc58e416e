"""Guided sampling of tabletop scenes as a script in plain PyTorch: what one would write from the paper, without this library.

A loop over the steps in Python, everything else over the batch; autograd for the gradient of the violations. The
network and its weights are the shipped ones.
"""

from typing import NamedTuple

import numpy as np
import torch

BUFFER = 0.02  # m, delta of the hinge
ANGLE_SCALE = 1.35  # rad per unit of z
RHO, KAPPA = 0.75, 1.15
OMEGA_START, OMEGA_SLOPE = 0.1, 1.8
ABSENT = 1e3  # m, margin of what doesn't exist


class Parts(NamedTuple):
    """Rounded boxes fixed to objects, of shape (scenes, parts)."""

    x: torch.Tensor  # m, in the owner's frame
    y: torch.Tensor
    half_x: torch.Tensor  # m, of the core
    half_y: torch.Tensor
    radius: torch.Tensor
    valid: torch.Tensor
    owner: torch.Tensor


class Scenes(NamedTuple):
    """What scenes are asked to be."""

    objects: Parts
    regions: Parts  # to be kept free
    half: torch.Tensor  # m, (scenes, 2): half the table


class Placed(NamedTuple):
    """Rounded boxes in the world, of shape (scenes, parts)."""

    x: torch.Tensor
    y: torch.Tensor
    cos: torch.Tensor
    sin: torch.Tensor
    half_x: torch.Tensor
    half_y: torch.Tensor
    radius: torch.Tensor


def scenes_of(condition) -> Scenes:
    """From the arrays that the library reads, a stack of scenes."""

    def tensor(array):
        return torch.from_numpy(np.array(array))

    def parts(given):
        fields = [tensor(getattr(given, name)) for name in Parts._fields]
        return Parts(*fields[:-1], fields[-1].long())

    half = torch.stack([tensor(condition.half_width), tensor(condition.half_depth)], dim=-1)
    return Scenes(parts(condition.primitives), parts(condition.regions), half)


def place(parts: Parts, z: torch.Tensor, half: torch.Tensor) -> Placed:
    """Parts at their owners' poses."""
    pose = z * torch.cat([half, torch.full_like(half[:, :1], ANGLE_SCALE)], dim=1)[:, None]
    x, y, theta = (pose[..., k].gather(1, parts.owner) for k in range(3))
    cos, sin = theta.cos(), theta.sin()
    return Placed(
        x + cos * parts.x - sin * parts.y,
        y + sin * parts.x + cos * parts.y,
        cos,
        sin,
        parts.half_x,
        parts.half_y,
        parts.radius,
    )


def pairs(a: Placed, b: Placed) -> tuple[Placed, Placed]:
    """All of a against all of b, by broadcasting."""
    return Placed(*(field[:, :, None] for field in a)), Placed(*(field[:, None] for field in b))


def length(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    """Euclidean, with a gradient of zero at zero."""
    square = x**2 + y**2
    return torch.where(square > 0, torch.where(square > 0, square, 1.0).sqrt(), 0.0)


def point_distance(region: Placed, box: Placed) -> torch.Tensor:
    """Signed distance of a disk's centre to a box, in m."""
    dx, dy = region.x - box.x, region.y - box.y
    gap_x = (box.cos * dx + box.sin * dy).abs() - box.half_x
    gap_y = (box.cos * dy - box.sin * dx).abs() - box.half_y
    outside = length(gap_x.clamp(min=0), gap_y.clamp(min=0))
    return outside + torch.maximum(gap_x, gap_y).clamp(max=0) - box.radius


def one_way(a: Placed, b: Placed) -> tuple[torch.Tensor, torch.Tensor]:
    """Least squared distance of b's vertices to a, and the gap along a's axes."""
    dx, dy = b.x - a.x, b.y - a.y
    u, v = a.cos * dx + a.sin * dy, a.cos * dy - a.sin * dx
    cos, sin = a.cos * b.cos + a.sin * b.sin, a.cos * b.sin - a.sin * b.cos
    squares = []
    for side_x in (1, -1):
        for side_y in (1, -1):
            along = u + side_x * b.half_x * cos - side_y * b.half_y * sin
            across = v + side_x * b.half_x * sin + side_y * b.half_y * cos
            out_x = (along.abs() - a.half_x).clamp(min=0)
            out_y = (across.abs() - a.half_y).clamp(min=0)
            squares.append(out_x**2 + out_y**2)
    gap_x = u.abs() - a.half_x - (b.half_x * cos).abs() - (b.half_y * sin).abs()
    gap_y = v.abs() - a.half_y - (b.half_x * sin).abs() - (b.half_y * cos).abs()
    return torch.stack(squares).amin(dim=0), torch.maximum(gap_x, gap_y)


def box_distance(a: Placed, b: Placed) -> torch.Tensor:
    """Signed distance of boxes, in m: exact where they are apart, else the depth along the best axis."""
    (near_a, gap_a), (near_b, gap_b) = one_way(a, b), one_way(b, a)
    near, gap = torch.minimum(near_a, near_b), torch.maximum(gap_a, gap_b)
    apart = (gap > 0) & (near > 0)
    outside = torch.where(apart, near, 1.0).sqrt()
    return torch.where(apart, outside, gap.clamp(max=0)) - a.radius - b.radius


def walls(box: Placed, half: torch.Tensor) -> torch.Tensor:
    """How far boxes stay inside the table, of shape (scenes, parts, 2), in m."""
    cos, sin = box.cos.abs(), box.sin.abs()
    x = half[:, :1] - box.x.abs() - box.half_x * cos - box.half_y * sin - box.radius
    y = half[:, 1:] - box.y.abs() - box.half_x * sin - box.half_y * cos - box.radius
    return torch.stack([x, y], dim=-1)


def violations(z: torch.Tensor, scenes: Scenes) -> torch.Tensor:
    """V_i of every object, (scenes, agents): half the squared hinges of its margins."""
    objects, regions = scenes.objects, scenes.regions
    boxes, disks = place(objects, z, scenes.half), place(regions, z, scenes.half)
    disk, box = pairs(disks, boxes)
    free = point_distance(disk, box) - disk.radius
    amounts = 0.0
    for parts, between, inside in (
        (objects, box_distance(*pairs(boxes, boxes)), walls(boxes, scenes.half)),
        (regions, free, walls(disks, scenes.half)),
    ):
        counts = parts.owner[:, :, None] != objects.owner[:, None]
        counts = counts & parts.valid[:, :, None] & objects.valid[:, None]
        inside = torch.where(parts.valid[..., None], inside, ABSENT)
        margins = torch.cat([torch.where(counts, between, ABSENT), inside], dim=-1)
        each = ((BUFFER - margins).clamp(min=0) ** 2).sum(dim=-1) / 2
        amounts = amounts + torch.zeros_like(z[..., 0]).scatter_add(1, parts.owner, each)
    return amounts


def first_gain(z: torch.Tensor, scenes: Scenes) -> torch.Tensor:
    """c, from V(0), for every scene."""
    start = violations(z, scenes).sum(dim=1, keepdim=True).clamp(min=1e-30)
    whole = OMEGA_START + OMEGA_SLOPE / 2  # omega's integral over [0, 1]
    return KAPPA / (1 - RHO) * start ** (1 - RHO) / whole


def correction(z, drift, tau, gain, scenes, pooled):
    """u_i = -ell_i max(b_i, 0) / |ell_i|^2 with b_i = ell_i . f_i + share_i: every object's own input."""
    with torch.enable_grad():
        z = z.detach().requires_grad_()
        each = violations(z, scenes)
        (ell,) = torch.autograd.grad(each.sum(), z)
    omega = OMEGA_START + OMEGA_SLOPE * tau
    owed = gain * omega * each.detach() ** RHO
    square = (ell**2).sum(dim=-1)
    if pooled:
        total = square.sum(dim=1, keepdim=True)
        share = square / torch.where(total > 0, total, 1.0) * owed.sum(dim=1, keepdim=True)
        owed = torch.where(total > 0, share, owed)
    b = (ell * drift).sum(dim=-1) + owed
    size = torch.where(square > 0, b.clamp(min=0) / torch.where(square > 0, square, 1.0), 0.0)
    return -size[..., None] * ell


@torch.no_grad()
def guided(field, given, scenes, z, grid, pooled=True):
    """z(1) from z(0), by Euler steps on a grid of tau.

    Args:
        field: `load_torch_field()`.
        given: Its keyword arguments, `scene_arrays` of the condition as tensors.
        scenes: `scenes_of` the condition.
        z: z(0), (scenes, agents, 3).
        grid: Values of tau.
        pooled: Share the team's demand by what each can do about it; else each object its own (the paper's).
    """
    gain = first_gain(z, scenes)
    for tau, after in zip(grid[:-1].tolist(), grid[1:].tolist(), strict=True):
        drift = field(z, torch.full_like(z[:, 0, 0], tau), **given)
        z = z + (after - tau) * (drift + correction(z, drift, tau, gain, scenes, pooled))
    return z
