"""Every code block of the documentation runs, in the order of its page, and so do the tutorials; public names have
examples; links lead somewhere."""

import importlib
import re
import sys
import threading
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from line_values import value_of

import deggflow
from deggflow import requirements
from deggflow.tasks.tabletop.lines import LINES as SCENES

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_ext"))
import tutorials  # noqa: E402

PAGES = [
    path for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("api/*.md")])
    if "```python" in path.read_text() and path.name not in ("extending.md", "foreign.md", "studio.md")
]  # fmt: skip
"""The others have tests of their own."""
SCRIPTS = sorted(tutorials.SCRIPTS.glob("*.py"))


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)


def field(tau, z, condition):
    return -z


def margins(z, condition):
    mask = None if condition is None else condition["mask"]
    return deggflow.distances(z, mask).clip(max=5.0) - 0.3


def guidance_names():
    """What the page on guidance takes for granted."""
    from deggflow import Extrapolated

    return {
        "margins": margins, "Extrapolated": Extrapolated, "task_end": lambda condition: 0.0,
        "q_task": lambda tau, z, condition: jnp.sum(z**2) - 9.0,
        "q_safe": lambda tau, z, condition: jnp.max(z) - 5.0, "who_is_near": lambda condition: None,
        "condition": None, "np": np, "jax": jax, "sizes": np.array([5, 8]),
        "generation": deggflow.generate(
            field, deggflow.NoGuidance(), jnp.ones((5, 2)), None, grid=deggflow.refined_grid(4)
        ),
    }  # fmt: skip


def requirements_names():
    """What the page on named requirements takes for granted."""
    starts = jnp.stack([jnp.zeros(3), jnp.arange(3.0)], axis=-1)
    condition = {
        "start": starts, "goal": starts + jnp.array([[4.0, 0.0]]),
        "obstacles": requirements.Disc((2.0, 0.5), 0.2),
    }  # fmt: skip
    everything = {name: getattr(requirements, name) for name in requirements.__all__}
    return {**everything, "condition": condition, "apart": requirements.apart(distance=0.1)}


def one_of_three():
    """What the page on processes takes for granted; the other agents run in threads."""
    from deggflow import runtime

    below = deggflow.PrivateRequirement(lambda z, condition: 1.0 - z, 0.05, name="below")
    guidance, z0 = deggflow.DecoupledGuidance((below,)), jnp.zeros((3, 2))
    addresses = runtime.free_addresses(3)
    run_agent = partial(runtime.run_agent, timing=runtime.Timing(deadline=600.0))

    def other(number):
        program = runtime.TeamProgram(field, guidance, grid=deggflow.refined_grid(20))
        transport = runtime.UdpTransport(number, addresses)
        run_agent(program, number, program.start(z0, None), transport, faults=2)
        transport.close()

    for number in (1, 2):
        threading.Thread(target=other, args=(number,), daemon=True).start()
    return {
        "TeamProgram": runtime.TeamProgram, "run_agent": run_agent, "guidance": guidance, "z0": z0, "condition": None,
        "number": 0, "transport": runtime.UdpTransport(0, addresses),
    }  # fmt: skip


def table_of_scenes():
    """What the page on scale takes for granted: scenes.parquet in the reader's folder, here of made-up rows."""
    tables = pytest.importorskip("deggflow.tables")
    pytest.importorskip("pyarrow")
    rows = [value_of(SCENES[0], full=full) for full in (True, False)]
    tables.write_rows("scenes.parquet", SCENES[0], iter(rows), {})
    return {}


def given(page):
    """Names that a page takes for granted; other pages import all of theirs."""
    names = {
        **{name: getattr(deggflow, name) for name in deggflow.__all__},
        "sample": partial(
            deggflow.sample, grid=deggflow.refined_grid(20), max_draws=1, guard=None
        ),
        "refined_grid": lambda steps: deggflow.refined_grid(20),
        "field": field, "key": jax.random.key(0), "jnp": jnp,
    }  # fmt: skip
    extra = {
        "guidance.md": guidance_names,
        "requirements.md": requirements_names,
        "runtime.md": one_of_three,
        "scale.md": table_of_scenes,
    }
    return {**names, **extra[page.name]()} if page.parent == DOCS and page.name in extra else {}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_code_blocks_run_in_order(page, tmp_path, monkeypatch):
    if "torch" in page.name:
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    names = given(page)
    for number, block in enumerate(blocks(page), start=1):
        if (
            "mission" in block
        ):  # the page has a key and a goal of random numbers and of paths before
            names |= {
                name: requirements.Disc((1.0, 0.0), 0.4) for name in ("pick", "gate", "key", "goal")
            }
        code = block.replace("count=512", "count=2").replace("count=64", "count=4")
        code = code.replace("shape=(15, 128)", "shape=(3, 128)")
        exec(compile(code, f"{page.name}, block {number}", "exec"), names)
    if "transport" in names:
        names["transport"].close()


QUICK = ("own_torch_model", "processes")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_tutorials_run(script, tmp_path):
    """`make docs` runs all of them, in CI too; the suite those that take seconds."""
    if "torch" in script.stem:
        pytest.importorskip("torch")
    text = tutorials.page(script, tmp_path) if script.stem in QUICK else script.read_text()
    assert text.count("# ") > 2
    assert f"tutorials/{script.stem}\n" in (DOCS / "index.md").read_text()


PACKAGES = (
    "", "guidance", "requirements", "field", "train", "task", "runtime", "deviation", "baselines", "drift", "torch", "loggers",
)  # fmt: skip


def executed():
    """All code that tests or `make docs` run as examples."""
    others = [DOCS / name for name in ("extending.md", "foreign.md", "studio.md")]
    pages = [*PAGES, *others, ROOT / "README.md"]
    yield from (block for page in pages for block in blocks(page))
    yield from (path.read_text() for path in (ROOT / "examples").rglob("*.py"))
    for path in Path(deggflow.__file__).parent.rglob("*.py"):
        yield from re.findall(r"^ *(?:>>>|\.\.\.) (.*)$", path.read_text(), re.MULTILINE)


def public(package):
    module = importlib.import_module(f"deggflow.{package}".rstrip("."))
    own = [
        name for name, value in vars(module).items()
        if not name.startswith("_") and getattr(value, "__module__", "") == module.__name__
    ]  # fmt: skip
    return getattr(module, "__all__", own)


def test_every_public_name_is_used_in_an_example():
    pytest.importorskip("torch")
    words = set(re.findall(r"\w+", "\n".join(executed())))
    missing = {package: sorted(set(public(package)) - words) for package in PACKAGES}
    assert not {package: names for package, names in missing.items() if names}


LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))],
    ids=lambda page: str(page.relative_to(ROOT)),
)  # fmt: skip
def test_links_lead_somewhere(page):
    if page.parent.name == "tutorials":
        pytest.skip("made by `make docs`, which checks it")
    for link in LINK.findall(re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)):
        if link.startswith(("http", "#")):
            continue
        path = page.parent / link.partition("#")[0]
        source = tutorials.SCRIPTS / f"{re.sub(r'_[0-9]+$', '', path.stem)}.py"
        assert path.exists() or (path.parent.name == "tutorials" and source.exists()), link


def test_rows_of_tables_have_the_cells_of_their_heads():
    """A bar in a cell, as in |g|, would begin another cell."""
    for page in [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]:
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
        for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
            bars = [len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()]
            assert len(set(bars)) == 1, (page.name, table.splitlines()[0])
