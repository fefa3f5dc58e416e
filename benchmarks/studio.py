"""The studio in a real Chromium: latency from drag to picture, frames of replays, long random editing, screenshots.

    python benchmarks/studio.py measure --minutes 20
    python benchmarks/studio.py screenshots --out docs

Needs `pip install 'deggflow[studio]' playwright` and a Chromium on the PATH (or DEGGFLOW_CHROMIUM).
"""

import argparse
import json
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
from jaxtyping import Float
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.oracle import refutes

Floats = Float[np.ndarray, " values"]

WAIT = 600_000  # ms; the first scene of a size is compiled
# From a pointer event to the first frame after an object has moved.
STOPWATCH = """([picture, moving]) => {
  const root = document.querySelector(picture);
  window.moved = 0;
  window.delays = [];
  window.changes = [];
  root.addEventListener('pointermove', () => { window.moved ||= performance.now(); }, true);
  new MutationObserver((records) => {
    if (!records.some(({ target }) => target.matches(moving))) return;
    window.changes.push(performance.now());
    if (!window.moved) return;
    const from = window.moved;
    window.moved = 0;
    requestAnimationFrame(() => setTimeout(() => window.delays.push(performance.now() - from)));
  }).observe(root, { subtree: true, attributeFilter: ['transform'] });
}"""


class Served(NamedTuple):
    """A page that is served.

    Attributes:
        address: Of its page.
        process: Its number.
    """

    address: str
    process: int

    def memory(self) -> float:
        """Memory that the server holds, MB."""
        status = Path(f"/proc/{self.process}/status").read_text()
        found = re.search(r"VmRSS:\s+(\d+) kB", status)
        assert found is not None
        return int(found[1]) / 1e3


