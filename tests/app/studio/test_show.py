"""`deggflow.studio.show`: a page on a sample of any problem in the plane."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import deggflow.studio
from deggflow.requirements import Layout
from deggflow.studio.problem import problem_json
from deggflow.studio.showing import show

PAGE = Path(__file__).parents[3] / "docs" / "studio.md"


@pytest.fixture(scope="module")
def made():
    """What the example of the docs shows."""
    (script,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(deggflow.studio, "show", lambda *given: shown.append(given))
        exec(script, {})
    return shown[0]


def test_it_shows_what_the_certificate_says(made):
    problem = problem_json(*made, layout=Layout(axes=2), agents=["ann"])
    certificate = deggflow.certify(*made)
    assert problem["satisfied"] == certificate.satisfied
    assert problem["agents"] == ["ann", *(f"agent {k}" for k in range(1, 5))]
    np.testing.assert_allclose(np.array(problem["states"])[:, :, 0], made[0].path, atol=1e-5)
    (margins,) = problem["margins"]
    assert min(margins) == pytest.approx(certificate.min_margin)
    assert np.array(problem["inputs"]).shape == (len(problem["tau"]), 5)
    assert len(problem["trace"]["tau"]) == len(problem["tau"])


def test_poses_and_trajectories_are_read_by_their_layout(made):
    """Four numbers an agent: two waypoints, or a position with a heading as a vector."""
    sample, guidance, condition = made
    upward = np.broadcast_to(np.array([0.0, 2.0], np.float32), sample.path.shape)
    turned = np.concatenate([sample.path, upward], axis=-1)
    wide = sample._replace(path=turned, z=turned[-1])
    wide = wide._replace(summary=wide.summary._replace(z0=turned[0]))
    poses = problem_json(wide, guidance, condition, layout=Layout(axes=2, heading="vector"))
    np.testing.assert_allclose(np.array(poses["states"])[..., 2], np.pi / 2, atol=1e-5)
    paths = problem_json(wide, guidance, condition, layout=Layout(axes=2, waypoints=2))
    assert np.array(paths["states"])[0].shape == (5, 2, 2)


def test_regions_with_different_numbers_of_corners(made):
    """Each time: shape checks look at one region of a sequence, chosen at random."""
    regions = [np.stack([np.arange(k), np.arange(k) ** 2], axis=1) / 10 for k in range(3, 11)]
    for _ in range(20):
        problem = problem_json(*made, layout=Layout(axes=2), regions=regions)
        assert [len(region) for region in problem["regions"]] == [*range(3, 11)]


@pytest.mark.parametrize(
    ("change", "error"),
    [({"path": None}, "must be one generation with its path"), ({"path": jnp.full((101, 5, 2), jnp.nan)}, "finite states")],
)  # fmt: skip
def test_what_cannot_be_shown_is_refused(made, change, error):
    with pytest.raises(ValueError, match=f"`sample` must .*{error}|{error}"):
        show(made[0]._replace(**change), *made[1:], browser=False, block=False)
    with pytest.raises(ValueError, match="`layout` must have 2 axes"):
        show(*made, layout=Layout(), browser=False, block=False)


@pytest.mark.slow
def test_the_page_in_a_browser(made, browser, monkeypatch):
    """At a prompt, the page does not block."""
    monkeypatch.setattr("sys.ps1", ">>> ", raising=False)
    square = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    shown = show(*made, regions=[square], browser=False)
    page, errors = browser.new_page(), []
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)  # fmt: skip
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(shown.url)
    page.locator("#status", has_text=re.compile("^Satisfied")).wait_for(timeout=1_800_000)
    agent = page.locator("[data-agent='1'] circle")
    place = [agent.get_attribute("cx"), agent.get_attribute("cy")]
    assert [float(each) for each in place] == pytest.approx(np.asarray(made[0].z[1]), abs=1e-5)
    page.locator("#tau").press("Home")
    assert [agent.get_attribute("cx"), agent.get_attribute("cy")] != place
    assert page.locator("#charts .chart").count() == 2
    page.locator("[data-agent='1']").press("Enter")
    assert "|u| of agent 1" in page.locator("#charts").text_content()
    assert page.locator("#margins tr[aria-selected=true]").inner_text().startswith("agent 1")
    assert page.locator(".obstacle").count() == 1
    page.close()
    shown.close()
    assert errors == []
