"""The paper of the repository as a page: citations in Pandoc's words become those of the site."""

import re
from pathlib import Path

PAPER = Path(__file__).resolve().parents[2] / "paper" / "paper.md"
#: `[@a; @b]`, and `@a` within a sentence.
GROUP = re.compile(r"\[(@[\w:]+(?:;\s*@[\w:]+)*)\]")
NAMED = re.compile(r"(?<![\w@`{])@(\w+)")


def page(text):
    """A page of MyST from a paper of JOSS."""
    _, head, body = text.split("---\n", 2)
    title = re.search(r'^title: "(.*)"$', head, flags=re.MULTILINE)
    assert title is not None
    body = body.partition("\n# References")[0]
    body = GROUP.sub(
        lambda m: "{cite:p}`" + ",".join(re.findall(r"@([\w:]+)", m.group(1))) + "`", body
    )
    body = NAMED.sub(r"{cite:t}`\1`", body)
    body = re.sub(r"^# ", "## ", body, flags=re.MULTILINE)
    return f"# {title.group(1)}\n\nA draft for the Journal of Open Source Software.\n{body}"


def source_read(app, docname, source):
    """Put the paper in its place."""
    if docname == "paper":
        source[0] = page(PAPER.read_text())
        app.env.note_dependency(str(PAPER))


def setup(app):
    """Register with Sphinx."""
    app.connect("source-read", source_read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
