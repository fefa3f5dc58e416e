"""The report: measured once, kept whatever happens, and one page that needs nothing but itself."""

import csv
import json
from dataclasses import replace
from html.parser import HTMLParser
from urllib.parse import urlparse

import numpy as np
import pytest

from deggflow.app.reproduce import registry, run
from deggflow.app.reproduce.artefacts import check_names, table_csv, table_json
from deggflow.app.reproduce.command import write_report
from deggflow.app.reproduce.experiment import UNMET, DataTable, Finding, Plot, Section, Settings
from deggflow.app.reproduce.page import duration, shown
from deggflow.app.reproduce.run import Entry, Stored, Watch, result_path, results
from deggflow.schema import parse_as
from deggflow.view.style import look, new_figure

NASTY = "<script>alert('x')</script> & \"quoted\""
VOID = {"meta", "img", "link", "br", "hr"}


class Fake:
    """An experiment that counts how often it is measured."""

    def __init__(self, name="fake", unmet=(), stops=False):
        self.name, self.unmet, self.stops, self.measured = name, list(unmet), stops, 0

    def measure(self, settings, say):
        say("nothing")
        self.measured += 1
        if self.stops:
            raise KeyboardInterrupt
        return {"value": 0.1 + settings.seed, "cases": settings.cases(10, 2), "unmet": self.unmet}

    def present(self, result, settings):
        with look():
            figure, (axes,) = new_figure(1.0)
            axes.plot([0.0, result["value"]])
        rows = [[4, result["value"], "99.0% [98.2, 99.5]", None], [12_345, -1e-9, NASTY, 2.5]]
        table = DataTable(f"{self.name}_table", NASTY, ["N", "x", "rate", NASTY], rows)
        return Section(
            title=f"{self.name} {NASTY}",
            paper=NASTY,
            text=[NASTY],
            tables=[table],
            plots=[Plot(f"{self.name}_plot", NASTY, figure)],
            command=NASTY,
            summary=[Finding(NASTY, "54%", "95%")],
        )


class Reader(HTMLParser):
    """Fails where tags are not closed in order; collects links, sources, ids, texts."""

    def __init__(self, page):
        super().__init__()
        self.open, self.links, self.sources, self.ids, self.text = [], [], [], [], ""
        self.tags = set()
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            assert not name.startswith("on")
            {"href": self.links, "src": self.sources, "id": self.ids}.get(name, []).append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def measure(out, entries, chosen=None, **settings):
    said = []
    watch = Watch(said.append, said.append, lambda name, fresh: said.append((name, fresh)))
    names = [entry.experiment.name for entry in entries] if chosen is None else chosen
    return results(out, entries, Settings(**settings), names, watch)


def test_a_result_is_measured_once_and_again_if_anything_it_depends_on_changes(
    tmp_path, monkeypatch
):
    fake, files = Fake(), [tmp_path / task / "weights" / "a.bin" for task in ("one", "other")]
    for path in files:
        path.parent.mkdir(parents=True)
        path.write_bytes(b"one")
    entries = [Entry(fake, tuple(files))]
    first = measure(tmp_path, entries)["fake"]
    assert (first.result["value"], first.result["cases"]) == (1.1, 10)
    assert first.settings["seed"] == 1
    content = result_path(tmp_path, "fake").read_bytes()
    assert measure(tmp_path, entries)["fake"] == first
    assert (fake.measured, result_path(tmp_path, "fake").read_bytes()) == (1, content)
    assert measure(tmp_path, entries, seed=2)["fake"].result["value"] == 2.1
    assert measure(tmp_path, entries, seed=2, quick=True)["fake"].result["cases"] == 2
    assert fake.measured == 3
    for k, path in enumerate(files):
        path.write_bytes(b"two")
        measure(tmp_path, entries, seed=2, quick=True)
        assert fake.measured == 4 + k
    monkeypatch.setattr(run, "__version__", "0.0.0")
    measure(tmp_path, entries, seed=2, quick=True)
    assert fake.measured == 6


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"result": {}}', b"\xff"])
def test_a_damaged_result_is_measured_anew(tmp_path, content):
    fake = Fake()
    measure(tmp_path, [Entry(fake)])
    result_path(tmp_path, "fake").write_bytes(content)
    assert measure(tmp_path, [Entry(fake)])["fake"].result["value"] == 1.1
    assert fake.measured == 2


