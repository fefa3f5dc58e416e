"""The studio in a real Chromium: latency from drag to picture, frames of a replay, long random editing, screenshots.

    python benchmarks/studio.py measure
    python benchmarks/studio.py edit --minutes 20
    python benchmarks/studio.py screenshots --out docs

Needs `pip install 'deggflow[studio]' playwright` and a Chromium on the PATH (or DEGGFLOW_CHROMIUM).
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, expect, sync_playwright

from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.oracle import refutes

WAIT = 600_000  # ms; the first scene of a size is compiled
# From the last pointer event to the first frame after the scene has changed.
STOPWATCH = """() => {
  window.moved = 0;
  window.delays = [];
  window.changes = 0;
  document.querySelector('#guided').addEventListener('pointermove', () => { window.moved ||= performance.now(); }, true);
  new MutationObserver(() => {
    window.changes += 1;
    if (!window.moved) return;
    const from = window.moved;
    window.moved = 0;
    requestAnimationFrame(() => setTimeout(() => window.delays.push(performance.now() - from)));
  }).observe(document.querySelector('#guided'), { subtree: true, attributeFilter: ['transform'] });
}"""


@contextmanager
def studio() -> Iterator[str]:
    """The address of a studio, which is started as a user starts it."""
    command = [sys.executable, "-m", "deggflow.app.start", "studio", "--no-browser", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


@contextmanager
def chromium() -> Iterator[Browser]:
    known = ("chromium", "chromium-browser", "google-chrome")
    path = os.environ.get("DEGGFLOW_CHROMIUM") or next(filter(None, map(shutil.which, known)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def settle(page: Page) -> None:
    """Until the scene that was asked for is shown."""
    expect(page.locator("#status")).to_contain_text(re.compile("^Generated"), timeout=WAIT)
    expect(page.locator("#scene")).to_have_attribute("aria-busy", "false", timeout=WAIT)


def measure(browser: Browser, address: str, moves: int) -> dict[str, float]:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    start = time.perf_counter()
    page.goto(address)
    expect(page.locator("#objects input")).to_have_count(12, timeout=WAIT)
    loaded = time.perf_counter() - start
    settle(page)
    page.evaluate(STOPWATCH)
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
    delays = np.array(page.evaluate("window.delays"))
    page.locator("#tau").press("Home")
    expect(page.locator("#tau-text")).to_have_text("τ = 0.00", timeout=WAIT)
    page.evaluate("window.changes = 0")
    start = time.perf_counter()
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Play", timeout=WAIT)
    seconds = time.perf_counter() - start
    poses = page.evaluate("window.changes") / seconds
    page.close()
    return {
        "page_loaded_s": round(loaded, 2),
        "drag_events": len(delays),
        "drag_to_picture_median_ms": round(float(np.median(delays)), 1),
        "drag_to_picture_p95_ms": round(float(np.quantile(delays, 0.95)), 1),
        "replay_poses_per_s": round(poses, 1),
    }


def edit(browser: Browser, address: str, minutes: float, seed: int) -> dict[str, float]:
    """Random edits; what is claimed is checked by Shapely, and what the page keeps is counted."""
    rng, errors, memory = np.random.default_rng(seed), [], []
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)  # fmt: skip
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    settle(page)
    tools = context.new_cdp_session(page)
    tools.send("Performance.enable")
    folder = Path(tempfile.mkdtemp())
    edits = claims = satisfied = refuted = 0
    end = time.perf_counter() + 60 * minutes
    while time.perf_counter() < end:
        edit_once(page, rng)
        settle(page)
        edits += 1
        if edits % 10:
            continue
        with page.expect_download() as waiting:
            page.locator("#save").click()
        waiting.value.save_as(folder / "scene.jsonl")
        (scene,) = read_scenes(folder / "scene.jsonl")
        claims += 1
        satisfied += scene.certificate.satisfied
        refuted += scene.certificate.satisfied and refutes(scene.condition, scene.poses)
        tools.send("HeapProfiler.collectGarbage")
        metrics = {m["name"]: m["value"] for m in tools.send("Performance.getMetrics")["metrics"]}
        memory.append((metrics["JSHeapUsedSize"], metrics["Nodes"]))
    shutil.rmtree(folder)
    context.close()
    heap, nodes = np.array(memory).T
    half = len(heap) // 2
    return {
        "edits": edits,
        "console_errors": len(errors),
        "claims_checked": claims,
        "satisfied": int(satisfied),
        "satisfied_but_refuted": int(refuted),
        "heap_mb_first_half": round(float(np.median(heap[:half])) / 1e6, 2),
        "heap_mb_second_half": round(float(np.median(heap[half:])) / 1e6, 2),
        "nodes_first_half": float(np.median(nodes[:half])),
        "nodes_second_half": float(np.median(nodes[half:])),
    }


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
                ("studio_bridge", lambda page: picture_trial(page, address)),
                ("studio_show", lambda page: picture_sample(page, sample)),
            ):
                page = browser.new_page(viewport=view, color_scheme=scheme)
                picture(page)
                page.evaluate("scrollTo(0, 0)")
                page.wait_for_timeout(300)
                page.screenshot(path=out / f"{name}{ending}.png")
                page.close()


def picture_scene(page: Page, address: str) -> None:
    page.goto(address)
    settle(page)
    page.locator("#guided .object[data-name=compact_printer]").focus()
    page.locator("#margins button.plain").first.click()


def picture_trial(page: Page, address: str) -> None:
    """Half-way through the trial, with the course of its third policy."""
    page.goto(f"{address}bridge.html")
    expect(page.locator("#status")).to_contain_text(re.compile("^Run:"), timeout=WAIT)
    page.locator("#policies button").nth(2).click()
    expect(page.locator("#courses .chart")).to_have_count(2, timeout=WAIT)
    page.locator("#time").fill("6")


def picture_sample(page: Page, address: str) -> None:
    page.goto(address)
    expect(page.locator("#status")).to_contain_text(re.compile("^Satisfied"), timeout=WAIT)
    page.locator("[data-agent='2']").press("Enter")


@contextmanager
def shown() -> Iterator[str]:
    """The address of the example of docs/studio.md, run as a script."""
    text = (Path(__file__).parent.parent / "docs" / "studio.md").read_text()
    (script,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    environment = {**os.environ, "BROWSER": "true"}
    command = [sys.executable, "-c", script]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("what", choices=("measure", "edit", "screenshots"))
    parser.add_argument("--minutes", type=float, default=20.0, help="of random editing")
    parser.add_argument("--moves", type=int, default=200, help="of the pointer that are timed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("docs"), help="folder of the screenshots")
    options = parser.parse_args()
    with studio() as address, chromium() as browser:
        if options.what == "measure":
            print(json.dumps(measure(browser, address, options.moves), indent=2))
        elif options.what == "edit":
            print(json.dumps(edit(browser, address, options.minutes, options.seed), indent=2))
        else:
            screenshots(browser, address, options.out)


if __name__ == "__main__":
    main()
