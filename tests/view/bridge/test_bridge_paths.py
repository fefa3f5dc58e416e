"""Paths of planks: written as what the ending says, counted in the legend."""

import numpy as np
import pytest

from deggflow.view.bridge import PathGroup, draw_paths

MAGIC = {"pdf": b"%PDF", "png": b"\x89PNG"}


@pytest.mark.parametrize("ending", MAGIC)
def test_paths_are_written_by_the_ending_and_twice_the_same(tmp_path, ending):
    groups = [PathGroup("left", "#0072B2", [np.zeros((3, 2)), np.ones((5, 2))])]
    one, other = tmp_path / "new" / f"one.{ending}", tmp_path / f"other.{ending}"
    draw_paths(one, groups)
    draw_paths(str(other), groups)
    assert one.read_bytes().startswith(MAGIC[ending])
    assert one.read_bytes() == other.read_bytes()


def test_the_legend_counts_the_paths_of_each_group(monkeypatch, tmp_path):
    groups = [
        PathGroup("left", "#0072B2", [np.zeros((3, 2))] * 4),
        PathGroup("right", "#D55E00", []),
    ]
    figures = []
    monkeypatch.setattr("deggflow.view.style.save_figure", lambda _, figure: figures.append(figure))
    draw_paths(tmp_path / "w.pdf", groups)
    (figure,) = figures
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["left (4)", "right (0)"]
