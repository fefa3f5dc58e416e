"""The tabletop's page in a real browser: what a user does with mouse and keyboard, without a network."""

import json
import re
from io import BytesIO
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from PIL import Image

from deggflow.jsonl import InputError, read_lines
from deggflow.tasks.tabletop.formats import parse_condition, read_scenes
from deggflow.tasks.tabletop.oracle import refutes

api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.slow

SCENE = {
    "objects": ["laptop", "desk_lamp", "handled_mug", "potted_plant"],
    "requirements": {"laptop": {"direction": 3.1, "radius_scale": 1.2}},
}
STATE = {"condition": SCENE, "seed": 3, "maxDraws": 2, "draw": None, "live": True, "gallery": []}
WAIT = 1_800_000  # ms; the first scene is compiled, on a machine that may be busy


class Page:
    """A page of the studio, and what it said on its console."""

    def __init__(self, browser, served, state=STATE):
        self.context = browser.new_context(viewport={"width": 1280, "height": 900})
        key = json.dumps(json.dumps(state))
        self.context.add_init_script(
            f"if (!sessionStorage.getItem('deggflow-studio')) sessionStorage.setItem('deggflow-studio', {key})"
        )
        self.page, self.errors, self.requests = self.context.new_page(), [], []
        self.page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)  # fmt: skip
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(served.address)
        self.settle()

    def __call__(self, selector):
        return self.page.locator(selector)

    def settle(self):
        """Until nothing is under way."""
        api.expect(self("#status")).to_contain_text(re.compile("^(Generated|Moved|Edited|From)"), timeout=WAIT)  # fmt: skip
        api.expect(self("#scene")).to_have_attribute("aria-busy", "false", timeout=WAIT)

    def places(self, picture="guided"):
        """Transforms of all objects."""
        return [each.get_attribute("transform") for each in self(f"#{picture} .object").all()]

    def set(self, field, value):
        self(f"#{field}").fill(str(value))
        self(f"#{field}").press("Enter")

    def drag(self, selector, right, up, steps=6):
        self(selector).first.scroll_into_view_if_needed()
        box = self(selector).first.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for k in range(1, steps + 1):
            self.page.mouse.move(x + right * k / steps, y - up * k / steps)
        self.page.mouse.up()

    def download(self, selector, folder):
        with self.page.expect_download(timeout=WAIT) as waiting:
            self(selector).click()
        path = folder / waiting.value.suggested_filename
        waiting.value.save_as(path)
        return path


@pytest.fixture
def page(browser, served):
    page = Page(browser, served)
    yield page
    page.context.close()
    assert page.errors == []


def saved(page, folder):
    (scene,) = read_scenes(page.download("#save", folder))
    return scene


def test_it_loads_without_a_network_and_shows_a_certified_scene(page, served):
    assert page.requests
    assert all(address.startswith(served.address) for address in page.requests)
    assert "all requirements hold" in page("#status").inner_text()
    assert page("#guided .object").count() == len(SCENE["objects"])
    assert page("#nominal .object").count() == len(SCENE["objects"])
    assert page("#margins tbody tr").count() == 12
    assert "deggflow tabletop generate" in page("#command").inner_text()


def test_a_direction_is_dragged_and_the_certificate_holds(page, tmp_path):
    before = page.places()
    page("#guided .object[data-name=laptop]").focus()
    page.drag("[data-handle=region]", 90, 60)
    page.settle()
    assert page.places() != before
    scene = saved(page, tmp_path)
    need = scene.condition.requirements["laptop"]
    assert (need.direction, need.offset_scale) != (3.1, 1.0)
    assert need.radius_scale == 1.2
    assert scene.certificate.satisfied
    assert not refutes(scene.condition, scene.poses)
    assert float(page("#direction").input_value()) == pytest.approx(np.degrees(need.direction), abs=0.1)  # fmt: skip


def test_every_edit_has_its_keys(page, tmp_path):
    """Handles and objects are reached by Tab and moved by arrow keys."""
    page("#guided .object[data-name=laptop]").focus()
    page("[data-handle=region]").press("ArrowLeft")
    page.settle()
    # An outline of 2 px would be 2 m wide in a picture.
    style = "getComputedStyle(document.activeElement).outlineStyle"
    assert page.page.evaluate(style) == "none"
    page("[data-handle=radius]").press("ArrowUp")
    page.settle()
    page("[data-handle=table]").press("ArrowRight")
    page.settle()
    condition = saved(page, tmp_path).condition
    need = condition.requirements["laptop"]
    assert need.direction == pytest.approx(3.1 + np.pi / 36 - 2 * np.pi, abs=1e-3)
    assert need.radius_scale == pytest.approx(1.25)
    assert condition.width == pytest.approx(1.45)
    page("#guided .object[data-name=laptop]").focus()
    for _ in range(45):
        page.page.keyboard.press("ArrowRight")
    page.settle()
    assert page("#status").inner_text().startswith("Moved by hand")
    assert "laptop" in page("#unmet").inner_text()
    page("#undo-move").click()
    page.settle()
    assert page("#status").inner_text().startswith("Generated: all requirements hold")


