"""What every test of pictures needs."""

import re
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest

from deggflow.view.stage import gl_problem

gl_problem()  # chooses how MuJoCo renders, before any test module imports it

SVG = {"svg": "http://www.w3.org/2000/svg"}
LINK = "{http://www.w3.org/1999/xlink}href"


def _paths_in(axes, colour):
    """The paths of a colour that the SVG of a figure shows inside some axes, as points in data coordinates."""
    figure = axes.figure
    figure.set_dpi(72)  # points, as in the SVG
    buffer = BytesIO()
    figure.savefig(buffer, format="svg")
    root = ElementTree.fromstring(buffer.getvalue())
    height = float(root.get("viewBox").split()[3])
    defined = {path.get("id"): path.get("d") for path in root.iterfind(".//svg:defs/svg:path", SVG)}
    placed = [(path, path.get("d"), 0.0) for path in root.iterfind(".//svg:path[@style]", SVG)]
    placed += [
        (use, defined[name], float(use.get("y")))
        for use in root.iterfind(".//svg:use[@x='0']", SVG)
        if (name := use.get(LINK)[1:]) in defined
    ]
    low, high = np.sort([axes.get_xlim(), axes.get_ylim()]).T
    rounding = 1e-6 * (high - low)  # of the SVG's digits
    out = []
    for element, text, down in placed:
        if colour.lower() in element.get("style", "") and element.get("id") is None:
            x, y = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", text), float).T
            points = axes.transData.inverted().transform(np.stack([x, height - down - y], axis=-1))
            if np.all((low - rounding <= points) & (points <= high + rounding)):
                out.append(points)
    return out


@pytest.fixture(scope="session")
def paths_in():
    """Reads the paths of a colour out of a figure's SVG, in data coordinates."""
    return _paths_in


@pytest.fixture(scope="session")
def whiskers_in():
    """Reads the ends of vertical strokes of a colour out of a figure's SVG: x, lower end, upper end, by x."""

    def read(axes, colour):
        strokes = [
            (path[0, 0], *sorted(path[:, 1]))
            for path in _paths_in(axes, colour)
            if len(path) == 2 and abs(path[0, 0] - path[1, 0]) < 1e-6
        ]
        return np.array(sorted(strokes))

    return read
