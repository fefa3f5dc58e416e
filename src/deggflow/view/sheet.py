"""Pictures as one figure: in a row with titles and captions, or below each other with titles."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .picture import Picture
from .style import PAGE, look, new_figure

Cropped = UInt8[np.ndarray, "rows width 3"]

_CAPTION = 18.5  # letters per inch at the captions' size
_HEAD, _LINE = 0.28, 0.16  # inches, of the titles and of a line below
_TITLE, _GAP = 0.22, 0.08  # inches above a picture of a column, and below it


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

    Raises:
        ValueError: If there is none, or they differ in size.
    """
    _common_size(images)
    cuttings = _cropped(images)
    height, across, _ = cuttings[0].shape
    each = width / len(images)
    lines = [fill(caption, int(_CAPTION * each)) for caption in captions]
    most = max(line.count("\n") for line in lines)
    lines = [line + "\n" * (most - line.count("\n")) for line in lines]  # so that all are level
    figure, row = new_figure(
        each * height / across + _HEAD + _LINE * (most + 1), width=width, columns=len(images)
    )
    for axes, image, title, line in zip(row, cuttings, titles, lines, strict=True):
        axes.imshow(image)
        axes.set_title(title)
        axes.set_xlabel(line, fontsize=8.0, color="#444444")
        _frame(axes)
    return figure


@look()
def picture_column(
    images: Sequence[Picture], titles: Sequence[str], *, width: float = 5.0
) -> Figure:
    """Pictures of one size below each other, each under its title, as in the paper (fig:task1_rollout).

    Args:
        images: The pictures.
        titles: One above each.
        width: Of the pictures, inches.

    Raises:
        ValueError: If there is none, or they differ in size.
    """
    high, wide = _common_size(images)
    height = width * high / wide
    pitch = _TITLE + height + _GAP
    total = len(images) * pitch
    figure = Figure(figsize=(width + 2 * _GAP, total))
    for k, (image, title) in enumerate(zip(images, titles, strict=True)):
        bottom = total - k * pitch - _TITLE - height
        across = _GAP / (width + 2 * _GAP)
        axes = figure.add_axes((across, bottom / total, 1 - 2 * across, height / total))
        axes.imshow(image, aspect="auto")
        axes.set_title(title, pad=3)
        _frame(axes)
    return figure


def _frame(axes: Axes) -> None:
    """A thin frame without ticks."""
    axes.set(xticks=[], yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set(visible=True, color="#CDCDCD")


def _common_size(images: Sequence[Picture]) -> tuple[int, int]:
    """Height and width, pixels."""
    shapes = {image.shape for image in images}
    if len(shapes) != 1:
        raise ValueError(f"`images` must be one or more of one size; got {sorted(shapes)}.")
    height, width, _ = shapes.pop()
    return height, width


def _cropped(images: Sequence[Picture]) -> list[Cropped]:
    """The pictures without the empty rows that all of them begin and end with."""
    contents = np.any([np.any(image != image[:1, :1], axis=(1, 2)) for image in images], axis=0)
    rows = np.flatnonzero(contents)
    if rows.size == 0:
        return list(images)
    room = len(contents) // 40
    return [image[max(rows[0] - room, 0) : rows[-1] + 1 + room] for image in images]
