"""Mutants of the core by Python's own syntax tree: fresh samples, without Cosmic Ray.

The operators are those of `mutants.py` and those of assignments (`+=`). A sample is the first so
many of an order that a seed shuffles; those of another seed are other ones. Mutants are tried as
there: by tests that run their line, for some seconds together. What is known is in
`ROOM-SEED.json`, and nothing is tried twice but with `--again`.

    docker/run python3 tests/tree_mutants.py --output output/mutants --seed 27 --sample 20 laws
"""

import argparse
import ast
import importlib
import io
import json
import os
import random
import tokenize
from pathlib import Path

import mutants

COMPARED = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
SWAPPED = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.Pow: ("**", "*"),
    ast.Mod: ("%", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.BitXor: ("^", "|"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
}
UNARY = {ast.Not: "not", ast.USub: "-", ast.Invert: "~"}
ASKED = (ast.If, ast.While, ast.IfExp, ast.Assert)


class Source:
    """A module, its nodes and words by their places in bytes."""

    def __init__(self, text):
        self.text = text.encode()
        self.tree = ast.parse(text)
        lines = self.text.splitlines(keepends=True)
        self.starts = [0]
        for line in lines:
            self.starts.append(self.starts[-1] + len(line))
        self.words = []
        for token in tokenize.tokenize(io.BytesIO(self.text).readline):
            if token.type in (tokenize.OP, tokenize.NAME):
                row, column = token.start
                before = lines[row - 1].decode()[:column].encode()
                self.words.append((self.starts[row - 1] + len(before), token.string))

    def start(self, node):
        return self.starts[node.lineno - 1] + node.col_offset

    def end(self, node):
        return self.starts[node.end_lineno - 1] + node.end_col_offset

    def between(self, a, b, word):
        """Where a word is between two nodes."""
        places = (s for s, w in self.words if self.end(a) <= s < self.start(b) and w == word)
        return next(places, None)

    def changed(self, start, end, instead):
        return (self.text[:start] + instead.encode() + self.text[end:]).decode()


def mutants_of(source):
    """Line, column, name, and (start, end, what stands there instead) of every mutant, in order."""
    found = set()
    for node in ast.walk(source.tree):
        for start, end, instead, name, at in (*of_node(source, node), *of_condition(source, node)):
            if start is not None:
                found.add((start, end, instead, name, at.lineno, at.col_offset))
    without = mutants.without_effect(source.text.decode())
    return [
        (line, column, name, (start, end, instead))
        for start, end, instead, name, line, column in sorted(found)
        if not any(a <= (line, column) < b for a, b in without)
    ]


def of_node(source, node):
    """What may stand instead of a node, or of the words between its parts."""
    kind = type(node)
    whole = (source.start(node), source.end(node)) if hasattr(node, "lineno") else None
    if kind is ast.Constant and isinstance(node.value, bool):
        yield *whole, str(not node.value), "bool", node
    elif kind is ast.Constant and isinstance(node.value, int | float):
        for d in (1, -1):
            value = node.value + d
            yield *whole, f"({value!r})" if value < 0 else repr(value), f"number {d:+d}", node
    elif kind is ast.Compare:
        parts = [node.left, *node.comparators]
        for a, op, b in zip(parts, node.ops, node.comparators, strict=False):
            word = COMPARED.get(type(op))
            for other in COMPARED.values() if word else ():
                if other != word:
                    yield *place(source.between(a, b, word), word), other, f"{word} {other}", node
            if isinstance(op, ast.Is):
                yield *place(source.between(a, b, "is"), "is"), "is not", "is", node
            if isinstance(op, ast.IsNot):
                yield *place(source.between(a, b, "not"), "not"), "", "is not", node
    elif kind is ast.BinOp and type(node.op) in SWAPPED:
        word, other = SWAPPED[type(node.op)]
        at = place(source.between(node.left, node.right, word), word)
        yield *at, other, f"{word} {other}", node
    elif kind is ast.AugAssign and type(node.op) in SWAPPED:
        word, other = SWAPPED[type(node.op)]
        at = place(source.between(node.target, node.value, word + "="), word)
        yield *at, other, f"{word}= {other}=", node
    elif kind is ast.BoolOp:
        word, other = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for a, b in zip(node.values, node.values[1:], strict=False):
            yield *place(source.between(a, b, word), word), other, f"{word} {other}", node
    elif kind is ast.UnaryOp and type(node.op) in UNARY:
        word = UNARY[type(node.op)]
        yield whole[0], whole[0] + len(word), "", f"no {word}", node
    elif kind in (ast.Break, ast.Continue):
        other = "continue" if kind is ast.Break else "break"
        yield *whole, other, other, node
    elif kind is ast.For:
        yield source.start(node.iter), source.end(node.iter), "[]", "no iteration", node.iter
    elif kind is ast.ExceptHandler and node.type is not None:
        yield source.start(node.type), source.end(node.type), "ZeroDivisionError", "except", node
    for decorator in getattr(node, "decorator_list", ()):
        yield source.start(decorator) - 1, source.end(decorator), "", "no decorator", decorator


def of_condition(source, node):
    """Conditions that are turned round."""
    for test in [node.test] if isinstance(node, ASKED) else getattr(node, "ifs", ()):
        start, end = source.start(test), source.end(test)
        text = source.text[start:end].decode()
        yield start, end, f"(not ({text}))", "not", test


def place(start, word):
    return start, None if start is None else start + len(word)


def drawn(room, seed, sample):
    """Path, key, line and source of the first mutants of a room in the order of a seed."""
    sources = {path: Source((mutants.TREE / path).read_text()) for path in mutants.modules(room)}
    every = [(path, *mutant) for path in sources for mutant in mutants_of(sources[path])]
    random.Random(seed).shuffle(every)
    for path, line, column, name, how in every[:sample]:
        yield path, f"{path}:{line}:{column} {name}", line, sources[path].changed(*how)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", default=list(mutants.ROOMS), metavar="ROOM")
    parser.add_argument("--output", type=Path, default=Path("output/mutants"))
    parser.add_argument("--seed", type=int, default=27)
    parser.add_argument("--sample", type=int, default=20, help="mutants of each room")
    parser.add_argument("--seconds", type=float, default=60, help="of tests for one mutant")
    parser.add_argument("--again", action="store_true", help="try what has survived once more")
    args = parser.parse_args()
    folder = args.output.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(mutants.TREE)
    for name in ("dolfinx_contact.analysis", "gmsh", "hypothesis"):
        importlib.import_module(name)
    for room in args.rooms:
        known = mutants.lines_of_tests(room, folder)
        path = folder / f"{room}-{args.seed}.json"
        killed = json.loads(path.read_text()) if path.exists() else {}
        alone = mutants.all_alone([importlib.import_module(n) for n in mutants.ALONE.get(room, ())])
        order = mutants.Order(len(alone))
        keys = []
        for module, key, line, text in drawn(room, args.seed, args.sample):
            keys.append(key)
            if key in killed and (killed[key] or not args.again):
                continue
            before = ast.parse((mutants.TREE / module).read_text())
            within = Path(module).relative_to("dolfinx_contact").as_posix()
            tests = mutants.that_run(within, line, known, before, args.seconds)
            mutant = mutants.Mutant(mutants.TREE / module, text)
            killed[key], number, by = mutants.seen(mutant, tests, alone, order.near(line))
            if killed[key] and number is not None:
                order.lines[number].append(line)
            said = by or "killed" if killed[key] else f"survives {len(tests)} tests"
            print(f"{key}: {said}", flush=True)
            path.write_text(json.dumps(killed, indent=1))
        number = sum(killed[key] for key in keys)
        print(f"{room}: {number} of {len(keys)} mutants were seen", flush=True)


if __name__ == "__main__":
    main()
