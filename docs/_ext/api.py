# SPDX-License-Identifier: LGPL-3.0-or-later
"""The API reference, read from the source: the site is built where no DOLFINx is.

The directive ``.. public-names:: dolfinx_contact.laws`` describes every name of ``__all__`` of a
room by its signature and docstring.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import sphinx_codeautolink.extension
import sphinx_codeautolink.extension.block
from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.ext.napoleon import Config
from sphinx.ext.napoleon.docstring import GoogleDocstring
from sphinx_codeautolink.extension.resolve import CouldNotResolve
from sphinx_codeautolink.parse import ImportTrackerVisitor, NameBreak

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "dolfinx_contact"
#: Rooms with a page, in the order of the site. A name is described where it occurs first.
ROOMS = (
    PACKAGE,
    *(f"{PACKAGE}.{room}" for room in ("materials", "obstacles", "laws", "meshing", "io", "plot")),
    *(f"{PACKAGE}.{room}" for room in ("evolution", "continuation", "analysis", "records")),
    *(f"{PACKAGE}.{room}" for room in ("algorithms", "reduced", "solvers")),
)
Definition = ast.ClassDef | ast.FunctionDef | ast.AnnAssign | ast.Assign
NAPOLEON = Config(
    napoleon_google_docstring=True,
    napoleon_use_param=False,
    napoleon_use_rtype=False,
    napoleon_custom_sections=[("Attributes", "params_style")],
)


@dataclass(frozen=True)
class Name:
    """Public name with the place of its description and its definition."""

    room: str
    name: str
    module: str
    node: Definition | None

    @property
    def full(self) -> str:
        """As users import it."""
        return f"{self.room}.{self.name}"


@cache
def tree_of(module: str) -> ast.Module:
    """The syntax tree of a module of the package."""
    path = ROOT.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(file.read_text())


@cache
def source_of(module: str) -> list[str]:
    """The lines of a module of the package."""
    path = ROOT.joinpath(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return file.read_text().splitlines()


def is_module(name: str) -> bool:
    """Whether there is a module of the package with this name."""
    path = ROOT.joinpath(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").exists()


def defined_in(module: str) -> dict[str, Definition]:
    """Return the top-level definitions of a module."""
    found: dict[str, Definition] = {}
    for node in tree_of(module).body:
        match node:
            case ast.ClassDef() | ast.FunctionDef():
                found[node.name] = node
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                found[name] = node
            case ast.Assign(targets=[ast.Tuple(elts=several)]):
                found |= {ast.unparse(name): node for name in several}
    return found


def imported(module: str) -> dict[str, tuple[str, str]]:
    """Return module and original name of each imported name."""
    found = {}
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
            for alias in node.names:
                found[alias.asname or alias.name] = (node.module or "", alias.name)
    return found


def public(module: str) -> list[str]:
    """The names of ``__all__``."""
    names = defined_in(module)["__all__"]
    assert names.value is not None  # type: ignore[union-attr]
    return list(ast.literal_eval(names.value))  # type: ignore[union-attr]


def origin(module: str, name: str) -> tuple[str, Definition | None]:
    """The module that defines a name, and its definition; None of a module.

    Raises:
        LookupError: if the package does not define it.
    """
    here = defined_in(module)
    if name in here:
        return module, here[name]
    if name in imported(module):
        source, original = imported(module)[name]
        if is_module(f"{source}.{original}"):
            return f"{source}.{original}", None
        return origin(source, original)
    raise LookupError(f"{module} has no definition of {name}")


@cache
def names() -> dict[str, Name]:
    """Return all public names by import path; a name of several modules has several entries."""
    found: dict[str, Name] = {}
    described: dict[tuple[str, str], Name] = {}
    for room in ROOMS:
        for name in public(room):
            module, node = origin(room, name)
            if node is None:
                continue
            at = (module, name)
            described.setdefault(at, Name(room, name, module, node))
            found[f"{room}.{name}"] = described[at]
    return found


@cache
def by_last_word() -> dict[str, str]:
    """Full names of described objects by their last words: ``solve``, ``ContactProblem.solve``.

    A word that several share is that of none, but the name of a room's own object comes first.
    """
    found: dict[str, str] = {}
    several: set[str] = set()
    for name in names().values():
        found[name.name] = name.full
        found[name.full.removeprefix(f"{PACKAGE}.")] = name.full
    for name in dict.fromkeys(names().values()):
        if isinstance(name.node, ast.ClassDef):
            for member in members(name.node):
                full = f"{name.full}.{member.name}"
                found[f"{name.name}.{member.name}"] = full
                if member.name in found and found[member.name] != full:
                    several.add(member.name)
                elif member.name not in names():
                    found.setdefault(member.name, full)
    tops = {name.name for name in names().values()}
    return {word: full for word, full in found.items() if word in tops or word not in several}


def members(node: ast.ClassDef) -> list[ast.FunctionDef]:
    """Public methods and properties of a class, with docstrings or without."""
    return [
        part
        for part in node.body
        if isinstance(part, ast.FunctionDef)
        and not part.name.startswith("_")
        and not any(ast.unparse(d).endswith((".setter", "overload")) for d in part.decorator_list)
    ]


def listed(module: str, node: ast.ClassDef) -> tuple[str, ...] | None:
    """Members that a class lists for its users (`_listed`, its own or of a base); None for all."""
    for part in node.body:
        names_of = part.targets if isinstance(part, ast.Assign) else [getattr(part, "target", None)]
        if any(isinstance(n, ast.Name) and n.id == "_listed" for n in names_of):
            assert isinstance(part, ast.Assign | ast.AnnAssign)
            assert part.value is not None
            found: tuple[str, ...] | None = ast.literal_eval(part.value)
            return found
    of_bases = (listed(where, base) for where, base in base_nodes(module, node))
    return next((names for names in of_bases if names is not None), None)


def is_dataclass(node: ast.ClassDef) -> bool:
    """Whether a class is a dataclass."""
    return any("dataclass" in ast.unparse(d) for d in node.decorator_list)


def fields(node: ast.ClassDef) -> Iterator[ast.AnnAssign]:
    """The public fields of a dataclass."""
    for part in node.body:
        if (
            isinstance(part, ast.AnnAssign)
            and isinstance(part.target, ast.Name)
            and not part.target.id.startswith("_")
            and "ClassVar" not in ast.unparse(part.annotation)
        ):
            yield part


def base_nodes(module: str, node: ast.ClassDef) -> Iterator[tuple[str, ast.ClassDef]]:
    """The bases of a class that the package defines, with the modules that do."""
    for base in node.bases:
        try:
            where, found = origin(module, ast.unparse(base).split("[")[0])
        except LookupError:
            continue
        if isinstance(found, ast.ClassDef):
            yield where, found


def field_list(module: str, node: ast.ClassDef) -> list[ast.AnnAssign]:
    """The fields of a dataclass in the order of its arguments, with those of its bases."""
    found: dict[str, ast.AnnAssign] = {}
    for where, base in base_nodes(module, node):
        if is_dataclass(base):
            found |= {ast.unparse(f.target): f for f in field_list(where, base)}
    found |= {ast.unparse(f.target): f for f in fields(node)}
    return list(found.values())


def field_argument(part: ast.AnnAssign) -> str:
    """A field as an argument of its class."""
    text = f"{ast.unparse(part.target)}: {ast.unparse(part.annotation)}"
    if part.value is None:
        return text
    value = ast.unparse(part.value)
    if value.startswith("field("):
        return f"{text} = ..."
    return f"{text} = {value}"


def signature(node: ast.FunctionDef, *, method: bool) -> str:
    """Return the signature of a function, of a method without ``self``."""
    arguments = node.args
    static = any(ast.unparse(d) == "staticmethod" for d in node.decorator_list)
    if method and not static and (arguments.posonlyargs or arguments.args):
        arguments = ast.arguments(
            arguments.posonlyargs,
            arguments.args[1:],
            arguments.vararg,
            arguments.kwonlyargs,
            arguments.kw_defaults,
            arguments.kwarg,
            arguments.defaults,
        )
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"({ast.unparse(arguments)}){returns}"


def class_signature(module: str, node: ast.ClassDef) -> str:
    """The arguments of a class."""
    for part in node.body:
        if isinstance(part, ast.FunctionDef) and part.name == "__init__":
            return signature(part, method=True).removesuffix(" -> None")
    if is_dataclass(node):
        arguments = [f for f in field_list(module, node) if "init=False" not in ast.unparse(f)]
        return f"({', '.join(map(field_argument, arguments))})"
    for where, base in base_nodes(module, node):
        return class_signature(where, base)
    return ""


def tables(text: str) -> str:
    """Markdown's tables of a docstring as reStructuredText's."""

    def convert(match: re.Match[str]) -> str:
        rows = [
            [cell.strip() for cell in line.strip().strip("|").split("|")]
            for line in match[0].strip().splitlines()
        ]
        del rows[1]
        lines = [".. list-table::", "   :header-rows: 1", ""]
        for row in rows:
            lines += [f"   {'*' if i == 0 else ' '} - {cell}" for i, cell in enumerate(row)]
        return "\n".join(["", *lines, "", ""])

    return re.sub(r"(?m)(?:^\|.*\|$\n?){3,}", convert, text)


def bars(text: str) -> str:
    """Bars of absolute values escaped, but in code: elsewhere they mean substitutions."""
    lines = []
    literal: int | None = None
    for line in text.splitlines():
        depth = len(line) - len(line.lstrip())
        if literal is not None and line.strip() and depth <= literal:
            literal = None
        if literal is None:
            parts = line.split("`")
            parts[::2] = [part.replace("|", "\\|") for part in parts[::2]]
            lines.append("`".join(parts))
        else:
            lines.append(line)
        if literal is None and line.rstrip().endswith("::"):
            literal = depth
    return "\n".join(lines)


def docstring(node: Definition | ast.Module, what: str = "function") -> list[str]:
    """A docstring as reStructuredText."""
    if isinstance(node, ast.AnnAssign | ast.Assign):
        return []
    text = bars(tables(ast.get_docstring(node) or ""))
    return str(GoogleDocstring(text, NAPOLEON, what=what)).splitlines()


def comment_above(module: str, node: ast.stmt) -> list[str]:
    """The comment ``#:`` above a definition."""
    lines = source_of(module)
    first = node.lineno - 1
    while first > 0 and lines[first - 1].lstrip().startswith("#:"):
        first -= 1
    return [line.lstrip().removeprefix("#:").strip() for line in lines[first : node.lineno - 1]]


