"""Pictures in a row as one figure, with a title above and a line or two below each."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure

from .picture import Picture
from .style import PAGE, look, new_figure

Cropped = UInt8[np.ndarray, "rows width 3"]

_CAPTION = 18.5  # letters per inch at the captions' size
_HEAD, _LINE = 0.28, 0.16  # inches, of the titles and of a line below


@look()
def picture_row(
    images: Sequence[Picture],
    titles: Sequence[str],
    captions: Sequence[str],
    *,
    width: float = PAGE,
) -> Figure:
    """A row of pictures of equal size.

    Args:
        images: The pictures.
        titles: One above each.
        captions: One below each.
        width: Of the figure, inches.
    """
    shapes = {image.shape for image in images}
    if len(shapes) != 1:
        raise ValueError(f"`images` must be one or more of one size; got {sorted(shapes)}.")
    cropped = _cropped(images)
    height, across, _ = cropped[0].shape
    each = width / len(images)
    lines = [fill(caption, int(_CAPTION * each)) for caption in captions]
    most = max(line.count("\n") for line in lines)
    lines = [line + "\n" * (most - line.count("\n")) for line in lines]  # so that all are level
    figure, row = new_figure(
        each * height / across + _HEAD + _LINE * (most + 1), width=width, columns=len(images)
    )
    for axes, image, title, line in zip(row, cropped, titles, lines, strict=True):
        axes.imshow(image)
        axes.set_title(title)
        axes.set_xlabel(line, fontsize=8.0, color="#444444")
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set(visible=True, color="#CDCDCD")
    return figure


def _cropped(images: Sequence[Picture]) -> list[Cropped]:
    """The pictures without the empty rows that all of them begin and end with."""
    filled = np.any([np.any(image != image[:1, :1], axis=(1, 2)) for image in images], axis=0)
    rows = np.flatnonzero(filled)
    if rows.size == 0:
        return list(images)
    room = len(filled) // 40
    return [image[max(rows[0] - room, 0) : rows[-1] + 1 + room] for image in images]