@contextmanager
def serving(*arguments: str) -> Iterator[Served]:
    """A Python process that prints the address of its page, and opens no browser."""
    command, environment = [sys.executable, *arguments], {**os.environ, "BROWSER": "true"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        yield Served(process.stdout.readline().strip(), process.pid)
    finally:
        process.terminate()
        process.wait()


def studio(port: int = 0) -> AbstractContextManager[Served]:
    """A studio, started as a user starts it, at any free port or a given one."""
    return serving("-m", "deggflow.app.start", "studio", "--no-browser", "--port", str(port))


@contextmanager
def chromium() -> Iterator[Browser]:
    known = ("chromium", "chromium-browser", "google-chrome")
    path = os.environ.get("DEGGFLOW_CHROMIUM") or next(filter(None, map(shutil.which, known)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def settle(page: Page, begins: str = "Generated") -> None:
    """Until what was asked for is shown."""
    expect(page.locator("#status")).to_contain_text(re.compile(f"^({begins})"), timeout=WAIT)
    expect(page.locator("main")).to_have_attribute("aria-busy", "false", timeout=WAIT)


def settle_trial(page: Page) -> None:
    settle(page, "Run:")


def measure(browser: Browser, served: Served, moves: int) -> dict[str, Any]:
    """Times of the first page, of drags among eight objects, and of both replays."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    start = time.perf_counter()
    page.goto(served.address)
    expect(page.locator("#objects input")).to_have_count(12, timeout=WAIT)
    loaded = time.perf_counter() - start
    settle(page)
    made = time.perf_counter() - start
    start = time.perf_counter()
    page.reload()
    settle(page)
    again = time.perf_counter() - start
    assert page.locator("#guided .object").count() == 8
    page.evaluate(STOPWATCH, ["#guided", ".object"])
    delays = drags(page, moves)
    page.locator("#tau").press("Home")
    expect(page.locator("#tau-text")).to_have_text("τ = 0.00", timeout=WAIT)
    scene_rate = replayed(page)
    page.goto(f"{served.address}bridge.html")
    settle_trial(page)
    page.evaluate(STOPWATCH, ["#world", ".team > g"])
    page.locator("#time").press("Home")
    trial_rate = replayed(page)
    page.close()
    low, high = interval_of_median(delays)
    return {
        "first_page_s": round(loaded, 2),
        "first_scene_with_compilation_s": round(made, 1),
        "page_with_scene_once_compiled_s": round(again, 2),
        "drag_events": len(delays),
        "drag_to_picture_median_ms": round(float(np.median(delays)), 1),
        "drag_to_picture_median_95_percent_interval_ms": [round(low, 1), round(high, 1)],
        "drag_to_picture_95th_percentile_ms": round(float(np.quantile(delays, 0.95)), 1),
        "scene_replay_poses_per_s": round(scene_rate, 1),
        "trial_replay_poses_per_s": round(trial_rate, 1),
    }


def drags(page: Page, moves: int) -> Floats:
    """Milliseconds from a movement of the pointer to the picture of the scene that follows it."""
    name = page.locator("#guided .object").last.get_attribute("data-name")
    page.locator(f"#guided .object[data-name={name}]").focus()
    box = page.locator("[data-handle=region]").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(moves):
        angle = 2 * np.pi * k / moves
        page.mouse.move(x + 30 * np.sin(angle), y + 30 * (1 - np.cos(angle)))
        expect(page.locator("#scene")).to_have_attribute("aria-busy", "false", timeout=WAIT)
        page.wait_for_timeout(30)
    page.mouse.up()
    settle(page)
    return np.array(page.evaluate("window.delays"))


def interval_of_median(values: Floats) -> tuple[float, float]:
    """The order statistics between which the median lies with 95% (normal approximation of the binomial)."""
    count, ordered = len(values), np.sort(values)
    reach = 0.98 * np.sqrt(count)
    low, high = int(count / 2 - reach), int(np.ceil(count / 2 + reach))
    return float(ordered[max(low, 0)]), float(ordered[min(high, count - 1)])


def replayed(page: Page) -> float:
    """Poses a second that are drawn while a replay is played."""
    page.evaluate("window.changes = []")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Stop")
    expect(page.locator("#play")).to_have_text("Play", timeout=WAIT)
    times = page.evaluate("window.changes")
    return 1000 * (len(times) - 1) / (times[-1] - times[0])


def survive(browser: Browser) -> float:
    """Seconds from the start of a server, whose predecessor was killed, until an open page has another scene."""
    os.environ["DEGGFLOW_STUDIO_TOKEN"] = secrets.token_hex(12)
    page = browser.new_page()
    with studio() as served:
        page.goto(served.address)
        settle(page)
        os.kill(served.process, signal.SIGKILL)
        expect(page.locator("#trouble")).to_contain_text("The studio has stopped", timeout=WAIT)
    places = page.locator("#guided").inner_html()
    start = time.perf_counter()
    with studio(urlsplit(served.address).port or 0):
        expect(page.locator("#trouble")).to_be_hidden(timeout=WAIT)
        page.locator("#seed").fill("5")
        page.locator("#seed").press("Enter")
        settle(page)
        seconds = time.perf_counter() - start
        assert page.locator("#guided").inner_html() != places
    page.close()
    return seconds


class Editor:
    """A page that is edited at random, and the errors of its console."""

    def __init__(self, context: BrowserContext, address: str, errors: list[str]) -> None:
        self.page = context.new_page()
        self.page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)  # fmt: skip
        self.page.on("pageerror", lambda error: errors.append(str(error)))
        self.page.goto(address)
        self.tools = context.new_cdp_session(self.page)
        self.tools.send("Performance.enable")

    def saved(self, folder: Path) -> Path:
        """What is shown, as a file."""
        with self.page.expect_download() as waiting:
            self.page.locator("#save").click()
        waiting.value.save_as(folder / "shown.jsonl")
        return folder / "shown.jsonl"

    def memory(self) -> tuple[float, float]:
        """MB of the page's heap, and nodes of its document."""
        self.tools.send("HeapProfiler.collectGarbage")
        found = self.tools.send("Performance.getMetrics")["metrics"]
        values = {each["name"]: each["value"] for each in found}
        return values["JSHeapUsedSize"] / 1e6, values["Nodes"]


def edit(browser: Browser, served: Served, minutes: float, seed: int) -> dict[str, Any]:
    """Random edits of scenes and trials; every claim is checked, and what pages and server keep is counted."""
    rng, folder = np.random.default_rng(seed), Path(tempfile.mkdtemp())
    errors: list[str] = []
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    scenes = Editor(context, served.address, errors)
    settle(scenes.page)
    trials = Editor(context, f"{served.address}bridge.html", errors)
    settle_trial(trials.page)
    count = dict.fromkeys(
        ("edits", "scenes_satisfied", "scenes_refuted", "trials_edits", "trials_satisfied", "trials_refuted"), 0
    )  # fmt: skip
    memory = []
    end = time.perf_counter() + 60 * minutes
    while time.perf_counter() < end or len(memory) < 4:
        scenes.page.bring_to_front()  # a page behind another one is drawn once a second
        for _ in range(10):
            edit_once(scenes.page, rng)
            settle(scenes.page)
            count["edits"] += 1
            (scene,) = read_scenes(scenes.saved(folder))
            count["scenes_satisfied"] += scene.certificate.satisfied
            wrong = scene.certificate.satisfied and refutes(scene.condition, scene.poses)
            count["scenes_refuted"] += wrong
        trials.page.bring_to_front()
        edit_trial(trials.page, rng)
        settle_trial(trials.page)
        count["trials_edits"] += 1
        line = json.loads(trials.saved(folder).read_text())
        count["trials_satisfied"] += line["certificate"]["satisfied"]
        count["trials_refuted"] += refutation(line) is not None
        memory.append((*scenes.memory(), *trials.memory(), served.memory()))
    shutil.rmtree(folder)
    context.close()
    begin, finish = (np.median(part, axis=0) for part in np.array_split(np.array(memory), 4)[::3])
    names = ("scene_page_heap_mb", "scene_page_nodes", "trial_page_heap_mb", "trial_page_nodes", "server_mb")  # fmt: skip
    return {
        "minutes": minutes,
        **{name: int(number) for name, number in count.items()},
        "console_errors": len(errors),
        "memory_first_and_last_quarter": {
            name: [round(float(before), 2), round(float(after), 2)]
            for name, before, after in zip(names, begin, finish, strict=True)
        },
    }


def edit_trial(page: Page, rng: np.random.Generator) -> None:
    grips = page.locator("[data-grip]")
    grips.nth(int(rng.integers(grips.count()))).press(
        str(rng.choice(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "q", "e"]))
    )


def edit_once(page: Page, rng: np.random.Generator) -> None:
    objects = page.locator("#guided .object")
    objects.nth(int(rng.integers(objects.count()))).focus()
    what = rng.choice(["region", "radius", "table", "seed", "hand"], p=[0.5, 0.2, 0.1, 0.1, 0.1])
    if what == "seed":
        page.locator("#seed").fill(str(rng.integers(1000)))
        page.locator("#seed").press("Enter")
    elif what == "hand":
        page.keyboard.press(str(rng.choice(["ArrowLeft", "ArrowUp", "q"])))
        page.locator("#undo-move").click()
    elif what == "table":
        page.locator("#width").fill(str(round(rng.uniform(1.0, 1.6), 2)))
        page.locator("#width").press("Enter")
    else:
        handle = page.locator(f"[data-handle={what}]")
        for _ in range(3):
            handle.press(str(rng.choice(["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"])))


LOOKS = (
    ("", 1280, 900, "light"),
    ("_dark", 1280, 900, "dark"),
    ("_narrow", 390, 844, "light"),
    ("_narrow_dark", 390, 844, "dark"),
)


def screenshots(browser: Browser, address: str, out: Path) -> None:
    """All pages wide and narrow, light and dark."""
    with shown() as sample:
        for ending, width, height, scheme in LOOKS:
            view = {"width": width, "height": height}
            for name, picture in (
                ("studio", lambda page: picture_scene(page, address)),
                ("studio_solid", lambda page: picture_solid(page, address)),
                ("studio_bridge", lambda page: picture_trial(page, address)),
                ("studio_show", lambda page: picture_sample(page, sample.address)),
            ):
                page = browser.new_page(viewport=view, color_scheme=scheme)
                picture(page)
                page.wait_for_timeout(300)
                page.screenshot(path=out / f"{name}{ending}.png")
                page.close()


def picture_scene(page: Page, address: str) -> None:
    page.goto(address)
    settle(page)
    page.locator("#guided .object[data-name=compact_printer]").focus()
    page.locator("#margins button.plain").first.click()
    page.evaluate("scrollTo(0, 0)")


def picture_solid(page: Page, address: str) -> None:
    """The 3-D view, turned, in the middle of the page."""
    page.goto(address)
    settle(page)
    page.locator("#solid summary").click()
    canvas = page.locator("#solid canvas")
    expect(canvas).to_have_attribute("data-bodies", re.compile("table"), timeout=WAIT)
    for key in 4 * ["ArrowLeft"] + 3 * ["ArrowDown"]:
        canvas.press(key)
    canvas.blur()
    page.locator("#solid").evaluate("element => element.scrollIntoView()")


def picture_trial(page: Page, address: str) -> None:
    """Half-way through the trial, with the course of its third policy."""
    page.goto(f"{address}bridge.html")
    expect(page.locator("#status")).to_contain_text(re.compile("^Run:"), timeout=WAIT)
    page.locator("#policies button").nth(2).click()
    expect(page.locator("#courses .chart")).to_have_count(2, timeout=WAIT)
    page.locator("#time").fill("6")
    page.evaluate("scrollTo(0, 0)")


def picture_sample(page: Page, address: str) -> None:
    page.goto(address)
    expect(page.locator("#status")).to_contain_text(re.compile("^Satisfied"), timeout=WAIT)
    page.locator("[data-agent='2']").press("Enter")
    page.evaluate("scrollTo(0, 0)")


def shown() -> AbstractContextManager[Served]:
    """The example of docs/studio.md, run as a script."""
    text = (Path(__file__).parent.parent / "docs" / "studio.md").read_text()
    (script,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    return serving("-c", script)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("what", choices=("measure", "screenshots"))
    parser.add_argument("--minutes", type=float, default=20.0, help="of random editing")
    parser.add_argument("--moves", type=int, default=200, help="of the pointer that are timed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the screenshots")
    options = parser.parse_args()
    with studio() as served, chromium() as browser:
        if options.what == "measure":
            times = measure(browser, served, options.moves)
            edits = edit(browser, served, options.minutes, options.seed)
            kill = {"scene_after_kill_and_restart_s": round(survive(browser), 1)}
            print(json.dumps({**times, **edits, **kill}, indent=2))
        else:
            screenshots(browser, served.address, options.out)


if __name__ == "__main__":
    main()
