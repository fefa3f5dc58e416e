"""Guided sampling of tabletop scenes as a script in plain PyTorch: what one would write from the paper, without this library.

A loop over the steps in Python, everything else over the batch; autograd for the gradient of the violations. The
network and its weights are the shipped ones.
"""

from typing import NamedTuple

import numpy as np
import torch

BUFFER = 0.02  # m, delta of the hinge
CAUGHT = 0.03  # m, of the weight of V of a caught obstacle
DIAGONAL = 0.5**0.5
ANGLE_SCALE = 1.35  # rad per unit of z
RHO, KAPPA = 0.75, 1.15
OMEGA_START, OMEGA_SLOPE = 0.1, 1.8


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
    strips: Parts  # from each region's owner outward over all of its regions
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
    named = condition.primitives, condition.regions, condition.strips
    return Scenes(*(parts(each) for each in named), half)


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


def corners(box: Placed, cos: torch.Tensor, sin: torch.Tensor):
    """From the centre of a box with this heading to its corners, m."""
    for side_x in (1, -1):
        for side_y in (1, -1):
            x = side_x * box.half_x * cos - side_y * box.half_y * sin
            yield x, side_x * box.half_x * sin + side_y * box.half_y * cos


def hinge(amount: torch.Tensor) -> torch.Tensor:
    """Squared, where positive."""
    return amount.clamp(min=0) ** 2


def one_way(a: Placed, b: Placed, reach: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared hinges of b's corners near a, and along the better of a's axes."""
    dx, dy = b.x - a.x, b.y - a.y
    u, v = a.cos * dx + a.sin * dy, a.cos * dy - a.sin * dx
    cos, sin = a.cos * b.cos + a.sin * b.sin, a.cos * b.sin - a.sin * b.cos
    near, along, across = 0.0, 0.0, 0.0
    for x, y in corners(b, cos, sin):
        out_x = ((u + x).abs() - a.half_x).clamp(min=0)
        out_y = ((v + y).abs() - a.half_y).clamp(min=0)
        near = near + hinge(reach - (out_x**2 + out_y**2).clamp(min=1e-12).sqrt())
        along = along + hinge(DIAGONAL * reach + a.half_x - u.abs() - x)
        across = across + hinge(DIAGONAL * reach + a.half_y - v.abs() - y)
    return near, torch.minimum(along, across)


def between_boxes(a: Placed, b: Placed) -> torch.Tensor:
    """V of two boxes: sums over corners, and where they overlap over the best axis; a point is one corner."""
    reach = a.radius + b.radius + BUFFER
    (near_a, along_a), (near_b, along_b) = one_way(a, b, reach), one_way(b, a, reach)
    dot_a, dot_b = ((box.half_x <= 0) & (box.half_y <= 0) for box in (a, b))
    near = torch.where(dot_a, near_b / 4, near_a + near_b)
    along = torch.where(dot_a, along_b / 4, torch.minimum(along_a, along_b))
    along = torch.where(dot_b, along_a / 4, along)
    return torch.where(dot_b, near_a / 4, near) / 2 + torch.where(dot_a & dot_b, 0.0, along)


def caught(strip: Placed, box: Placed, blocked: torch.Tensor) -> torch.Tensor:
    """V of a box between an object and its regions: off their strip at its end or to one side, whichever is nearer."""
    dx, dy = box.x - strip.x, box.y - strip.y
    u, v = strip.cos * dx + strip.sin * dy, strip.cos * dy - strip.sin * dx
    reach = strip.radius + box.radius + BUFFER
    cos, sin = strip.cos * box.cos + strip.sin * box.sin, strip.cos * box.sin - strip.sin * box.cos
    beyond, aside = 0.0, 0.0
    for x, y in corners(box, cos, sin):
        beyond = beyond + hinge(reach - u - x)
        aside = aside + hinge(reach + strip.half_y - v.abs() - y)
    return blocked / (blocked + CAUGHT**2) * torch.minimum(beyond, aside) / 8


def outward(parts: Parts, placed: Placed) -> Placed:
    """Heading from the owner to the strip's middle."""
    away = torch.where(parts.valid, (parts.x**2 + parts.y**2).sqrt(), 1.0)
    cos, sin = parts.x / away, parts.y / away
    return placed._replace(
        cos=placed.cos * cos - placed.sin * sin, sin=placed.sin * cos + placed.cos * sin
    )


def at_walls(box: Placed, half: torch.Tensor) -> torch.Tensor:
    """V of parts at the table's edges, of shape (scenes, parts)."""
    total = 0.0
    for x, y in corners(box, box.cos, box.sin):
        total = total + hinge((box.x + x).abs() + box.radius + BUFFER - half[:, :1])
        total = total + hinge((box.y + y).abs() + box.radius + BUFFER - half[:, 1:])
    return total / torch.where((box.half_x <= 0) & (box.half_y <= 0), 8, 2)


def violations(z: torch.Tensor, scenes: Scenes) -> torch.Tensor:
    """V_i of every object, (scenes, agents)."""
    objects, regions = scenes.objects, scenes.regions
    boxes, disks = place(objects, z, scenes.half), place(regions, z, scenes.half)
    disk, box = pairs(disks, boxes)
    free = hinge(BUFFER + disk.radius - point_distance(disk, box)) / 2
    strips = outward(scenes.strips, place(scenes.strips, z, scenes.half))
    free = free + caught(pairs(strips, boxes)[0], box, free)
    amounts = 0.0
    for parts, between, walls in (
        (objects, between_boxes(*pairs(boxes, boxes)), at_walls(boxes, scenes.half)),
        (regions, free, at_walls(disks, scenes.half)),
    ):
        counts = parts.owner[:, :, None] != objects.owner[:, None]
        counts = counts & parts.valid[:, :, None] & objects.valid[:, None]
        each = torch.where(counts, between, 0.0).sum(dim=-1)
        each = each + torch.where(parts.valid, walls, 0.0)
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
