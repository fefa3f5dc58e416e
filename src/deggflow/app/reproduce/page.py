"""The report: one self-contained HTML page."""

import base64
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

from deggflow import __version__

from .artefacts import Artefacts, WrittenPlot, WrittenTable
from .experiment import Finding, Section, Settings
from .run import Stored

_NUMBER = re.compile(r"\s*[+\-<>~]?\d")
_LONG = 34  # characters, above which a cell may break into lines
_SCREEN = 118  # pixels per inch of a figure


class Part(NamedTuple):
    """One experiment of the report.

    Attributes:
        name: Its name.
        section: Its section.
        stored: Its result.
        artefacts: Its tables and figures.
    """

    name: str
    section: Section
    stored: Stored
    artefacts: Artefacts


def page(parts: Sequence[Part], missing: Sequence[str], settings: Settings, code: str) -> str:
    """The whole report.

    Args:
        parts: Experiments with results, in the order of the report.
        missing: Names of experiments without results.
        settings: Settings of all results.
        code: Digest of the current sources.
    """
    title = "deggflow: every table and figure"
    style = files(__package__).joinpath("report.css").read_text()
    body = [
        f"<header><h1>{title}</h1>{_about(parts, settings)}</header>",
        _missing(missing),
        _unmet(parts),
        _summary(parts),
        *(_section(part) for part in parts),
        _account(parts, code),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        f"{_contents(parts)}\n<main>\n" + "\n".join(filter(None, body)) + "\n</main>\n</body>\n"
        "</html>\n"
    )


def _about(parts: Sequence[Part], settings: Settings) -> str:
    machines = {_machine(part.stored.machine) for part in parts}
    seconds = sum(part.stored.seconds for part in parts)
    facts = {
        "version": f"deggflow {__version__}",
        "seed": str(settings.seed),
        "sizes": "quick (few cases)" if settings.quick else "full",
        "machine": "; ".join(sorted(machines)),
        "time of measurement": duration(seconds),
    }
    terms = "".join(
        f"<div><dt>{name}</dt><dd>{escape(value)}</dd></div>" for name, value in facts.items()
    )
    return (
        "<p>The experiments of <cite>Multi-Agent Flow Matching with Decoupled Generative Guidance</cite> "
        "(Lin, Egerstedt, Pasqualetti), measured again. Intervals in brackets are 95% Wilson intervals unless stated otherwise.</p>"
        f'<dl class="facts">{terms}</dl>'
    )


def _machine(machine: Mapping[str, Any]) -> str:
    return (
        f"{machine['cores']} cores ({machine['processor']}, {machine['system']}), "
        f"Python {machine['python']}, JAX {machine['jax']}"
    )


