"""Plots of bounds and ways: written as what the ending says, with what was given in them."""

import numpy as np
import pytest

from deggflow.view.bridge import BoundPanel, PathGroup, bounds_figure, draw_bounds, draw_paths
from deggflow.view.style import GUIDED, NOMINAL

MAGIC = {"pdf": b"%PDF", "png": b"\x89PNG"}
TAU = np.linspace(0.0, 1.0, 21)


def panel(title="early", shift=0.0):
    bound = 3.0 - 2.0 * TAU**2
    return BoundPanel(title, TAU, bound - 0.3 * TAU, bound, shift)


def drawn(monkeypatch, plot, *arguments, **more):
    """The figure that a plot would write."""
    figures = []
    monkeypatch.setattr(
        "deggflow.view.bridge.plots._save", lambda figure, _: figures.append(figure)
    )
    plot(*arguments, **more)
    return figures[0]


@pytest.mark.parametrize("ending", MAGIC)
def test_both_plots_are_written_by_the_ending_and_twice_the_same(tmp_path, ending):
    ways = [PathGroup("left", "#0072B2", [np.zeros((3, 2)), np.ones((5, 2))])]
    for plot, content in ((draw_bounds, [panel(), panel("late")]), (draw_paths, ways)):
        one, other = tmp_path / "new" / f"one.{ending}", tmp_path / f"other.{ending}"
        plot(one, content)
        plot(str(other), content)
        assert one.read_bytes().startswith(MAGIC[ending])
        assert one.read_bytes() == other.read_bytes()


def test_each_panel_shows_the_factor_the_bound_and_what_lies_below(monkeypatch, tmp_path):
    name = r"$q_\mathrm{safe}$"
    panels = [panel(), panel("late", shift=1.0)]
    figure = drawn(monkeypatch, draw_bounds, tmp_path / "b.pdf", panels, ylabel=name)
    assert [axes.get_title() for axes in figure.axes] == ["early", "late"]
    assert figure.axes[0].get_ylabel() == name
    for axes, content in zip(figure.axes, panels, strict=True):
        bound, value = axes.lines
        assert (bound.get_label(), value.get_label()) == (r"$\beta_\mathrm{safe}$", name)
        assert bound.get_linestyle() == "--"
        np.testing.assert_allclose(value.get_ydata(), content.value - content.shift)
        np.testing.assert_allclose(bound.get_ydata(), content.bound - content.shift)
        region = axes.collections[0].get_paths()[0]
        middle = content.bound[10] - content.shift
        assert region.contains_point((TAU[10], middle - 0.05))
        assert not region.contains_point((TAU[10], middle + 0.05))


def test_the_nominal_course_is_shown_beside_the_guided_one_in_its_own_colour():
    nominal = 2.9 + 0.5 * TAU
    shifted = panel(shift=1.0)._replace(nominal=nominal)
    figure = bounds_figure([panel(), shifted], name=r"$q_\mathrm{safe}$", ylabel="shifted")
    assert figure.axes[0].get_ylabel() == "shifted"
    assert all("tau" in axes.get_xlabel() for axes in figure.axes)
    assert len(figure.axes[0].lines) == 2
    bound, guided, line = figure.axes[1].lines
    np.testing.assert_allclose(line.get_ydata(), nominal - 1.0)
    np.testing.assert_allclose(guided.get_ydata() - bound.get_ydata(), -0.3 * TAU)
    low, high = figure.axes[1].get_ylim()
    assert low < min(line.get_ydata().min(), guided.get_ydata().min())
    assert high > line.get_ydata().max()
    assert (guided.get_color(), line.get_color()) == (GUIDED, NOMINAL)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == [each.get_label() for each in (bound, guided, line)]
    with pytest.raises(ValueError, match="nominal"):
        bounds_figure([panel()._replace(nominal=nominal[:3])])


def test_the_legend_counts_the_ways_of_each_group(monkeypatch, tmp_path):
    groups = [
        PathGroup("left", "#0072B2", [np.zeros((3, 2))] * 4),
        PathGroup("right", "#D55E00", []),
    ]
    figure = drawn(monkeypatch, draw_paths, tmp_path / "w.pdf", groups)
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["left (4)", "right (0)"]


def test_panels_that_cannot_be_drawn_are_refused(tmp_path):
    with pytest.raises(ValueError, match="panels"):
        draw_bounds(tmp_path / "b.pdf", [])
    with pytest.raises(ValueError, match="early"):
        draw_bounds(tmp_path / "b.pdf", [panel()._replace(value=TAU[:3])])
    assert not list(tmp_path.iterdir())
