"""The judge: every requirement again, in NumPy and float64, by other formulas. No JAX, no deggflow.

States have shape (samples, points, agents, dim); conditions a leading axis of samples.
"""

import numpy as np
import shapely

from .spec import Private

MIN_VIOLATION, MIN_REMAINING = 1e-30, 0.01


def exact(tree):
    """A condition in float64: its numbers are what both sides are asked about."""
    if isinstance(tree, dict):
        return {name: exact(leaf) for name, leaf in tree.items()}
    leaf = np.asarray(tree)
    return leaf.astype(np.float64) if np.issubdtype(leaf.dtype, np.floating) else leaf


def take(tree, index):
    """Some of the samples."""
    if tree is None:
        return None
    if isinstance(tree, dict):
        return {name: take(leaf, index) for name, leaf in tree.items()}
    return tree[index]


def _plane(z):
    """Waypoints as complex numbers, shape (samples, points, agents, waypoints)."""
    return z[..., 0::2] + 1j * z[..., 1::2]


def _complex(xy):
    return xy[..., 0] + 1j * xy[..., 1]


def _over(leaf):
    """A leaf of shape (samples, k) beside states (samples, points, agents, waypoints, k)."""
    return leaf[:, None, None, None]


def _apart(z, c, mask):
    x, y = z[..., 0::2], z[..., 1::2]
    n = z.shape[2]
    out = []
    for i in range(n):
        row = np.hypot(x - x[:, :, i : i + 1], y - y[:, :, i : i + 1])
        row[:, :, i] = np.inf
        if mask is not None:
            row = np.where((mask & mask[:, i : i + 1])[:, None, :, None], row, np.inf)
        out.append(row.reshape(*row.shape[:2], -1))
    return np.stack(out, axis=2) - c["least"][:, None, None, None]


def _discs(z, c, mask):
    return np.abs(_plane(z)[..., None] - _over(_complex(c["center"]))) - _over(c["radius"])


def _boxes(z, c, mask):
    """By polygons: distance to the boundary, negative inside."""
    low, high = c["center"] - c["half"], c["center"] + c["half"]
    boxes = shapely.box(low[..., 0], low[..., 1], high[..., 0], high[..., 1])
    x, y = z[..., 0::2, None], z[..., 1::2, None]
    fine = np.isfinite(x) & np.isfinite(y)
    points = shapely.points(np.where(fine, x, 0.0), np.where(fine, y, 0.0))
    polygons = _over(boxes)
    away = shapely.distance(points, _over(shapely.boundary(boxes)))
    signed = np.where(shapely.covers(polygons, points), -away, away)
    return np.where(fine, signed, np.nan)


def _planes(z, c, mask):
    x, y = z[..., 0::2, None], z[..., 1::2, None]
    return x * _over(c["normal"][..., 0]) + y * _over(c["normal"][..., 1]) - _over(c["offset"])


def _room(z, c, mask):
    low, high = c["center"] - c["half"], c["center"] + c["half"]
    points = z.reshape(*z.shape[:3], -1, 2)
    return np.minimum(points - _over(low), _over(high) - points)


def _speed(z, c, mask):
    return c["most"][:, None, None, None] - np.abs(np.diff(_plane(z), axis=-1))


def _length(z, c, mask):
    way = sum(np.abs(step) for step in np.moveaxis(np.diff(_plane(z), axis=-1), -1, 0))
    return (c["most"][:, None, None] - way)[..., None]


PIECES = {
    "apart": _apart, "discs": _discs, "boxes": _boxes, "planes": _planes, "room": _room,
    "wall": _boxes, "speed": _speed, "length": _length, "dots": _discs,
}  # fmt: skip


def margins(spec, key, z, condition, mask):
    """Margins h of a private requirement, (samples, points, agents, margins); infinite for absent agents."""
    parts = [PIECES[p](z, condition[key][p], mask) for p in spec.pieces]
    out = np.concatenate([part.reshape(*z.shape[:3], -1) for part in parts], axis=-1)
    return out if mask is None else np.where(mask[:, None, :, None], out, np.inf)


def _mean_point(z, team):
    count = team.sum(axis=1)[:, None]
    inside = np.where(team[:, None, :, None], _plane(z), 0.0)
    return inside.sum(axis=(2, 3)) / (count * inside.shape[3])


def _mean(tau, z, c):
    return np.abs(_mean_point(z, c["team"]) - _complex(c["center"])[:, None]) - c["radius"][:, None]


def _total(tau, z, c):
    away = np.abs(_plane(z) - _complex(c["center"])[:, None, None, None]).mean(axis=3)
    return (away * c["team"][:, None]).sum(axis=2) - c["most"][:, None]


