"""The bridge's page in a real browser: what a user does with mouse and keyboard."""

import json
import re

import pytest
from imageio_ffmpeg import count_frames_and_secs

from deggflow.tasks.bridge.formats import read_trials
from deggflow.tasks.bridge.oracle import refutation

api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.slow

CONDITION = {
    "plank": {"x": -3.2, "y": -1.4, "theta": 0.2},
    "goal": {"x": -0.2, "y": -1.2, "theta": -0.3},
    "contacts": [[-2.4, -0.36], [-2.4, 0.36], [-1.2, 0.36], [-1.3, -0.36]],
}
STATE = {"condition": CONDITION, "seed": 1, "maxDraws": 1, "speedLimit": None, "live": True}
WAIT = 1_800_000  # ms; the first trial is compiled, on a machine that may be busy


@pytest.fixture
def page(browser, served):
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    key = json.dumps(json.dumps(STATE))
    context.add_init_script(f"sessionStorage.setItem('deggflow-studio-bridge', {key})")
    page, errors = context.new_page(), []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)  # fmt: skip
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(f"{served.address}bridge.html")
    settle(page)
    yield page
    context.close()
    assert errors == []


def settle(page):
    api.expect(page.locator("#status")).to_contain_text(re.compile("^(Run|From a file):"), timeout=WAIT)  # fmt: skip
    api.expect(page.locator("#trial")).to_have_attribute("aria-busy", "false", timeout=WAIT)


def saved(page, folder):
    path = download(page, "#save", folder)
    (trial,) = read_trials(path)
    return trial, json.loads(path.read_text())


def download(page, selector, folder):
    with page.expect_download(timeout=WAIT) as waiting:
        page.locator(selector).click()
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


def drag(page, grip, right, up):
    box = page.locator(f"[data-grip={grip}]").bounding_box()
    # A corner of the box of a slanted plank lies beside it: its middle is pressed.
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + right, y - up, steps=5)
    page.mouse.up()


def test_a_trial_runs_is_certified_and_played_to_its_end(page, tmp_path):
    trial, line = saved(page, tmp_path)
    assert trial.success
    assert trial.certificate.satisfied
    assert refutation(line) is None
    assert page.locator("#policies tbody tr").count() == len(trial.certificate.policies)
    assert page.locator("#factors .chart").count() == 2
    assert page.locator("#world .twin .path").get_attribute("d").startswith("M-3.2 -1.4L")
    end = page.locator("#world .team > g").get_attribute("transform")
    page.locator("#time").press("Home")
    assert page.locator("#world .team > g").get_attribute("transform") != end
    page.locator("#speed").select_option("4")
    page.locator("#play").click()
    api.expect(page.locator("#play")).to_have_text("Stop")
    api.expect(page.locator("#play")).to_have_text("Play", timeout=WAIT)
    assert page.locator("#world .team > g").get_attribute("transform") == end
    page.locator("#policies button").nth(1).click()
    api.expect(page.locator("#courses .chart")).to_have_count(2, timeout=WAIT)


def test_plank_goal_and_contacts_are_dragged(page, tmp_path):
    drag(page, "plank", -20, 40)
    settle(page)
    drag(page, "goal-turn", 0, 15)
    settle(page)
    drag(page, "contact-2", -15, 0)
    settle(page)
    trial, line = saved(page, tmp_path)
    condition = trial.condition
    assert condition.plank[0] < -3.2
    assert condition.plank[1] > -1.4
    assert condition.plank[2] == 0.2
    assert condition.goal[:2] == (-0.2, -1.2)
    assert condition.goal[2] > -0.3
    assert condition.contacts[2][0] < -1.2
    assert condition.contacts[2][1] == 0.36
    assert trial.certificate.satisfied == (trial.reason is None)
    assert refutation(line) is None


def test_keys_do_what_the_mouse_does(page, tmp_path):
    for grip, keys in (
        ("plank", "ArrowUp q"),
        ("goal", "Shift+ArrowLeft"),
        ("contact-0", "ArrowRight"),
    ):
        for key in keys.split():
            page.locator(f"[data-grip={grip}]").press(key)
            settle(page)
    condition = saved(page, tmp_path)[0].condition
    assert condition.plank == pytest.approx((-3.2, -1.3, 0.2 + 0.0873), abs=1e-3)
    assert condition.goal == pytest.approx((-0.21, -1.2, -0.3))
    assert condition.contacts[0] == pytest.approx((-2.35, -0.36))
    assert "x -3.2 m, y -1.3 m" in page.locator("[data-grip=plank]").get_attribute("aria-valuetext")


def test_a_trial_that_cannot_begin_says_why(page, tmp_path):
    page.locator("#plank-x").fill("-6.5")
    page.locator("#plank-x").press("Enter")
    settle(page)
    assert "the plank leaves the workspace" in page.locator("#unmet").inner_text()
    assert page.locator(".start-place.wrong").count() == 1
    assert page.locator("#world .failed").count() == 1
    video = download(page, "#film", tmp_path)  # of one picture
    assert count_frames_and_secs(str(video))[0] == 1 + 20
    api.expect(page.locator(".film")).to_be_hidden()


def test_files_go_out_and_in(page, tmp_path):
    path = download(page, "#save", tmp_path)
    (tmp_path / "bad.jsonl").write_text('{"plank": 1}\n')
    page.locator("#open").set_input_files(tmp_path / "bad.jsonl")
    api.expect(page.locator("#trouble")).to_contain_text("bad.jsonl, line 1, field")
    page.locator("#open").set_input_files(path)
    api.expect(page.locator("#status")).to_contain_text(re.compile("^From a file: bridge built"))
    assert "agrees" in page.locator("#facts").inner_text()
    page.locator("#keep").click()
    api.expect(page.locator("#gallery li")).to_have_count(2)  # the one that was opened, too
    page.locator("#gallery .open").first.click()
    settle(page)
    kept = read_trials(download(page, "#save-all", tmp_path))
    assert [each.seed for each in kept] == [1, 1]
    page.locator("#gallery .remove").first.click()
    api.expect(page.locator("#gallery li")).to_have_count(1)


def test_a_margin_is_shown_where_and_when_it_is(page):
    row = page.locator("#margins tbody tr").first
    name, time, margin = row.inner_text().split("\t")
    assert re.search("plank|robot", name)
    row.locator("button").click()
    assert page.locator("#time-text").inner_text() == f"{time} s"
    assert page.locator("#world .gap line").count() == 1
    assert page.locator("#world .gap-text").text_content() == f"{margin} mm"
    page.locator("#solid summary").click()
    api.expect(page.locator("#solid canvas")).to_have_attribute("data-bodies", re.compile("plank robot_1"), timeout=WAIT)  # fmt: skip
