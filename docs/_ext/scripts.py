# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of scripts: a Sphinx parser of jupytext's light format, and galleries of scripts.

A page shows the narration of a script, its code, and the output and pictures of the last run by
`docs/run.py`; without such a run it shows narration and code only. The directive ``gallery`` lists
scripts as cards with a picture.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import jupytext
from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def without_licence(text: str) -> str:
    """Return a script without its licence line."""
    return re.sub(r"\A# SPDX-License-Identifier:.*\n", "", text)


def linked(markdown: str, folder: Path) -> str:
    """Replace names of demos, recipes and tutorials in a narration by links to their pages."""

    def link(match: re.Match[str]) -> str:
        name = match[1]
        for place in ("demos", "recipes", "tutorials"):
            if (folder / place / f"{name}.py").exists():
                return f"{{doc}}`{name}.py </{place}/{name}>`"
        return match[0]

    return re.sub(r"`(\w+)\.py`", link, markdown)


def below(outputs: list[dict[str, Any]], shown: str) -> list[str]:
    """Return the printed text and the pictures of a cell as lines of MyST."""
    text = "".join(output.get("text", "") for output in outputs).rstrip()
    lines = []
    if text:
        fence = "`" * 4
        lines += [":::{div} output", f"{fence}text", text, fence, ":::", ""]
    for output in outputs:
        for picture in output.get("pictures", []):
            name = Path(picture).stem.replace("_", " ")
            lines += [f"```{{image}} /{shown}/{picture}", f":alt: {name}", "```", ""]
    return lines


def outputs_of(folder: Path, shown: str) -> list[dict[str, Any]]:
    """Return the outputs of the last run of a script, or an empty list."""
    run = folder / shown / "run.json"
    return json.loads(run.read_text())["outputs"] if shown and run.exists() else []


def page(text: str, folder: Path, shown: str = "", file: str = "") -> str:
    """Return the page of a script as MyST.

    Args:
        text: the script.
        folder: source folder of the documentation.
        shown: folder of the script's outputs, relative to ``folder``; empty if it was not run.
        file: path of the script relative to ``folder``, for the download link.
    """
    cells = jupytext.reads(without_licence(text), fmt="py:light").cells
    outputs = outputs_of(folder, shown)
    # Outputs are located by the line after which they appeared; cells by their order in the text.
    lines: list[str] = []
    code: list[str] = []
    place = 0
    written = 0

    def write_code() -> None:
        """Write the collected cells as one block: jupytext splits code at every empty line."""
        if code:
            lines.extend(["```python", "\n\n".join(code), "```", ""])
            code.clear()

    for cell in cells:
        if cell.cell_type == "markdown":
            write_code()
            lines += [linked(cell.source, folder), ""]
            if file:
                lines += [f"{{download}}`Download this script </{file}>`", ""]
                file = ""
            continue
        place = text.index(cell.source, place) + len(cell.source)
        last = text.count("\n", 0, place) + 1
        code.append(cell.source)
        new = [output for output in outputs[written:] if output["line"] <= last]
        if new:
            write_code()
            written += len(new)
            lines += below(new, shown)
    write_code()
    lines += below(outputs[written:], shown)
    return "\n".join(lines)


class ScriptParser(MystParser):
    """Parser of scripts in jupytext's light format."""

    supported = ("script",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a script into the document."""
        folder = Path(self.env.srcdir)
        name = self.env.docname
        shown = ""
        if self.env.config.scripts_shown:
            shown = f"{self.env.config.scripts_shown}/{name.rpartition('/')[2]}"
            self.env.note_dependency(f"{shown}/run.json")
        super().parse(page(inputstring, folder, shown, f"{name}.py"), document)


class Gallery(SphinxDirective):
    """Cards of scripts: one line ``path: description`` for each, with the path of its page."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the cards as a grid."""
        folder = Path(self.env.srcdir)
        lines = ["::::{grid} 1 2 3 3", ":gutter: 3", ""]
        for entry in self.content:
            name, _, description = entry.partition(": ")
            title = re.search(r"^# # (.*)$", (folder / f"{name}.py").read_text(), re.MULTILINE)
            lines += [f":::{{grid-item-card}} {title[1] if title else name}"]
            lines += [f":link: /{name}", ":link-type: doc"]
            picture = self.picture(folder, name)
            if picture:
                lines += [f":img-top: {picture}"]
            lines += ["", description, ":::", ""]
        return self.parse_text_to_nodes("\n".join([*lines, "::::"]))

    def picture(self, folder: Path, name: str) -> str:
        """Return the last picture of a script's run, or an empty string."""
        if not self.env.config.scripts_shown:
            return ""
        shown = f"{self.env.config.scripts_shown}/{name.rpartition('/')[2]}"
        self.env.note_dependency(f"{shown}/run.json")
        outputs = outputs_of(folder, shown)
        pictures = [file for output in outputs for file in output.get("pictures", [])]
        return f"/{shown}/{pictures[-1]}" if pictures else ""


class Explorer(SphinxDirective):
    """The page ``explorer.html`` that a script has written, or a picture if it was not run.

    The argument is the name of the script, the content the fallback as MyST.
    """

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return a frame with the page, or the fallback."""
        shown = Path(self.env.srcdir, self.env.config.scripts_shown, self.arguments[0])
        file = shown / "explorer.html"
        if not (self.env.config.scripts_shown and file.exists()):
            return self.parse_content_to_nodes()
        self.env.note_dependency(str(file))
        target = Path(self.env.app.outdir, "_static", f"{self.arguments[0]}.html")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)
        frame = f'<iframe class="explorer" src="_static/{target.name}" loading="lazy"></iframe>'
        return [nodes.raw("", frame, format="html")]


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the parser and the directive with Sphinx."""
    app.add_config_value("scripts_shown", "", "env", str)
    app.add_source_suffix(".py", "script")
    app.add_source_parser(ScriptParser)
    app.add_directive("gallery", Gallery)
    app.add_directive("explorer", Explorer)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
