"""Figures of the report: what is given is drawn, with its interval, its colour and its unit."""

from itertools import pairwise

import numpy as np
import pytest

from deggflow.statistics import Rate
from deggflow.view.bands import Band, CurvePanel, band_of, draw_bands
from deggflow.view.distances import (
    BoundLine,
    Measured,
    RatioSeries,
    draw_bounds_over_size,
    draw_ratios,
)
from deggflow.view.evolution import LEAST, ViolationCurves, draw_violations
from deggflow.view.frontier import FLOOR, FrontierPoint, FrontierSeries, frontier
from deggflow.view.rates import (
    RateSeries,
    SuccessBars,
    rates_by_name,
    rates_over_size,
    success_bars,
)
from deggflow.view.sheet import picture_column, picture_row
from deggflow.view.style import GUIDED, NOMINAL, OTHERS, written

RATES = {4: Rate(44, 50), 8: Rate(8, 50)}
THREE = [Rate(9, 10), Rate(6, 10), Rate(10, 10)]
NAMES = {"xlabel": "number of robots $N$", "ylabel": "trials that bridge the gap (%)"}


def markers(axes):
    """The lines that have a marker at each of their points."""
    finite = (line for line in axes.lines if np.isfinite(np.asarray(line.get_ydata(), float)).all())
    return [line for line in finite if line.get_marker() == "o"]


def test_rates_stand_with_their_wilson_intervals(whiskers_in):
    ours, theirs = RateSeries("ours", GUIDED, RATES), RateSeries("paper", GUIDED, RATES, True)
    axes = rates_over_size([ours, theirs], seen=6).axes[0]
    whiskers = whiskers_in(axes, GUIDED)
    assert len(whiskers) == 4
    for line, hollow in zip(markers(axes), (False, True), strict=True):
        np.testing.assert_allclose(line.get_ydata(), [88, 16])
        ends = [[100 * end for end in rate.interval()] for rate in RATES.values()]
        own = whiskers[hollow::2]
        np.testing.assert_allclose(own[:, 0], line.get_xdata(), rtol=1e-6)
        np.testing.assert_allclose(own[:, 1:], ends, rtol=1e-6)
        assert np.round(line.get_xdata()).tolist() == [4, 8]
        assert line.get_color() == GUIDED
        assert line.get_linestyle() == ("None" if hollow else "-")
        assert line.get_markerfacecolor() == ("white" if hollow else GUIDED)
    assert "%" in axes.get_ylabel()
    names = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    assert names == ["ours", "paper"]


