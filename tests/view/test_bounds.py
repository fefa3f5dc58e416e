"""Factors below their bounds: written as what the ending says, with every curve."""

import numpy as np
import pytest
import shapely

from deggflow.view.bounds import BoundPanel, bounds_figure, draw_bounds
from deggflow.view.style import GUIDED, NOMINAL

MAGIC = {"pdf": b"%PDF", "png": b"\x89PNG"}
TAU = np.linspace(0.0, 1.0, 21)


def panel(title="early", shift=0.0):
    bound = 3.0 - 2.0 * TAU**2
    return BoundPanel(title, TAU, bound - 0.3 * TAU, bound, shift)


@pytest.mark.parametrize("ending", MAGIC)
def test_bounds_are_written_by_the_ending_and_twice_the_same(tmp_path, ending):
    one, other = tmp_path / "new" / f"one.{ending}", tmp_path / f"other.{ending}"
    draw_bounds(one, [panel(), panel("late")], ylabel="$q$")
    draw_bounds(str(other), [panel(), panel("late")], ylabel="$q$")
    assert one.read_bytes().startswith(MAGIC[ending])
    assert one.read_bytes() == other.read_bytes()


def test_each_panel_shows_the_factor_the_bound_and_what_lies_below(paths_in):
    name = r"$q_\mathrm{safe}$"
    panels = [panel(), panel("late", shift=1.0)]
    figure = bounds_figure(panels, name=name)
    assert [axes.get_title() for axes in figure.axes] == ["early", "late"]
    assert figure.axes[0].get_ylabel() == name
    for axes, content in zip(figure.axes, panels, strict=True):
        bound, value = axes.lines
        assert (bound.get_label(), value.get_label()) == (r"$\beta_\mathrm{safe}$", name)
        assert bound.get_linestyle() == "--"
        np.testing.assert_allclose(value.get_ydata(), content.value - content.shift)
        np.testing.assert_allclose(bound.get_ydata(), content.bound - content.shift)
        (outline,) = paths_in(axes, "#e9eef3")
        region = shapely.Polygon(outline)
        middle = content.bound[10] - content.shift
        assert region.contains(shapely.Point(TAU[10], middle - 0.05))
        assert not region.contains(shapely.Point(TAU[10], middle + 0.05))


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
        bounds_figure([panel()._replace(nominal=nominal[:3])], name="$q$")


def test_panels_that_cannot_be_drawn_are_refused(tmp_path):
    with pytest.raises(ValueError, match="panels"):
        draw_bounds(tmp_path / "b.pdf", [], ylabel="$q$")
    with pytest.raises(ValueError, match="early"):
        draw_bounds(tmp_path / "b.pdf", [panel()._replace(value=TAU[:3])], ylabel="$q$")
    assert not list(tmp_path.iterdir())