def _spread(tau, z, c):
    """Mean of all squared distances between two agents, halved."""
    p = _plane(z).mean(axis=3)
    both = c["team"][:, None, :, None] & c["team"][:, None, None]
    apart = np.abs(p[..., :, None] - p[..., None, :]) ** 2
    count = c["team"].sum(axis=1)[:, None]
    return np.where(both, apart, 0.0).sum(axis=(2, 3)) / (2 * count**2) - c["most"][:, None]


def _top(tau, z, c):
    x = np.where(c["team"][:, None], z[..., 0], -np.inf)
    sharp = c["sharp"][:, None]
    highest = x.max(axis=2)
    parts = np.exp(sharp[..., None] * (x - highest[..., None])).sum(axis=2)
    return highest + np.log(parts) / sharp - c["most"][:, None]


def _ramp(tau, z, c):
    left = (1 - tau)[None] * c["rise"][:, None]
    return _mean_point(z, c["team"]).real + left - c["most"][:, None]


FACTORS = {"mean": _mean, "total": _total, "spread": _spread, "top": _top, "ramp": _ramp}


def q_of(spec, key, part, tau, z, condition):
    """Value q of a factor, (samples, points)."""
    return FACTORS[spec.kind](tau, z, condition[key][part])


def verdict(problem, z, condition, mask):
    """Least margin of every row of finished samples, (samples, rows); NaN where one is not a number."""
    one, z = np.ones(1), z[:, None]
    rows = []
    with np.errstate(all="ignore"):
        for k, each in enumerate(problem.requirements):
            key = f"r{k}"
            if isinstance(each, Private):
                found = margins(each, key, z, condition, mask)
                rows.append(found.reshape(len(z), -1).min(axis=1))
                continue
            for j, factor in enumerate(each.factors):
                q = q_of(factor, key, f"f{j}", one, z, condition)[:, 0]
                rows.append(condition[key][f"f{j}"]["end"] - q)
    return np.stack(rows, axis=1)


def scale_of(z):
    """Of a sample: 1 and its greatest coordinate, in proportion to which float64 rounds margins."""
    return 1.0 + np.abs(np.where(np.isfinite(z), z, 0.0)).reshape(len(z), -1).max(axis=1)


def hinges(spec, key, z, condition, mask):
    """max(buffer - h, 0), (samples, points, agents, margins)."""
    with np.errstate(all="ignore"):
        return np.maximum(spec.buffer - margins(spec, key, z, condition, mask), 0.0)


def remaining(omega, tau):
    """Integral of omega from tau to 1."""
    kind, one, two = omega
    if kind == "linear":
        return one * (1 - tau) + two * (1 - tau**2) / 2
    return 1 - tau ** (one + 1)


def weight(omega, tau):
    """omega(tau)."""
    kind, one, two = omega
    return one + two * tau if kind == "linear" else (one + 1) * tau**one


def decay(spec, tau, kappa, blur):
    """What is left of V(0) at tau by the theorem; `blur` is added to the integral that remains."""
    left = np.minimum((remaining(spec.omega, tau) + blur) / remaining(spec.omega, 0.0), 1.0)
    if spec.reanchored:
        return left ** (kappa / (1 - spec.rho))
    return np.maximum(1 - kappa * (1 - left), 0.0) ** (1 / (1 - spec.rho))


def quintic(tau):
    """From 1 to 0, flat at both ends, as a polynomial in 1 - tau."""
    s = 1 - tau
    return s**3 * (10 - 15 * s + 6 * s**2)


def above_limits(problem, tau, path, condition, mask, eps):
    """Greatest value - limit - tolerance of all points and rows, (samples,); infinite where something is NaN.

    The tolerance is what computing values and limits in the states' type (of precision `eps`) may change: each margin
    by 32 eps (1 + |z|), each limit by 4 eps in what remains of the integral, both by 1e-5 of themselves in float32.
    """
    size = 1.0 + np.abs(np.where(np.isfinite(path), path, 0.0)).max(axis=(2, 3))
    relative = 1e-5 if eps > 1e-10 else 1e-9
    worst = np.full(len(path), -np.inf)
    broken = ~np.isfinite(path).all(axis=(1, 2, 3)) if mask is None else np.zeros(len(path), bool)

    def add(value, limit, room):
        over = value - limit - room - relative * (np.abs(value) + np.abs(limit))
        broken[:] |= np.isnan(over).any(axis=1)
        worst[:] = np.maximum(worst, np.nan_to_num(over, nan=np.inf).max(axis=1))

    with np.errstate(all="ignore"):
        for k, each in enumerate(problem.requirements):
            key = f"r{k}"
            if isinstance(each, Private):
                short = hinges(each, key, path, condition, mask)
                blur = 32 * eps * size
                value = (short**2).sum(axis=(2, 3)) / 2
                count = (short > 0).sum(axis=(2, 3)) + 1
                room = blur * short.sum(axis=(2, 3)) + count * blur**2
                limit = value[:, :1] * decay(each, tau, 1.0, 4 * eps)[None]
                add(value, np.maximum(limit, each.buffer**2 / 2), room)
                continue
            for j, factor in enumerate(each.factors):
                q = q_of(factor, key, f"f{j}", tau, path, condition)
                end = condition[key][f"f{j}"]["end"][:, None]
                start = q[:, :1] + factor.buffer + factor.slack
                if factor.least is not None:
                    start = np.maximum(start, end + factor.least)
                beta = end + (start - end) * quintic(tau)[None]
                limit = np.clip(end, beta - factor.buffer, beta)
                add(q, limit, 64 * eps * (size**2 + np.abs(start)))
    return np.where(broken, np.inf, worst)