def test_rates_of_names_are_drawn_in_their_order_from_above():
    rates = {"one": Rate(1, 2), "other": Rate(2, 2)}
    axes = rates_by_name([RateSeries("ours", NOMINAL, rates)]).axes[0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["one", "other"]
    (line,) = markers(axes)
    np.testing.assert_allclose(line.get_xdata(), [50, 100])
    assert axes.get_ylim()[0] > axes.get_ylim()[1]


def test_violations_have_a_logarithmic_axis_and_the_colours_of_their_methods():
    tau = np.linspace(0, 1, 5)
    curves = ViolationCurves(tau, tau + 1, 1 - tau, 2 - 2 * tau, 2e-4)
    axes = draw_violations(curves).axes[0]
    assert axes.get_yscale() == "log"
    assert axes.get_ylim()[0] == LEAST
    assert "m$^2$" in axes.get_ylabel()
    nominal, guided, bound, enough = axes.lines
    assert (nominal.get_color(), guided.get_color()) == (NOMINAL, GUIDED)
    np.testing.assert_allclose(nominal.get_ydata(), tau + 1)
    assert 0 < guided.get_ydata()[-1] < LEAST
    assert bound.get_linestyle() == "--"
    np.testing.assert_allclose(enough.get_ydata(), 2e-4)
    with pytest.raises(ValueError, match="one length"):
        draw_violations(curves._replace(tau=tau[:3]))


def test_pictures_of_one_size_stand_in_a_row_without_empty_rows():
    images = [np.full((60, 80, 3), 255, np.uint8) for _ in range(2)]
    images[0][30:40, 5] = 0
    images[1][20:25, 9] = 0
    figure = picture_row(
        images, ("a", "b"), ("short", "a caption that is longer than its picture" * 3)
    )
    shown = [axes.images[0].get_array() for axes in figure.axes]
    assert {image.shape for image in shown} == {(22, 80, 3)}  # rows 19 to 40: one more at both ends
    np.testing.assert_array_equal(shown[0], images[0][19:41])
    assert [axes.get_title() for axes in figure.axes] == ["a", "b"]
    assert "\n" in figure.axes[1].get_xlabel()
    with pytest.raises((ValueError, TypeError)):  # TypeError: of the checks that tests switch on
        picture_row([images[0], images[1][1:]], ("a", "b"), ("", ""))
    blank = picture_row([np.zeros((6, 8, 3), np.uint8)], ("a",), ("",))
    assert blank.axes[0].images[0].get_array().shape == (6, 8, 3)


def test_bands_lie_one_deviation_around_the_mean_and_one_seed_has_none(paths_in):
    steps, losses = np.arange(1, 6) * 500, np.random.default_rng(0).random((3, 5))
    band = band_of(steps, losses)
    alone = Band(steps, losses[0], None)
    with_band, without = draw_bands(
        [CurvePanel("three", band, band), CurvePanel("one", alone, alone)], width=7.0
    ).axes
    assert (len(with_band.collections), len(without.collections)) == (2, 0)
    outline = max(paths_in(with_band, with_band.lines[0].get_color()), key=len)
    ends = band.mean - band.deviation, band.mean + band.deviation
    assert outline[:, 1].min() == pytest.approx(ends[0].min())
    assert outline[:, 1].max() == pytest.approx(ends[1].max())
    np.testing.assert_allclose(with_band.lines[0].get_xdata(), steps / 1000)


def test_ratios_are_in_percent_with_their_intervals_beside_the_papers(whiskers_in):
    ours = {4: Measured(0.2, 0.1, 0.4), 8: Measured(0.3, 0.2, 0.5)}
    left = RatioSeries("z", OTHERS[0], ours, {4: 0.206})
    right = RatioSeries("z", OTHERS[0], ours, {}, (0.98, 1.0))
    one, other = draw_ratios([("W2 (%)", [left]), ("spread (%)", [right])]).axes
    (line,) = (line for line in markers(one) if len(line.get_xdata()) == 2)
    np.testing.assert_allclose(line.get_ydata(), [20, 30])
    ends = whiskers_in(one, OTHERS[0])[:, 1:]
    np.testing.assert_allclose(ends, [[10, 40], [20, 50]], rtol=1e-6)
    (quoted,) = (
        line for line in one.lines if len(line.get_xdata()) == 1 and line.get_color() == OTHERS[0]
    )
    np.testing.assert_allclose(quoted.get_ydata(), [20.6])
    assert other.patches[0].get_y() == pytest.approx(98)
    assert other.patches[0].get_height() == pytest.approx(2)


def test_bounds_are_drawn_in_powers_of_ten_and_told_from_what_is_measured():
    lines = [
        BoundLine("W2", {4: np.log(0.1), 8: np.log(1.0)}, False),
        BoundLine("bound", {4: np.log(1e7), 8: 2_000.0}, True),
    ]
    axes = draw_bounds_over_size(lines).axes[0]
    measured, bound = axes.lines
    np.testing.assert_allclose(measured.get_ydata(), [-1, 0], atol=1e-12)
    np.testing.assert_allclose(bound.get_ydata(), [7, 2_000 / np.log(10)])
    assert measured.get_color() != bound.get_color()


@pytest.mark.parametrize("kind", ["png", "pdf"])
def test_a_figure_is_written_the_same_twice(kind):
    def figure():
        return rates_by_name([RateSeries("ours", NOMINAL, {"one": Rate(1, 2)})])

    assert written(figure(), kind) == written(figure(), kind)


def test_pictures_stand_below_each_other_under_their_titles():
    images = [np.full((20, 60, 3), shade, np.uint8) for shade in (10, 120, 240)]
    figure = picture_column(images, ["first", "second", "third"], width=3.0)
    assert [axes.get_title() for axes in figure.axes] == ["first", "second", "third"]
    places = [axes.get_position() for axes in figure.axes]
    assert all(lower.y1 < upper.y0 for upper, lower in pairwise(places))
    assert places[0].y1 < 1.0  # there is room for the first title
    size = figure.get_size_inches()
    for axes, image, place in zip(figure.axes, images, places, strict=True):
        np.testing.assert_array_equal(axes.images[0].get_array(), image)
        assert place.width * size[0] == pytest.approx(3.0)
        assert place.height * size[1] == pytest.approx(1.0)  # nothing is stretched


def test_pictures_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="one size"):
        picture_column([np.zeros((2, 3, 3), np.uint8), np.zeros((3, 3, 3), np.uint8)], ["a", "b"])
    with pytest.raises(ValueError, match="one or more"):
        picture_column([], [])


def test_bars_are_as_high_as_the_rates_and_their_whiskers_as_long_as_the_intervals(whiskers_in):
    bars = [
        SuccessBars("nominal", "#D55E00", THREE),
        SuccessBars("guided", "#0072B2", THREE[::-1], quoted=True),
    ]
    (axes,) = (figure := success_bars(["4", "5", "8 (unseen)"], bars, **NAMES)).axes
    assert {"xlabel": axes.get_xlabel(), "ylabel": axes.get_ylabel()} == NAMES
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["4", "5", "8 (unseen)"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["nominal", "guided"]
    rows, whiskers = axes.containers[::2], whiskers_in(axes, "#222222")
    assert len(whiskers) == 6
    for k, (each, container) in enumerate(zip(bars, rows, strict=True)):
        heights = [patch.get_height() for patch in container]
        np.testing.assert_allclose(heights, [100 * rate.proportion for rate in each.rates])
        assert {bool(patch.get_hatch()) for patch in container} == {each.quoted}
        expected = [[100 * end for end in rate.interval()] for rate in each.rates]
        np.testing.assert_allclose(whiskers[k::2, 1:], expected, rtol=1e-6)
    centres = np.array([[patch.get_x() + patch.get_width() / 2 for patch in c] for c in rows])
    # Each group stands over its name.
    np.testing.assert_allclose(centres.mean(axis=0), [0, 1, 2], atol=1e-12)


def test_bars_need_a_rate_for_each_group():
    with pytest.raises(ValueError, match="nominal"):
        success_bars(["4"], [SuccessBars("nominal", "#D55E00", THREE)], **NAMES)


def test_marks_on_the_frontier_are_whole_even_at_distance_zero():
    points = [FrontierPoint(Rate(1, 20), 0.0, True), FrontierPoint(Rate(20, 20), 2.0, False)]
    series = FrontierSeries("nominal", NOMINAL, "s", points, False)
    figure = frontier([("$N = 8$", [series])], unit="m")
    (axes,) = figure.axes
    figure.canvas.draw()
    left, bottom = axes.transAxes.transform((0.0, 0.0))
    half = 4.5 / 2 / 72 * figure.dpi  # of a mark, pixels
    for x, y in ((0.0, 95.0), (2.0, FLOOR)):
        place = axes.transData.transform((x, y))
        assert place[0] - half > left
        assert place[1] - half > bottom
    assert axes.get_xticks().min() <= 0.0
