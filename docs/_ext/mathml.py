"""Renders equations as MathML when the site is built: pages need no script and no fonts for them."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

BAR = re.compile(r"<mo([^>]*)>\|</mo>")
APPLIED = re.compile(r"(<mo>&ApplyFunction;</mo>)(?=\s*<m(?:i|n|sub|sup|frac)>)")


def _mathml(formula: str, *, as_block: bool = False) -> str:
    """With the spaces of print: none inside of bars, a thin one between a function and its argument."""
    text = BAR.sub(r'<mo\1 lspace="0" rspace="0">|</mo>', tex2mathml(formula, as_block=as_block))
    return APPLIED.sub(r'\1<mspace width="0.17em"/>', text)


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_mathml(node.astext()))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="equation">{_mathml(node.astext().strip(), as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the renderer under the name by which `html_math_renderer` may select it."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_inline, None), block_renderers=(_block, None)
    )
    app.config.html_math_renderer = "mathml"
    return {"parallel_read_safe": True, "parallel_write_safe": True}
