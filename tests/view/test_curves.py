"""Training curves are drawn from a file to a file, named by text or paths."""

import pytest

from deggflow.view.curves import draw_curves


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_curves_are_drawn(tmp_path, ending):
    source, target = tmp_path / "curves.csv", tmp_path / f"new/curves.{ending}"
    source.write_text("step,training,validation\n10,1.0,2.0\n20,0.5,1.5\n")
    draw_curves(str(source), str(target))
    drawn = target.read_bytes()
    assert drawn[1:4] == b"PNG" if ending == "png" else b"<svg" in drawn
