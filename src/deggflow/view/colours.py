"""Colours that pictures of every task share.

Red stands for what is wrong, and for nothing else.
"""

Colour = tuple[float, float, float]

FAULT = "#d4201f"
# After Okabe and Ito (2008) and Tol (2021), told apart by colour-blind readers; without their reds.
ACCENTS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#6a4c93", "#b5a642", "#4d4d4d")


def accent(robot: int) -> Colour:
    """Colour of a robot and of its goal; robots are counted from 0."""
    return rgb(ACCENTS[robot % len(ACCENTS)])


def rgb(code: str) -> Colour:
    """Red, green and blue in [0, 1] of a colour's code, "#rrggbb"."""
    red, green, blue = (int(code[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def blend(one: Colour, other: Colour, part: float) -> Colour:
    """A colour between two, `part` of the way to the other."""
    red, green, blue = (a + part * (b - a) for a, b in zip(one, other, strict=True))
    return red, green, blue