@pytest.mark.parametrize("field", ["result", "seconds", "machine", "digest", "code", "more"])
def test_a_result_that_was_changed_is_measured_anew_and_not_shown(tmp_path, field):
    fake, other, said = Fake(), Fake("other"), []
    entries = [Entry(fake), Entry(other)]
    found = measure(tmp_path, entries)
    path = result_path(tmp_path, "fake")
    whole = json.loads(path.read_text())
    assert parse_as(Stored, whole) == found["fake"]
    whole[field] = "<script>" if field in ("digest", "code") else {"value": 2}
    path.write_text(json.dumps(whole))
    watch = Watch(lambda name: None, said.append, lambda name, fresh: None)
    assert set(results(tmp_path, entries, Settings(), ["other"], watch)) == {"other"}
    assert said[0].startswith(f"{path} was changed after it was written and is not used: ")
    assert measure(tmp_path, entries)["fake"].result["value"] == 1.1
    assert (fake.measured, other.measured) == (2, 1)


def test_a_stopped_run_keeps_what_is_finished(tmp_path):
    one, other = Fake("one"), Fake("other", stops=True)
    entries = [Entry(one), Entry(other)]
    with pytest.raises(KeyboardInterrupt):
        measure(tmp_path, entries)
    assert result_path(tmp_path, "one").exists()
    assert not result_path(tmp_path, "other").exists()
    other.stops = False
    assert set(measure(tmp_path, entries)) == {"one", "other"}
    assert (one.measured, other.measured) == (1, 2)


def test_a_result_that_is_no_json_is_refused_and_nothing_is_left(tmp_path):
    fake = Fake()
    fake.measure = lambda settings, say: {"value": float("nan")}
    with pytest.raises(ValueError, match="JSON compliant"):
        measure(tmp_path, [Entry(fake)])
    assert not (tmp_path / "results").exists()


def test_only_the_chosen_are_measured_and_all_that_are_there_are_shown(tmp_path):
    one, other, third = Fake("one"), Fake("other"), Fake("third")
    entries = [Entry(one), Entry(other), Entry(third)]
    assert set(measure(tmp_path, entries, ["other"])) == {"other"}
    found = measure(tmp_path, entries, ["one"])
    assert list(found) == ["one", "other"]
    assert (one.measured, other.measured, third.measured) == (1, 1, 0)
    parts = write_report(tmp_path, entries, found, Settings())
    assert [part.name for part in parts] == ["one", "other"]
    text = Reader((tmp_path / "report.html").read_text()).text
    assert "Not measured yet: third." in text
    assert "by other sources" not in text


@pytest.fixture
def report(tmp_path):
    entries = [Entry(Fake("one", unmet=[f"one {NASTY}"])), Entry(Fake("other"))]
    write_report(tmp_path, entries, measure(tmp_path, entries), Settings())
    return tmp_path


def test_the_page_is_whole_needs_no_network_and_every_link_leads_somewhere(report):
    page = Reader((report / "report.html").read_text())
    assert len(page.ids) == len(set(page.ids))
    assert page.sources
    assert all(source.startswith("data:image/png;base64,") for source in page.sources)
    assert {"script", "link", "iframe"}.isdisjoint(page.tags)
    for link in page.links:
        address = urlparse(link)
        assert (address.scheme, address.netloc) == ("", "")
        assert (report / address.path).is_file() if address.path else address.fragment in page.ids
    style = (report / "report.html").read_text().split("<style>")[1].split("</style>")[0]
    assert "url(" not in style
    assert "@import" not in style


def test_nothing_of_a_results_file_becomes_part_of_the_page(tmp_path):
    """Whoever edits a result, its digest included, writes text and no HTML."""
    found = measure(tmp_path, [Entry(Fake())])["fake"]
    names = {"cores": NASTY, "processor": NASTY, "system": NASTY, "python": NASTY, "jax": NASTY}
    changed = replace(
        found, digest=NASTY, code=NASTY, machine=names, result={**found.result, UNMET: [NASTY]}
    )
    write_report(tmp_path, [Entry(Fake())], {"fake": changed}, Settings())
    page = Reader((tmp_path / "report.html").read_text())
    assert {"script", "link", "iframe"}.isdisjoint(page.tags)
    assert page.text.count(NASTY) >= 9 + 5 + 2


def test_texts_stand_as_they_are(report):
    page = Reader((report / "report.html").read_text())
    # Title twice (contents, heading), paper, text, caption of plot and table, heading and cell, command, summary, account.
    assert page.text.count(NASTY) >= 2 * 9
    assert f"one {NASTY}" in page.text
    for said in ("12,345", "-1e-09", "1.1", "99.0% [98.2, 99.5]", "54%", "95%", "seed"):
        assert said in page.text


def test_tables_hold_the_same_in_both_files_and_numbers_in_full(report):
    known = json.loads((report / "tables" / "one_table.json").read_text())
    with (report / "tables" / "one_table.csv").open(newline="") as file:
        columns, *rows = csv.reader(file)
    assert columns == known["columns"]
    assert rows == [["" if c is None else str(c) for c in row] for row in known["rows"]]
    assert known["rows"][1] == [12_345, -1e-9, NASTY, 2.5]