def test_an_object_dragged_by_hand_breaks_promises_where_it_is(page, tmp_path):
    lamp = page("#guided .object[data-name=desk_lamp]").bounding_box()
    mug = page("#guided .object[data-name=handled_mug]").bounding_box()
    page.drag("#guided .object[data-name=desk_lamp] .footprint", mug["x"] - lamp["x"], lamp["y"] - mug["y"])  # fmt: skip
    page.settle()
    assert page("#status").inner_text().startswith("Moved by hand")
    assert "overlap" in page("#unmet").inner_text()
    assert page("#guided .object.outlined").count() == 2
    assert "overlap" in " ".join(page("#guided .breach").all_text_contents())
    scene = saved(page, tmp_path)
    assert not scene.certificate.satisfied
    assert refutes(scene.condition, scene.poses)


def test_what_cannot_be_met_is_named_on_the_picture(page, tmp_path):
    page.set("width", 0.3)
    page.settle()
    page.set("depth", 0.25)
    page.settle()
    reason = page("#guided-caption").inner_text()
    assert "more)" in reason
    assert page("#unmet li").count() == page("#guided .breach").count() == 6
    scene = saved(page, tmp_path)
    assert not scene.certificate.satisfied
    assert scene.certificate.reason.replace("_", " ").startswith(reason)


def test_a_margin_is_shown_where_it_is(page):
    button = page("#margins button.plain").first
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    assert page("#guided .gap:not(.breaches) line").count() == 1
    number = page("#margins tbody tr .number").first.inner_text()
    assert page("#guided .gap-text").text_content() == f"{number} mm"
    button.click()
    assert page("#guided .gap:not(.breaches) line").count() == 0


def numbers(places):
    return [[float(number) for number in re.findall(r"-?[0-9.]+", place)] for place in places]


def test_the_slider_replays_the_generation(page):
    """Guidance begins at the nominal scene, whose own generation begins at z(0)."""
    end = page.places(), page.places("nominal")
    page("#tau").press("Home")
    api.expect(page("#tau-text")).to_have_text("τ = 0.00", timeout=WAIT)
    api.expect(page("#guided")).to_have_class(re.compile("replaying"), timeout=WAIT)
    begin = numbers(page.places())
    for (*place, angle), (*nominal, turned) in zip(begin, numbers(end[1]), strict=True):
        assert place == pytest.approx(nominal, abs=1e-3)  # m
        assert angle == pytest.approx(turned, abs=0.1)  # degrees
    assert page.places("nominal") != end[1]
    page("#tau").press("End")
    api.expect(page("#guided")).not_to_have_class(re.compile("replaying"))
    assert (page.places(), page.places("nominal")) == end
    assert page("#charts .chart").count() == 1
    page("#play").click()
    api.expect(page("#play")).to_have_text("Stop")
    api.expect(page("#play")).to_have_text("Play", timeout=WAIT)
    assert page.places() == end[0]


def test_the_bodies_are_seen_from_any_side(page):
    """The 3-D view is what the GLB file holds, turned by keys, and follows what is moved by hand."""
    page("#solid summary").click()
    canvas = page("#solid canvas")
    api.expect(canvas).to_have_attribute("data-bodies", re.compile("laptop"), timeout=WAIT)

    def picture():
        page.page.wait_for_timeout(200)  # a frame
        with Image.open(BytesIO(canvas.screenshot())) as shot:
            return np.asarray(shot.convert("RGB"), float)

    first = picture()
    assert first.std() > 20
    canvas.press("ArrowRight")
    turned = picture()
    assert np.abs(turned - first).mean() > 1
    canvas.press("0")
    assert np.abs(picture() - first).mean() < 0.5
    page("#guided .object[data-name=laptop]").focus()
    for _ in range(4):
        page.page.keyboard.press("ArrowUp")
    page.settle()
    assert 0.01 < np.abs(picture() - first).mean() < 20


def test_a_video_holds_nothing_up_and_can_be_stopped(page):
    page("#film").click()
    api.expect(page(".film span")).to_have_text(re.compile("picture|starting"), timeout=WAIT)
    places = page.places()
    page.set("seed", 4)
    page.settle()
    assert page.places() != places
    assert page("#film").is_disabled()
    page("#stop-film").click()
    api.expect(page(".film")).to_be_hidden()
    assert page("#film").is_enabled()
    assert page("#trouble").is_hidden()


