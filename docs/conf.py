"""Sphinx settings. `make docs` builds the site into site/; it loads nothing from other machines."""

import sys
from pathlib import Path

import deggflow

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project, author = "deggflow", "The deggflow developers"
project_copyright = author
version = release = deggflow.__version__
html_title = f"deggflow {release}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docstrings",
    "mathml",
    "tutorials",
]
exclude_patterns = ["_ext", "_static"]
nitpicky = False
default_role = "literal"  # docstrings have `names` in single backticks, as Markdown has them

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

autodoc_member_order = "groupwise"
autodoc_preserve_defaults = True  # a function as a default has no other text that Python reads
autodoc_typehints, autodoc_typehints_format = "signature", "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 90
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_google_docstring, napoleon_numpy_docstring = True, False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # signatures have the types
napoleon_custom_sections = ["Source"]

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = html_show_sourcelink = False
html_show_search_summary = False  # a page on disk may not fetch other pages
html_show_sphinx = False
pygments_style, pygments_dark_style = "friendly", "github-dark"
