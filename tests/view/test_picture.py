"""Pictures beside each other and as files."""

import imageio.v3 as iio
import numpy as np
import pytest

from deggflow.view.picture import panels, save_png


def test_a_row_holds_both_pictures_titles_and_captions():
    left, right = np.full((240, 320, 3), 40, np.uint8), np.full((240, 320, 3), 200, np.uint8)
    titles = ("Nominal", "Guided")
    long = "affordance region 1 of drawer_organizer reaches 0.0537 m over the edge (and 7 more)"
    plain = panels([left, right], titles=titles)
    captioned = panels([left, right], titles=titles, captions=(long, "every requirement holds"))
    assert np.sum(np.all(plain == 40, axis=-1)) > 0.9 * 240 * 320
    assert np.sum(np.all(plain == 200, axis=-1)) > 0.9 * 240 * 320
    assert captioned.shape[0] > plain.shape[0]
    assert plain[:20].min() < 100  # titles
    below = np.any(captioned[-15:] < 150, axis=(0, 2)).nonzero()[0]  # columns with letters in them
    assert below.min() >= 4  # even a long caption stays below its picture
    gap = captioned.shape[1] // 2
    assert not np.any((below > gap - 3) & (below < gap + 3))


def test_pictures_of_different_heights_do_not_stand_in_a_row():
    with pytest.raises(ValueError, match="height"):
        panels([np.zeros((8, 8, 3), np.uint8), np.zeros((9, 8, 3), np.uint8)], titles=("a", "b"))


def test_pictures_of_different_widths_stand_in_a_row():
    """Each time: shape checks look at one picture of a sequence, chosen at random."""
    images = [np.zeros((8, 8 + k, 3), np.uint8) for k in range(8)]
    shapes = {panels(images, titles="abcdefgh").shape for _ in range(20)}
    assert len(shapes) == 1


def test_a_saved_picture_can_be_read(tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (30, 40, 3), np.uint8)
    save_png(tmp_path / "new" / "scene.png", image)
    np.testing.assert_array_equal(iio.imread(tmp_path / "new" / "scene.png"), image)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["scene.png"]
