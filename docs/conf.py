"""Sphinx's settings. ``make docs`` builds the site into ``build/docs``; warnings are errors."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import reference_pages  # noqa: E402

from fpg_bench.common.output import published  # noqa: E402
from fpg_bench.version import __version__  # noqa: E402

project = "fpg-bench"
author = "the fpg-bench authors"
copyright = author
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_static"]
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_html_meta = {  # as the board has them
    "description": "A benchmark for learning agents: UAVs keep a radio link by frequency hopping, or jam it.",
    "property=og:title": "fpg-bench: two UAVs fight over a radio link",
    "property=og:image": f"{published().get('Documentation', '').rstrip('/')}/_static/preview.png",
}
source_suffix = {".md": "markdown"}

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_default_options = {"members": True, "show-inheritance": False, "exclude-members": "__new__"}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"fpg-bench {version}"
html_favicon = "../fpg_bench/products/leaderboard/site/static/icon.svg"
html_search_scorer = str(HERE / "search_scorer.js")
html_static_path = ["_static", "../fpg_bench/products/leaderboard/site/static/preview.png"]
html_static_path += ["pictures/game-dark.png", "pictures/game-dark.gif"]  # which pages.css shows by night
html_css_files = ["pages.css"]
html_js_files = [("pages.js", {"defer": "defer"})]
html_copy_source = False
html_show_copyright = False
# The board, where `make docs` has built it, stands in the folder `board` of the site.
html_extra_path = [str(path) for path in [HERE.parent / "build/extra"] if path.is_dir()]
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b5394", "color-brand-content": "#0b5394"},
    "dark_css_variables": {"color-brand-primary": "#7fb2e5", "color-brand-content": "#7fb2e5"},
}


def setup(app: object) -> None:
    """Write the pages that are made from the code before Sphinx looks for pages."""
    reference_pages.connect(app)