def duration(seconds: float) -> str:
    """A time in seconds or minutes."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s"


def _contents(parts: Sequence[Part]) -> str:
    entries = [("summary", "Summary"), *((part.name, part.section.title) for part in parts)]
    entries.append(("account", "How it was measured"))
    items = "".join(f'<li><a href="#{name}">{escape(title)}</a></li>' for name, title in entries)
    return f'<nav aria-label="Contents"><ol>{items}</ol></nav>'


def _missing(missing: Sequence[str]) -> str:
    if not missing:
        return ""
    return f'<p class="note">Not measured yet: {escape(", ".join(missing))}.</p>'


def _unmet(parts: Sequence[Part]) -> str:
    texts = [(part.name, text) for part in parts for text in part.stored.unmet]
    if not texts:
        return ""
    items = "".join(f'<li><a href="#{name}">{escape(text)}</a></li>' for name, text in texts)
    return f'<div class="note"><p>Results that are not as expected:</p><ul>{items}</ul></div>'


def _summary(parts: Sequence[Part]) -> str:
    rows = [
        f'<tr><td><a href="#{part.name}">{escape(line.what)}</a></td>'
        f"<td>{escape(line.paper)}</td><td>{escape(line.ours)}</td></tr>"
        for part in parts
        for line in part.section.summary or (Finding(part.section.title, "", "see section"),)
    ]
    head = '<tr><th scope="col"></th><th scope="col">paper</th><th scope="col">here</th></tr>'
    return (
        '<section id="summary"><h2>Summary</h2><div class="wide"><table class="summary">'
        f"<thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div></section>"
    )


def _section(part: Part) -> str:
    section = part.section
    lines = [
        f'<section id="{part.name}"><h2>{escape(section.title)}</h2>',
        f'<p class="paper"><strong>In the paper:</strong> {escape(section.paper)}</p>',
        *(f"<p>{escape(text)}</p>" for text in section.text),
        *(_figure(plot) for plot in part.artefacts.plots),
        *(_table(table) for table in part.artefacts.tables),
    ]
    if section.command is not None:
        lines.append(
            f"<p>The same numbers by one command:</p><pre><code>{escape(section.command)}</code></pre>"
        )
    lines.append(f"{_source(part)}</section>")
    return "\n".join(lines)


def _source(part: Part) -> str:
    return (
        f'<p class="source">Measured in {duration(part.stored.seconds)}; this section is made from '
        f'<a href="results/{part.name}.json">results/{part.name}.json</a>.</p>'
    )


def _figure(plot: WrittenPlot) -> str:
    image = base64.b64encode(plot.png).decode()
    return (
        f'<figure id="figure-{plot.name}"><img src="data:image/png;base64,{image}" '
        f'alt="{escape(plot.caption)}" style="width: {_SCREEN * plot.width:.0f}px">'
        f"<figcaption>{escape(plot.caption)} {_links(plot.links)}</figcaption></figure>"
    )


def _links(links: Sequence[str]) -> str:
    anchors = ", ".join(f'<a href="{link}">{link.rsplit(".", 1)[1].upper()}</a>' for link in links)
    return f'<span class="links">{anchors}</span>'


def _table(artefact: WrittenTable) -> str:
    table = artefact.table
    columns = list(zip(*table.rows, strict=True)) or [()] * len(table.columns)
    kinds = [_kind(column) for column in columns]
    head = "".join(
        f'<th scope="col" class="{kind}">{escape(name)}</th>'
        for name, kind in zip(table.columns, kinds, strict=True)
    )
    rows = "".join(
        "<tr>"
        + "".join(
            f'<td class="{kind}">{escape(shown(cell))}</td>'
            for cell, kind in zip(row, kinds, strict=True)
        )
        + "</tr>"
        for row in table.rows
    )
    return (
        f'<figure id="table-{table.name}"><figcaption>{escape(table.caption)} {_links(artefact.links)}</figcaption>'
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></figure>'
    )


def _kind(column: Sequence[str | float | int | None]) -> str:
    """Style of a column: numbers, or texts that begin with one, are right-aligned; long texts break into lines."""
    texts = [cell for cell in column if isinstance(cell, str) and cell not in ("", "-")]
    if any(len(text) > _LONG for text in texts):
        return "long"
    values = [cell for cell in column if cell is not None]
    return "number" if values and all(map(_NUMBER.match, texts)) else "text"


def shown(cell: str | float | int | None) -> str:
    """A cell as text: integers with thousands separators, floats with four digits."""
    if cell is None:
        return "-"
    if isinstance(cell, int):
        return f"{cell:,}"
    return f"{cell:.4g}" if isinstance(cell, float) else cell


def _account(parts: Sequence[Part], code: str) -> str:
    rows = []
    for part in parts:
        stored = part.stored
        remark = "" if stored.code == code else "measured by other sources than the current ones"
        cells = (part.section.title, duration(stored.seconds), stored.digest, remark)
        link = f'<a href="results/{part.name}.json">{part.name}.json</a>'
        rows.append(
            "<tr>"
            f'<td>{escape(cells[0])}</td><td class="number">{cells[1]}</td>'
            f"<td><code>{escape(cells[2])}</code></td><td>{link}</td><td>{escape(remark)}</td></tr>"
        )
    head = "".join(
        f'<th scope="col"{kind}>{name}</th>'
        for name, kind in (
            ("experiment", ""),
            ("time", ' class="number"'),
            ("settings", ""),
            ("result", ""),
            ("", ""),
        )
    )
    return (
        '<section id="account"><h2>How it was measured</h2>'
        "<p>Each result is measured once and kept. Rerun the command to resume an interrupted run. It measures a result "
        "again if the seed, the sample sizes, the version, the weights or the training curves have changed. The digest "
        "below identifies these settings.</p>"
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div></section>'
    )
