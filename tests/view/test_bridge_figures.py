"""Figures of the report on the bridge: what is given is what is drawn."""

from itertools import pairwise

import numpy as np
import pytest

from deggflow.statistics import Rate
from deggflow.view.bridge import SuccessBars, picture_column, success_bars

RATES = [Rate(9, 10), Rate(6, 10), Rate(10, 10)]


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


def test_bars_are_as_high_as_the_shares_and_their_whiskers_as_long_as_the_intervals():
    bars = [
        SuccessBars("nominal", "#D55E00", RATES),
        SuccessBars("guided", "#0072B2", RATES[::-1], quoted=True),
    ]
    (axes,) = (figure := success_bars(["4", "5", "8 (unseen)"], bars)).axes
    assert "%" in axes.get_ylabel()
    assert axes.get_xlabel()
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["4", "5", "8 (unseen)"]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["nominal", "guided"]
    drawn, whiskers = axes.containers[::2], axes.containers[1::2]
    for each, container, whisker in zip(bars, drawn, whiskers, strict=True):
        heights = [patch.get_height() for patch in container]
        np.testing.assert_allclose(heights, [100 * rate.proportion for rate in each.rates])
        assert {bool(patch.get_hatch()) for patch in container} == {each.quoted}
        ends = np.array([segment[:, 1] for segment in whisker.lines[2][0].get_segments()])
        expected = [[100 * end for end in rate.interval()] for rate in each.rates]
        np.testing.assert_allclose(ends, expected, atol=1e-9)
    centres = np.array([[patch.get_x() + patch.get_width() / 2 for patch in c] for c in drawn])
    np.testing.assert_allclose(
        centres.mean(axis=0), [0, 1, 2], atol=1e-12
    )  # each group over its name


def test_bars_need_a_rate_for_each_group():
    with pytest.raises(ValueError, match="nominal"):
        success_bars(["4"], [SuccessBars("nominal", "#D55E00", RATES)])
