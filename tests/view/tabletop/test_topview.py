"""The drawn top view: every object and region in it, blocked ones told apart without colour."""

import numpy as np
import pytest
from matplotlib.patches import Circle

from deggflow.tasks.tabletop.library import object_type
from deggflow.view.tabletop.topview import BLOCKED, FREE, topview_figure


def edges(figure):
    return [
        patch
        for patch in figure.axes[0].patches
        if isinstance(patch, Circle) and not patch.get_fill()
    ]


def test_all_objects_are_named_and_all_regions_drawn(everything):
    condition, poses = everything
    figure = topview_figure(condition, poses)
    names = {text.get_text() for text in figure.axes[0].texts}
    assert names == {name.replace("_", " ") for name in condition.objects}
    assert len(edges(figure)) == sum(len(object_type(name).regions) for name in condition.objects)
    assert "(m)" in figure.axes[0].get_xlabel()
    assert "(m)" in figure.axes[0].get_ylabel()


def test_blocked_regions_are_hatched_and_dashed_and_lie_where_they_should(trio_blocked):
    figure = topview_figure(*trio_blocked)
    laptop, mug, _ = edges(figure)
    np.testing.assert_allclose(laptop.center, [-0.045, 0.0], atol=1e-9)
    assert laptop.get_hatch()
    assert laptop.get_linestyle() != "-"
    assert not mug.get_hatch()
    assert mug.get_linestyle() in ("-", "solid")
    assert FREE != BLOCKED


@pytest.mark.parametrize("ending", ["pdf", "svg"])
def test_it_can_be_saved_as_vector_graphics(trio, tmp_path, ending):
    path = tmp_path / f"scene.{ending}"
    topview_figure(*trio).savefig(path)
    assert path.stat().st_size > 5_000
