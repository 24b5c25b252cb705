# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages of scripts: a Sphinx parser of jupytext's light format.

A script becomes a page of its narration, its code, and what it printed and drew when `docs/run.py`
ran it last; without such a run the page has narration and code alone.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jupytext
from docutils import nodes
from myst_parser.parsers.sphinx_ import MystParser
from sphinx.application import Sphinx


def without_licence(text: str) -> str:
    """The script without the line of its licence, which the page does not show."""
    return re.sub(r"\A# SPDX-License-Identifier:.*\n", "", text)


def linked(markdown: str, folder: Path) -> str:
    """Names of demos, recipes and tutorials in the narration, as links to their pages."""

    def link(match: re.Match[str]) -> str:
        name = match[1]
        for place in ("demos", "recipes", "tutorials"):
            if (folder / place / f"{name}.py").exists():
                return f"{{doc}}`{name}.py </{place}/{name}>`"
        return match[0]

    return re.sub(r"`(\w+)\.py`", link, markdown)


def below(outputs: list[dict[str, Any]], shown: str) -> list[str]:
    """What a cell printed and drew, as MyST."""
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


def page(text: str, folder: Path, shown: str = "") -> str:
    """The page of a script as MyST.

    Args:
        text: the script.
        folder: that of the documentation's sources.
        shown: below it, the folder of what the script printed and drew, if there is one.
    """
    cells = jupytext.reads(without_licence(text), fmt="py:light").cells
    run = folder / shown / "run.json"
    outputs = json.loads(run.read_text())["outputs"] if shown and run.exists() else []
    # Outputs know the line after which they came; cells are found again in the text, in order.
    lines: list[str] = []
    code: list[str] = []
    place = 0
    given = 0

    def write_code() -> None:
        """Code up to here in one block: what jupytext cuts at every empty line is one thought."""
        if code:
            lines.extend(["```python", "\n\n".join(code), "```", ""])
            code.clear()

    for cell in cells:
        if cell.cell_type == "markdown":
            write_code()
            lines += [linked(cell.source, folder), ""]
            continue
        place = text.index(cell.source, place) + len(cell.source)
        last = text.count("\n", 0, place) + 1
        code.append(cell.source)
        mine = [o for o in outputs[given:] if o["line"] <= last]
        if mine:
            write_code()
            given += len(mine)
            lines += below(mine, shown)
    write_code()
    lines += below(outputs[given:], shown)
    return "\n".join(lines)


class ScriptParser(MystParser):
    """Parses scripts in jupytext's light format as pages."""

    supported = ("script",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a script into the document."""
        folder = Path(self.env.srcdir)
        shown = ""
        if self.env.config.scripts_shown:
            name = self.env.docname.rpartition("/")[2]
            shown = f"{self.env.config.scripts_shown}/{name}"
            self.env.note_dependency(f"{shown}/run.json")
        super().parse(page(inputstring, folder, shown), document)


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_config_value("scripts_shown", "", "env", str)
    app.add_source_suffix(".py", "script")
    app.add_source_parser(ScriptParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