def indented(lines: list[str]) -> list[str]:
    """The lines as the content of a directive."""
    return [f"   {line}" if line else "" for line in lines]


def described_member(node: ast.FunctionDef) -> list[str]:
    """A method or property as a directive."""
    decorators = [ast.unparse(d) for d in node.decorator_list]
    if any(d in ("property", "cached_property", "functools.cached_property") for d in decorators):
        head = [f".. py:property:: {node.name}"]
        if node.returns:
            head.append(f"   :type: {ast.unparse(node.returns)}")
    else:
        head = [f".. py:method:: {node.name}{signature(node, method=True)}"]
        if "classmethod" in decorators:
            head.append("   :classmethod:")
        if "staticmethod" in decorators:
            head.append("   :staticmethod:")
        if any(d.endswith("abstractmethod") for d in decorators):
            head.append("   :abstractmethod:")
    return [*head, "", *indented(docstring(node, "method")), ""]


def inherited(
    module: str, node: ast.ClassDef, known: set[str], shown: tuple[str, ...] | None
) -> list[str]:
    """Public methods of bases that are described nowhere else, each as a directive.

    Args:
        module: of the class.
        node: the class.
        known: names that are described already, to which those found here are added.
        shown: names that are described at all; None for every name.
    """
    lines: list[str] = []
    described = {(name.module, name.name) for name in names().values()}
    for where, base in base_nodes(module, node):
        if (where, base.name) in described:
            continue
        for member in members(base):
            if member.name not in known and (shown is None or member.name in shown):
                known.add(member.name)
                lines += described_member(member)
        lines += inherited(where, base, known, shown)
    return lines


