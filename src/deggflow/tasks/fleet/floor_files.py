"""Floors from files: an occupancy image, or the JSON object of a map."""

import warnings
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool
from PIL import Image, UnidentifiedImageError

from deggflow.jsonl import InputError, read_json
from deggflow.requirements import Grid

from .formats import MAX_OBSTACLES, parse_map
from .maps import BOUNDS, FloorMap

MAX_PIXELS = 1_000_000
DARK = 128  # grey values below stand for obstacles, of 0 (black) to 255 (white)


@cache  # conditions are drawn a few at a time, all on one floor
def read_floor(path: Path) -> FloorMap:
    """The floor of a file: JSON, the "map" of a condition; or an image, whose dark pixels are obstacles.

    The longer side of an image is as long as the named maps' (2 map units), its middle is (0, 0), and neighbouring dark
    pixels are joined into rectangles.

    Args:
        path: The file: .json, or an image that Pillow reads.

    Raises:
        InputError: The file can't be read, or is no such file.
    """
    try:
        if path.suffix == ".json":
            floor = parse_map(read_json(path), "")
            assert isinstance(floor, FloorMap)
            return floor
        return floor_of_image(_occupied(path))
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", file=path) from None
    except InputError as error:
        raise InputError(error.reason, file=path, field=error.field) from None


def floor_of_image(occupied: Bool[np.ndarray, "rows columns"]) -> FloorMap:
    """The floor whose occupied pixels are obstacles; the first row is at the top.

    Raises:
        InputError: The pixels make more rectangles than a map may have boxes.

    Example:
        >>> import numpy as np
        >>> image = np.zeros((4, 4), bool)
        >>> image[0, 1:3] = True
        >>> floor_of_image(image).boxes
        ((0.0, 0.75, 1.0, 0.5),)
    """
    rows, columns = occupied.shape
    longer, half = max(rows, columns), (BOUNDS[2] - BOUNDS[0]) / 2
    x, y, cell = half * columns / longer, half * rows / longer, 2 * half / longer
    bounds = (-x, -y, x, y)
    if not occupied.any():
        return FloorMap(bounds)
    grid = Grid(occupied[::-1], origin=(-x, -y), cell=cell)
    table = np.concatenate([grid.rectangles.centre, grid.rectangles.size], axis=-1)
    if len(table) > MAX_OBSTACLES:
        raise InputError(
            f"its dark pixels make {len(table)} rectangles; at most {MAX_OBSTACLES} are possible, "
            "so use a coarser image, or polygons"
        )
    return FloorMap(bounds, boxes=tuple((a, b, c, d) for a, b, c, d in table.tolist()))


def _occupied(path: Path) -> Bool[np.ndarray, "rows columns"]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if image.width * image.height > MAX_PIXELS:
                    text = (
                        f"must have at most {MAX_PIXELS} pixels; got {image.width} x {image.height}"
                    )
                    raise InputError(text)
                white = Image.new("RGBA", image.size, "white")  # transparent pixels are free
                grey = Image.alpha_composite(white, image.convert("RGBA")).convert("L")
    except (UnidentifiedImageError, Image.DecompressionBombWarning, SyntaxError, ValueError):
        raise InputError("is no image that can be read") from None
    return np.asarray(grey) < DARK
