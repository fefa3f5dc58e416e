"""Counts of the game, and what has to be explained."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from .truth import above_limits, exact, scale_of, take, verdict

TIE = 1e-14  # times the scale of a sample: margins as close to zero are ties
BARS = (
    "false satisfied",
    "false hypotheses",
    "margins off",
    "broken promises",
    "errors missing",
    "errors not called for",
)
"""What must never be: counts that are zero."""
REFUSALS = 1e-3  # of the samples whose requirements all hold


@dataclass
class Tally:
    """Of one kind, or of all."""

    counts: Counter = field(default_factory=Counter)
    notes: list = field(default_factory=list)

    def add(self, what, count=1):
        """Counts."""
        self.counts[what] += int(count)

    def note(self, what, **details):
        """Counts one, and keeps how to reproduce it."""
        self.counts[what] += 1
        self.notes.append((what, details))

    def merge(self, other):
        """Adds another one."""
        self.counts.update(other.counts)
        self.notes += other.notes

    @property
    def missed(self):
        """The bars that are missed."""
        out = [bar for bar in BARS if self.counts[bar]]
        if self.counts["false refusals"] > REFUSALS * max(self.counts["hold"], 1):
            out.append("false refusals")
        return out


def judge_verdicts(tally, case, problem, z, condition, mask, certificates):
    """Compares verdicts with the judge's; returns the judge's least margins."""
    z = np.asarray(z, np.float64)
    rows = verdict(problem, z, exact(condition), mask)
    finite = np.isfinite(z) if mask is None else np.isfinite(z) | ~mask[..., None]
    fine = finite.all(axis=(1, 2))
    # A state that is not a finite number is no sample, whatever its margins are.
    rows = np.where(fine[:, None], rows, np.nan)
    least, scale = rows.min(axis=1), scale_of(z)
    for k, said in enumerate(certificates):
        holds, tie = bool(least[k] >= 0), bool(abs(least[k]) <= TIE * scale[k])
        tally.add("judged")
        tally.add("satisfied", said.satisfied)
        tally.add("hold", holds)
        tally.add("ties", tie)
        what = {"case": case, "sample": k, "least": float(least[k]), "said": said.min_margin}
        what["reason"] = said.reason
        if not fine[k]:
            what["z"] = "not finite"
        if said.satisfied and not holds and not tie:
            tally.note("false satisfied", **what)
        if holds and not said.satisfied and not tie:
            tally.note("false refusals", **what)
        if (said.reason is None) != said.satisfied:
            tally.note("margins off", why="a reason although satisfied, or none", **what)
        if np.isfinite(rows[k]).all() and not np.isclose(
            np.clip(least[k], -1e12, 1e12), said.min_margin, rtol=1e-9, atol=1e-9 * scale[k]
        ):
            tally.note("margins off", **what)
        named = np.array([each.margin < 0 for each in said.verdicts])
        clear = np.abs(rows[k]) > TIE * scale[k]
        if len(named) != rows.shape[1] or ((named != (rows[k] < 0)) & clear).any():
            tally.note("margins off", why="another requirement is named", **what)
    return least


def judge_hypotheses(
    tally, case, problem, tau, path, condition, mask, certificates, eps, part=16, labels=None
):
    """Looks at every sample whose hypotheses are said to hold: its values against limits of the judge's own."""
    hold = np.array(
        [s.generation is not None and s.generation.hypotheses_hold for s in certificates]
    )
    tally.add("hypotheses hold", hold.sum())
    for begin in range(0, len(hold), part):
        index = begin + np.flatnonzero(hold[begin : begin + part])
        if not len(index):
            continue
        way, asked = np.asarray(path[index], np.float64), take(exact(condition), index)
        over = above_limits(
            problem, np.asarray(tau, np.float64), way, asked, take(mask, index), eps
        )
        for k, excess in zip(index, over, strict=True):
            said = certificates[k].generation
            what = {"case": case, "sample": int(k)}
            if labels is not None:
                what["which"] = labels[k]
            if said.forced_steps or said.first_failure is not None:
                tally.note("false hypotheses", why="forced steps or a failure", **what)
            if excess > 0:
                tally.note("false hypotheses", above=float(excess), **what)
    return hold
