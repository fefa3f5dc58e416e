"""Pictures as arrays, beside each other, and as PNG files."""

from collections.abc import Sequence
from functools import cache
from io import BytesIO

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

from deggflow.files import StrPath, write_atomically

INK, GREY = (25, 25, 25), (70, 70, 70)  # of titles and of captions

Picture = UInt8[np.ndarray, "height width 3"]
Ink = tuple[int, int, int]
Sheet = UInt8[np.ndarray, "rows columns 3"]


def panels(
    images: Sequence[UInt8[np.ndarray, "height _width 3"]],
    *,
    titles: Sequence[str],
    captions: Sequence[str] | None = None,
    inks: Sequence[Ink] | None = None,
) -> Sheet:
    """Pictures of one height in a row, each with a title and, if given, a caption of one line.

    Args:
        images: The pictures.
        titles: One above each.
        captions: One below each.
        inks: Colour of each caption; grey if not given.
    """
    heights = {image.shape[0] for image in images}
    if len(heights) != 1:
        raise ValueError(f"`images` in a row must have the same height; got {sorted(heights)}.")
    height = heights.pop()
    gap, text = max(height // 40, 4), max(height // 24, 9)  # pixels
    head, foot = 2 * text, (round(1.9 * text) if captions else gap)
    widths = [image.shape[1] for image in images]
    total = (sum(widths) + gap * (len(images) + 1), head + height + foot)
    sheet = Image.new("RGB", total, "white")
    draw, x = ImageDraw.Draw(sheet), gap
    for k, image in enumerate(images):
        sheet.paste(Image.fromarray(image), (x, head))
        draw.rectangle((x, head, x + widths[k] - 1, head + height - 1), outline=(205, 205, 205))
        middle = x + widths[k] / 2
        draw.text((middle, head / 2), titles[k], INK, font("bold", text), anchor="mm")
        if captions:
            letters = fitting(captions[k], round(0.8 * text), widths[k])
            ink = inks[k] if inks else GREY
            draw.text((middle, head + height + foot / 2), captions[k], ink, letters, anchor="mm")
        x += widths[k] + gap
    return np.array(sheet)


def save_png(path: StrPath, image: Picture) -> None:
    """Writes a picture; a kill at any moment leaves the old file or the new one."""
    content = BytesIO()
    Image.fromarray(image).save(content, format="PNG", optimize=True)
    write_atomically(path, content.getvalue())


@cache
def font(weight: str, size: int) -> ImageFont.FreeTypeFont:
    """One of matplotlib's fonts, "regular" or "bold": the same letters on every machine."""
    from matplotlib import get_data_path

    file = {"regular": "STIXGeneral.ttf", "bold": "STIXGeneralBol.ttf"}[weight]
    return ImageFont.truetype(f"{get_data_path()}/fonts/ttf/{file}", size)


def fitting(text: str, size: int, width: int) -> ImageFont.FreeTypeFont:
    """The regular font, smaller than asked where the text would be wider than its picture."""
    length = font("regular", size).getlength(text)
    return font("regular", max(min(size, int(size * width / max(length, 1.0))), 6))
