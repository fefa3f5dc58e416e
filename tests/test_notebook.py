"""What notebooks show is well-formed, whole in itself, and says what the objects say."""

from dataclasses import replace
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import deggflow
from deggflow.certificate import Certificate

SVG = "{http://www.w3.org/2000/svg}"


def field(tau, z, condition):
    return -z


def far(z, condition):
    return deggflow.distances(z) - 0.3


APART = deggflow.PrivateRequirement(far, 0.02, name="apart & <free>")


@pytest.fixture(scope="module")
def samples():
    options = {"key": jax.random.key(0), "count": 3, "shape": (4, 2), "keep_trace": True}
    return deggflow.sample(field, (APART,), **options)


def shown(thing):
    """The HTML as a tree: it is well-formed, and asks for nothing from elsewhere."""
    html = thing._repr_html_()
    assert "href" not in html
    assert "src=" not in html
    return ElementTree.fromstring(html)


def texts(tree):
    return "".join(tree.itertext())


def test_a_certificate(samples):
    certificate = samples.certificates[0]
    tree = shown(certificate)
    assert "Satisfied" in texts(tree)
    assert f"least margin {certificate.min_margin:.3g}" in texts(tree)
    assert "apart & <free>" in texts(tree)
    (chart,) = tree.iter(f"{SVG}svg")
    assert len(list(chart.iter(f"{SVG}path"))) == 4  # axes, value, bound, limit


def test_a_reason_is_text_whatever_it_holds():
    tree = shown(Certificate(False, -0.5, 1.0, 8, "<script>alert('apart')</script>"))
    assert "Not satisfied: <script>alert('apart')</script>; least margin -0.5, V 1, 8 draws" in texts(tree)  # fmt: skip


def test_samples_that_fail_are_red(samples):
    failing = replace(samples.certificates[1], satisfied=False, reason="agent 0 is late")
    certificates = (samples.certificates[0], failing, samples.certificates[2])
    tree = shown(replace(samples, certificates=certificates))
    colours = [circle.get("fill") for circle in tree.iter(f"{SVG}circle")]
    assert colours == ["#0072b2"] * 4 + ["#d4201f"] * 4 + ["#0072b2"] * 4
    assert "2 of 3 samples satisfied" in texts(tree)
    assert "agent 0 is late" in texts(tree)


def test_a_generation_shows_the_way_to_its_sample():
    guidance = deggflow.DecoupledGuidance((APART,))
    z0 = jax.random.normal(jax.random.key(1), (4, 2))
    grid = deggflow.refined_grid(8)
    generation = deggflow.generate(field, guidance, z0, None, grid=grid, keep_path=True)
    tree = shown(generation)
    picture, chart = tree.iter(f"{SVG}svg")
    assert len(list(picture.iter(f"{SVG}path"))) == len(list(picture.iter(f"{SVG}circle"))) == 4
    # Circles lie where the ways end.
    ends = [path.get("d").rpartition("L")[2].split() for path in picture.iter(f"{SVG}path")]
    circles = [[each.get("cx"), each.get("cy")] for each in picture.iter(f"{SVG}circle")]
    np.testing.assert_allclose(np.array(ends, float), np.array(circles, float), atol=0.11)
    assert len(list(chart.iter(f"{SVG}path"))) == 4


@pytest.mark.parametrize("value", [jnp.nan, jnp.inf])
def test_numbers_that_are_not_finite_leave_gaps(samples, value):
    z = samples.z.copy()
    z[0, 0] = value
    tree = shown(replace(samples, z=z))
    assert len(list(tree.iter(f"{SVG}circle"))) == 11
    assert not list(shown(replace(samples, z=z * jnp.nan)).iter(f"{SVG}svg"))


def test_states_of_one_dimension_have_no_picture(samples):
    assert not list(shown(replace(samples, z=samples.z[..., :1])).iter(f"{SVG}svg"))
