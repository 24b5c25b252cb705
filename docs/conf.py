# SPDX-License-Identifier: LGPL-3.0-or-later
"""The site, for Sphinx: see `make docs` and `make docs-check`."""

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))

project = "dolfinx_contact"
author = "The dolfinx_contact developers"
project_copyright = f"{author}, LGPL-3.0-or-later"
init = (HERE.parent / "dolfinx_contact" / "__init__.py").read_text()
release = version = re.findall(r'__version__ = "(.*)"', init)[0]

extensions = [
    "myst_parser",
    "sphinx.ext.mathjax",
    "sphinx_codeautolink",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.bibtex",
    "api",
    "scripts",
    "formulas",
    "paper",
    "verification",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = [
    *(
        "_build",
        "_ext",
        "_static",
        "conf.py",
        "run.py",
        "check_links.py",
        "check_questions.py",
        "images",
    ),
    *("demos/output", "**/__pycache__"),
]
# Names in docstrings stand in single quotes; other words stay text.
default_role = "py:obj"
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist", "attrs_inline"]
myst_heading_anchors = 3
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "unsrt"
codeautolink_concat_default = True
codeautolink_autodoc_inject = False
copybutton_exclude = ".linenos, .gp"

html_theme = "pydata_sphinx_theme"
html_title = "dolfinx_contact"
html_static_path = ["_static"]
html_css_files = ["site.css"]
# It replaces functions of the search page, and runs before that page starts to search.
html_js_files = [("words.js", {"defer": "defer"})]
html_search_scorer = str(HERE / "_static" / "scorer.js")
html_favicon = "_static/favicon.svg"
html_context = {"default_mode": "auto"}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_toc_level": 2,
    "navigation_depth": 2,
    "header_links_before_dropdown": 8,
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
}
html_sidebars = {"index": [], "install": []}