def steepest_row(problem, tau, path, condition, mask, eps):
    """Greatest violation of `grad_i V . v_i + zeta_i <= 0` beyond a tolerance, of one private requirement.

    (samples,); v_i is the velocity between two points, gradients are central differences. For explicit Euler steps
    without a control map. The tolerance: 1e-3 of |grad_i| |v_i| + |zeta_i|, rounding of the two states over the step,
    and 1e-5 |v_i| for the differences. Points with a margin within 1e-4 of the buffer are left out where Local asks
    who depends on whom.
    """
    (spec,) = problem.requirements
    start, span = path[:, :-1], np.diff(tau)[None, :, None, None]
    velocity = np.diff(path, axis=1) / span
    short = hinges(spec, "r0", start, condition, mask)
    parts = (short**2).sum(axis=3) / 2  # samples, points, owners
    slopes = np.stack(
        [
            (
                _parts(spec, start, +1, at, condition, mask)
                - _parts(spec, start, -1, at, condition, mask)
            )
            / (2 * NEAR)
            for at in range(path.shape[2] * path.shape[3])
        ],
        axis=-1,
    ).reshape(*parts.shape, *path.shape[2:])  # samples, points, owners, agents, dim
    gradient = slopes.sum(axis=2)
    at = tau[:-1]
    total, whole = parts.sum(axis=2), (short[:, 0] ** 2).sum(axis=(1, 2)) / 2
    if spec.reanchored:
        level = parts if spec.per_owner else total[..., None]
        rest = np.maximum(remaining(spec.omega, at), MIN_REMAINING)[None, :, None]
    else:
        level = np.maximum(whole, MIN_VIOLATION)[:, None, None]
        rest = remaining(spec.omega, 0.0)
    gain = spec.kappa / (1 - spec.rho) * level ** (1 - spec.rho) / rest
    demand = gain * weight(spec.omega, at)[None, :, None] * parts**spec.rho
    square = (gradient**2).sum(axis=3)
    zeta = _shares(spec, demand, square, slopes)
    length, speed = np.sqrt(square), np.sqrt((velocity**2).sum(axis=3))
    rounding = 2 * eps * (1 + np.sqrt((start**2).sum(axis=3))) / span[..., 0]
    room = 1e-3 * (length * speed + np.abs(zeta)) + length * rounding + 1e-5 * speed + 1e-9
    over = (gradient * velocity).sum(axis=3) + zeta - room
    if spec.allocation == "local":
        near = np.abs(spec.buffer - margins(spec, "r0", start, condition, mask)) < 1e-4
        over = np.where(near.any(axis=(2, 3))[..., None], -np.inf, over)
    # Where V is smaller than its rounding, its gradient is rounding, too.
    blur = 32 * eps * (1 + np.abs(start).max(axis=(2, 3)))
    tiny = short.max(axis=(2, 3)) < 100 * blur
    return np.where(tiny[..., None], -np.inf, over).max(axis=(1, 2))


NEAR = 1e-6


def _parts(spec, z, sign, at, condition, mask):
    moved = z.copy()
    moved.reshape(*z.shape[:2], -1)[..., at] += sign * NEAR
    return (hinges(spec, "r0", moved, condition, mask) ** 2).sum(axis=3) / 2


def _shares(spec, demand, square, slopes):
    if spec.allocation == "own":
        return demand
    if spec.allocation == "pooled":
        total = square.sum(axis=2, keepdims=True)
        shared = demand.sum(axis=2, keepdims=True) * square / np.where(total > 0, total, 1.0)
        return np.where(total > 0, shared, demand)
    depends = (slopes != 0).any(axis=-1) | np.eye(square.shape[2], dtype=bool)
    share = depends * square[:, :, None]
    total = share.sum(axis=3, keepdims=True)
    mine = demand[..., None] * share / np.where(total > 0, total, 1.0)
    return mine.sum(axis=2) + np.where(total[..., 0] > 0, 0.0, demand)
