# SPDX-License-Identifier: LGPL-3.0-or-later
"""Formulas by KaTeX, from the machine on which the site is built: its pages need no network."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

#: Where Debian's libjs-katex is.
KATEX = Path("/usr/share/javascript/katex")
START = "renderMathInElement(document.body, {delimiters: [{left: '\\\\(', right: '\\\\)', display: \
false}, {left: '\\\\[', right: '\\\\]', display: true}]});"


def copy_katex(app: Sphinx, failure: Exception | None) -> None:
    """Put KaTeX beside the pages."""
    if failure is None and app.builder.format == "html":
        there = Path(app.outdir) / "_static" / "katex"
        there.mkdir(parents=True, exist_ok=True)
        for name in ("katex.min.js", "katex.min.css", "contrib/auto-render.js"):
            shutil.copy(KATEX / name, there / Path(name).name)
        shutil.copytree(KATEX / "fonts", there / "fonts", dirs_exist_ok=True)
        (there / "start.js").write_text(START + "\n")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    # Sphinx loads the replacement of MathJax on pages with formulas only, after these files.
    app.config.mathjax_path = "katex/start.js"
    app.config.mathjax_options = {"defer": "defer"}
    app.add_css_file("katex/katex.min.css")
    app.add_js_file("katex/katex.min.js", loading_method="defer", priority=300)
    app.add_js_file("katex/auto-render.js", loading_method="defer", priority=301)
    app.connect("build-finished", copy_katex)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