def described(name: Name) -> list[str]:
    """A public name as a directive."""
    node = name.node
    head = [f"   :module: {name.room}"]
    if name.module != name.room:
        head.append(f"   :canonical: {name.module}.{name.name}")
    if isinstance(node, ast.FunctionDef):
        first = f".. py:function:: {name.name}{signature(node, method=False)}"
        return [first, *head, "", *indented(docstring(node)), ""]
    if isinstance(node, ast.ClassDef):
        first = f".. py:class:: {name.name}{class_signature(name.module, node)}"
        body = docstring(node, "class")
        bases = [ast.unparse(b) for b in node.bases]
        if bases:
            body += ["", "Bases: " + ", ".join(f"`{b.split('[')[0]}`" for b in bases), ""]
        known = {member.name for member in members(node)}
        shown = listed(name.module, node)
        for member in members(node):
            if shown is None or member.name in shown:
                body += ["", *described_member(member)]
        body += inherited(name.module, node, known, shown)
        return [first, *head, "", *indented(body), ""]
    assert isinstance(node, ast.AnnAssign | ast.Assign)
    value = "" if node.value is None else ast.unparse(node.value)
    if len(value) <= 80:
        head.append(f"   :value: {value}")
    comment = comment_above(name.module, node)
    return [f".. py:data:: {name.name}", *head, "", *indented(comment), ""]