def test_figures_are_png_and_pdf_with_whole_letters_and_without_dates(report):
    png = (report / "figures" / "one_plot.png").read_bytes()
    pdf = (report / "figures" / "one_plot.pdf").read_bytes()
    assert png.startswith(b"\x89PNG")
    assert pdf.startswith(b"%PDF")
    assert b"/FontFile2" in pdf  # TrueType
    assert b"/Type3" not in pdf
    assert b"CreationDate" not in pdf
    for ending in ("png", "pdf"):
        one = (report / "figures" / f"one_plot.{ending}").read_bytes()
        assert one == (report / "figures" / f"other_plot.{ending}").read_bytes()


def test_names_that_clash_and_tables_that_are_no_tables_are_refused():
    def section(*names, columns=("N",)):
        tables = [DataTable(name, "", columns, [[1]]) for name in names]
        return Section("", "", tables=tables)

    check_names([section("a_1"), section("b")])
    for sections in ([section("a", "a")], [section("a"), section("a")], [section("../a")]):
        with pytest.raises(ValueError, match="must be unique"):
            check_names(sections)
    with pytest.raises(ValueError, match="every row"):
        check_names([section("a", columns=("N", "x"))])
    with pytest.raises(ValueError, match="JSON compliant"):
        table_json(DataTable("a", "", ["x"], [[float("inf")]]))
    assert table_csv(DataTable("a", "", ["x", "y"], [[None, "a,b"]])) == 'x,y\n,"a,b"\n'


def test_numbers_and_times_read_well():
    assert [shown(x) for x in (None, 1234567, 0.123456, "as it is")] == [
        "-", "1,234,567", "0.1235", "as it is",
    ]  # fmt: skip
    assert [duration(s) for s in (0.04, 59.9, 61.0, 3599.6)] == [
        "0.0 s", "59.9 s", "1 min 01 s", "60 min 00 s",
    ]  # fmt: skip


@pytest.fixture
def fakes(monkeypatch):
    """The command with two fake experiments."""
    found = [Fake("one"), Fake("training_curves")]
    monkeypatch.setattr(registry, "entries", lambda sources: tuple(map(Entry, found)))
    return found


def test_the_command_measures_reports_and_goes_on(fakes, inside, tmp_path):
    fakes[1].stops = True
    stopped = inside("reproduce", "--out", "r", "--seed", 3)
    assert stopped.returncode == 130
    assert "rerun the command to resume" in stopped.stderr
    assert not (tmp_path / "r" / "report.html").exists()
    fakes[1].stops = False
    again = inside("reproduce", "--out", "r", "--seed", 3)
    assert again.returncode == 0
    assert "one: kept from an earlier run" in again.stderr
    assert "training_curves: measured in" in again.stderr
    assert "report.html" in again.stdout
    assert fakes[0].measured == 1
    assert (tmp_path / "r" / "report.html").is_file()


def test_a_guided_result_that_is_not_satisfied_is_told_and_makes_the_exit_code_3(fakes, inside):
    fakes[0].unmet.append("N = 8: 1 of 1,000 cases")
    found = inside("reproduce", "--out", "r")
    assert found.returncode == 3
    assert "not as expected: N = 8: 1 of 1,000 cases" in " ".join(found.stderr.split())


def test_bad_input_is_refused_before_anything_is_measured(fakes, inside, tmp_path):
    (tmp_path / "file").touch()
    for arguments, hint in (
        (("--only", "nonsense"), "no experiment nonsense; known are one, training_curves"),
        (("--seed", -1), "--seed must lie in"),
        (("--out", "file"), "is not a folder"),
        (("--retrain", "--only", "one"), "--retrain is for training_curves"),
    ):
        found = inside("reproduce", *arguments)
        assert found.returncode == 2
        assert hint in " ".join(found.stderr.split())
    assert [fake.measured for fake in fakes] == [0, 0]
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []


def test_every_experiment_has_a_name_of_its_own_and_inputs_that_exist():
    from deggflow.app.reproduce.curves import shipped_curves

    entries = registry.entries(shipped_curves())
    names = [entry.experiment.name for entry in entries]
    assert len(set(names)) == len(names) >= 5
    assert all(path.is_file() for entry in entries for path in entry.inputs)
    assert all(entry.inputs for entry in entries)


def test_the_paper_says_of_itself_what_its_rows_add_up_to():
    """Sums that the paper prints: 218 and 250 of 250; 54.0, 44.8 and 100%."""
    from deggflow.app.reproduce import paper

    bridge = [
        paper.overall(list(column)) for column in zip(*paper.TASK1_SUCCESS.values(), strict=True)
    ]
    assert [(rate.successes, rate.cases) for rate in bridge] == [(218, 250), (250, 250)]
    scenes = [
        paper.overall(list(column)) for column in zip(*paper.TASK2_SUCCESS.values(), strict=True)
    ]
    np.testing.assert_allclose([rate.proportion for rate in scenes], [0.54, 0.448, 1.0])