@pytest.mark.parametrize("text", ['{"objects": ["lapdog"]}', "nonsense", '{"objects": ["laptop"], "seeed": 1}'])  # fmt: skip
def test_a_bad_file_has_the_error_of_the_commands(page, tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wishes.jsonl").write_text(text + "\n")
    with pytest.raises(InputError) as expected:
        read_lines("wishes.jsonl", parse_condition, "tabletop condition")
    before = page.places()
    page("#open").set_input_files(tmp_path / "wishes.jsonl")
    api.expect(page("#trouble")).to_have_text(str(expected.value))
    assert page.places() == before
    page.set("seed", 4)  # and the page goes on
    page.settle()
    api.expect(page("#trouble")).to_be_hidden()
    assert page.places() != before


def test_every_export_opens_again(page, tmp_path):
    line = page.download("#save", tmp_path)
    (scene,) = read_scenes(line)
    svg = page.download("[data-export=svg]", tmp_path)
    assert ElementTree.parse(svg).getroot().tag.endswith("svg")
    png = page.download("[data-export=png]", tmp_path)
    with Image.open(png) as picture:
        assert picture.size == (960, 720)
    model = mujoco.MjModel.from_xml_path(str(page.download("[data-export=mjcf]", tmp_path)))
    assert model.body("laptop").pos[:2] == pytest.approx(scene.poses[0, :2], abs=1e-5)
    model = page.download("[data-export=glb]", tmp_path).read_bytes()
    size = int.from_bytes(model[12:16], "little")
    assert {node.get("name") for node in json.loads(model[20 : 20 + size])["nodes"]} >= {*SCENE["objects"], "table"}  # fmt: skip
    page("#keep").click()
    page.set("seed", 5)
    page.settle()
    page("#keep").click()
    api.expect(page("#gallery li")).to_have_count(2)
    kept = page.download("#save-all", tmp_path)
    assert [each.seed for each in read_scenes(kept)] == [3, 5]
    page("#open").set_input_files(kept)
    api.expect(page("#gallery li")).to_have_count(4)
    page.settle()
    assert page("#status").inner_text().startswith("From a file: all requirements hold")


def test_two_pages_do_not_mix(page, browser, served):
    other = Page(browser, served, {**STATE, "seed": 8})
    before = page.places()
    assert other.places() != before
    other.set("seed", 9)
    other.settle()
    assert page.places() == before
    assert page("#seed").input_value() == "3"
    other.context.close()
    page.set("seed", 8)
    page.settle()
    assert page.places() != before
    assert other.errors == []


def test_everything_that_takes_the_focus_has_a_name(page):
    tree = page.context.new_cdp_session(page.page).send("Accessibility.getFullAXTree")
    focusable = [
        node
        for node in tree["nodes"]
        if any(each["name"] == "focusable" and each["value"].get("value") for each in node.get("properties", ()))
        and node["role"]["value"] != "RootWebArea"
    ]  # fmt: skip
    assert len(focusable) > 40
    nameless = [node["role"] for node in focusable if not node.get("name", {}).get("value") and node["role"]["value"] != "main"]  # fmt: skip
    assert nameless == []


def test_the_page_survives_a_restart_of_the_server(browser, served):
    page = Page(browser, served)
    served.stop()
    api.expect(page("#trouble")).to_contain_text("The studio has stopped", timeout=WAIT)
    places = page.places()
    page.set("seed", 6)
    assert page.places() == places
    served.start()
    api.expect(page("#trouble")).to_be_hidden(timeout=WAIT)
    page("#generate").click()
    page.settle()
    assert page.places() != places
    assert all("ERR_CONNECTION_REFUSED" in each or "WebSocket" in each for each in page.errors)
    page.context.close()


EDITS = 6


def test_random_edits_leave_no_error_and_no_rubbish(page, tmp_path):
    """`benchmarks/studio.py measure --minutes 20` does so for longer."""
    rng = np.random.default_rng(0)
    tools = page.context.new_cdp_session(page.page)
    tools.send("Performance.enable")

    def nodes():
        tools.send("HeapProfiler.collectGarbage")
        metrics = tools.send("Performance.getMetrics")["metrics"]
        return next(each["value"] for each in metrics if each["name"] == "Nodes")

    counts = []
    for edit in range(EDITS):
        name = rng.choice(SCENE["objects"])
        page(f"#guided .object[data-name={name}]").focus()
        handle = rng.choice(["region", "radius"])
        right, up = rng.uniform(-40, 40, 2)
        page.drag(f"[data-handle={handle}]", right, up, steps=3)
        page.settle()
        scene = saved(page, tmp_path)
        assert scene.certificate.satisfied != refutes(scene.condition, scene.poses)
        if edit in (2, EDITS - 1):
            counts.append(nodes())
    assert counts[1] < 1.1 * counts[0]