class PublicNames(Directive):
    """Describes the public names of a room."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        room = self.arguments[0]
        env = self.state.document.settings.env
        folder = ROOT.joinpath(*room.split("."))
        for file in folder.rglob("*.py") if folder.is_dir() else [folder.with_suffix(".py")]:
            env.note_dependency(str(file))
        lines = [f".. py:module:: {room}", "", *docstring(tree_of(room)), ""]
        elsewhere = []
        for full, name in names().items():
            if full.rpartition(".")[0] != room:
                continue
            if name.room == room:
                lines += described(name)
            else:
                elsewhere.append(f":py:obj:`{name.name} <{name.full}>`")
        if elsewhere:
            lines += ["", "Described elsewhere: " + ", ".join(elsewhere) + ".", ""]
        parent = nodes.section()
        parent.document = self.state.document
        content = StringList(lines, source=f"{room} (docstrings)")
        self.state.nested_parse(content, self.content_offset, parent)
        return parent.children


def find_name(
    app: Sphinx, env: Any, reference: nodes.Element, content: nodes.Element
) -> nodes.Element | None:
    """Resolve a name in a docstring by its last words: the site has one object of most names."""
    if reference.get("refdomain") != "py":
        return None
    target = reference["reftarget"].removesuffix("()").lstrip(".~")
    found = by_last_word().get(target)
    if found is None and target.startswith(f"{PACKAGE}."):
        known = names().get(target)
        found = known.full if known else None
    if found is None:
        return None
    domain = env.get_domain("py")
    where = domain.objects.get(found)
    if where is None:
        return None
    uri = app.builder.get_relative_uri(reference["refdoc"], where.docname)
    made = nodes.reference("", "", internal=True, refuri=f"{uri}#{where.node_id}", reftitle=found)
    made += content
    return made


def class_of(annotation: ast.expr | None) -> str:
    """The full name of the public class that an annotation names, or ""."""
    words = [] if annotation is None else re.findall(r"\w+", ast.unparse(annotation))
    words = [word for word in words if word not in ("None", "ClassVar")]
    full = by_last_word().get(words[0], "") if len(words) == 1 else ""
    known = names().get(full)
    return full if known and isinstance(known.node, ast.ClassDef) else ""


@cache
def type_of(full: str) -> str:
    """Return the class of the value of a public name: of a function call or a property."""
    known = names().get(full)
    if known is not None:
        if isinstance(known.node, ast.ClassDef):
            return full
        return class_of(known.node.returns) if isinstance(known.node, ast.FunctionDef) else ""
    owner, _, name = full.rpartition(".")
    known = names().get(owner)
    if known is None or not isinstance(known.node, ast.ClassDef):
        return ""
    for member in members(known.node):
        if member.name == name:
            return class_of(member.returns)
    for field in field_list(known.module, known.node):
        if ast.unparse(field.target) == name:
            return class_of(field.annotation)
    return ""


def resolve(chain: Any, inventory: Any) -> str:
    """Resolve a name in an example, in place of the imports of sphinx_codeautolink.

    Its own way imports the package, which needs DOLFINx; here calls and properties are followed by
    the annotations in the source.
    """
    found = ""
    for part in chain.import_components:
        if part == NameBreak.call:
            found = type_of(found)
        elif found:
            owner = names().get(found)
            is_object = owner is not None or found.rpartition(".")[0] in names()
            is_class = owner is not None and isinstance(owner.node, ast.ClassDef)
            found = found if is_class or not is_object else type_of(found)
            found = found and f"{found}.{part}"
        else:
            found = part
        if not found:
            raise CouldNotResolve("the type is not annotated")
        if found in names():
            found = names()[found].full
    return found


class NamesOfAPage:
    """Names in examples, in place of sphinx_codeautolink's `parse_names`.

    All examples of a page so far come as one text. Its own way reads all of it for each of them,
    which takes half of the time of the site; here modules are read once. The
    names that are left out are those of earlier lines, which it takes away itself.
    """

    def __init__(self) -> None:
        self._page: nodes.document | None = None
        self._text = ""
        self._visitor = ImportTrackerVisitor(None)

    def __call__(self, source: str, node: nodes.Element) -> list[Any]:
        known = f"{self._text}\n"
        if node.document is not self._page or not self._text or not source.startswith(known):
            known = ""
            self._visitor = ImportTrackerVisitor(node)
        self._page = node.document
        self._text = ""
        rest = ast.parse("\n" * known.count("\n") + source[len(known) :])
        self._visitor.doctree_node = node
        self._visitor.accessed = []
        self._visitor.visit(rest)
        self._text = source
        return self._visitor.accessed


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_directive("public-names", PublicNames)
    app.connect("missing-reference", find_name)
    sphinx_codeautolink.extension.resolve_location = resolve
    sphinx_codeautolink.extension.block.parse_names = NamesOfAPage()
    return {"parallel_read_safe": True, "parallel_write_safe": True}
