# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run the scripts of the site, and keep their printed output and pictures.

Called by ``make docs`` where DOLFINx is installed. Outputs are kept in the cache of docker/run
under a key of the script, its local imports, the package and its dependencies; if the key changes,
the script runs again. `docs/_build/run` has a copy, which Sphinx reads.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SHOWN = ROOT / "docs" / "_build" / "run"
PICTURES = (".png", ".gif", ".svg")
#: Further files that pages of the site show.
PAGES = (".html",)
#: Limit of one script in seconds.
LIMIT = 600.0
#: A script prints at most so many lines on its page.
LINES = 60


def scripts() -> list[Path]:
    """Scripts of the site: demos, recipes, tutorials and the reference implementation."""
    return [
        *sorted((ROOT / "docs" / "recipes").glob("[0-9]*.py")),
        *sorted((ROOT / "docs" / "tutorials").glob("[0-9]*.py")),
        *sorted((ROOT / "docs" / "theory").glob("*.py")),
        *sorted((ROOT / "demos").glob("demo_*.py")),
    ]


def with_imports(script: Path) -> set[Path]:
    """A script and the files beside it that it imports, directly or not."""
    found: set[Path] = set()
    waiting = [script]
    while waiting:
        file = waiting.pop()
        found.add(file)
        names = re.findall(r"^\s*(?:from|import) (\w+)", file.read_text(), flags=re.MULTILINE)
        beside = {file.with_name(f"{name}.py") for name in names}
        waiting += [f for f in beside - found if f.exists()]
    return found


def environment() -> str:
    """The package and its dependencies, as a hash."""
    made = hashlib.sha256()
    for file in [Path(__file__), *sorted((ROOT / "dolfinx_contact").rglob("*.py"))]:
        made.update(file.read_bytes())
    for name in ("fenics-dolfinx", "fenics-ufl", "petsc4py", "numpy", "matplotlib", "pyvista"):
        with contextlib.suppress(PackageNotFoundError):
            made.update(f"{name} {version(name)}".encode())
    return made.hexdigest()


def key(script: Path, package: str) -> str:
    """Under which the run of a script is kept."""
    made = hashlib.sha256(package.encode())
    for file in sorted(with_imports(script)):
        made.update(file.read_bytes())
    return f"{script.stem}-{made.hexdigest()[:16]}"


def pictures(folder: Path) -> dict[str, float]:
    """Pictures below a folder, with the time at which they were written."""
    found = [f for f in folder.rglob("*") if f.suffix in PICTURES]
    return {str(f.relative_to(folder)): f.stat().st_mtime_ns for f in found}


def shortened(text: str) -> str:
    """At most `LINES` lines: the first ones and the last ones."""
    lines = text.splitlines()
    if len(lines) <= LINES:
        return text
    half = LINES // 2
    return "\n".join([*lines[:half], f"... ({len(lines) - 2 * half} lines)", *lines[-half:]])


def blocks(text: str) -> Iterator[tuple[int, Any]]:
    """The top-level statements of a script, each compiled, with the line where it ends."""
    import ast

    tree = ast.parse(text)
    for statement in tree.body:
        alone = ast.Module([statement], type_ignores=[])
        yield statement.end_lineno or statement.lineno, compile(alone, "<script>", "exec")


def run_here(script: Path) -> None:
    """Run a script statement by statement in the current folder; its outputs to ``run.json``.

    Called in a separate process, which separates the output of statements.
    """
    sys.path.insert(0, str(script.parent))
    sys.argv = [str(script)]
    names: dict[str, Any] = {"__name__": "__main__", "__file__": str(script)}
    outputs = []
    folder = Path.cwd()
    known = pictures(folder)
    for line, code in blocks(script.read_text()):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(code, names)
        now = pictures(folder)
        new = sorted(f for f in now if now[f] != known.get(f))
        known = now
        if said.getvalue() or new:
            text = shortened(said.getvalue())
            outputs.append({"line": line, "text": text, "pictures": new})
    (folder / "run.json").write_text(json.dumps({"outputs": outputs}))


def run(script: Path, folder: Path) -> str:
    """Run a script in a folder of its own, and write ``run.json`` there; why it failed, or ""."""
    command = [sys.executable, __file__, "--here", str(script)]
    path = os.pathsep.join([str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    start = time.monotonic()
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"took more than {LIMIT:.0f} s"
    if done.returncode:
        return done.stderr[-2000:]
    found = json.loads((folder / "run.json").read_text())
    found["seconds"] = round(time.monotonic() - start, 1)
    (folder / "run.json").write_text(json.dumps(found, indent=1))
    return ""


def keep(folder: Path, cached: Path) -> None:
    """Move the outputs of a run into the cache: all of them or none."""
    new = cached.with_name(f"{cached.name}.{os.getpid()}.new")
    shutil.rmtree(new, ignore_errors=True)
    pages = [file for file in folder.rglob("*") if file.suffix in PAGES]
    for file in [folder / "run.json", *pages, *(folder / name for name in pictures(folder))]:
        there = new / file.relative_to(folder)
        there.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, there)
    # Outputs of earlier versions of the script are not needed any more.
    for old in cached.parent.glob(f"{cached.name.rpartition('-')[0]}-*"):
        if old != new:
            shutil.rmtree(old)
    new.rename(cached)


def show(script: Path, cache: Path, package: str, *, run_it: bool = True) -> str:
    """Copy the outputs of a script to `SHOWN` and run it if needed; return the failure or ""."""
    cached = cache / key(script, package)
    if not cached.exists():
        if not run_it:
            return "not in the cache"
        with tempfile.TemporaryDirectory() as folder:
            why = run(script, Path(folder))
            if why:
                return why
            keep(Path(folder), cached)
        seconds = json.loads((cached / "run.json").read_text())["seconds"]
        print(f"{script.stem}: {seconds} s", flush=True)
    there = SHOWN / script.stem
    shutil.rmtree(there, ignore_errors=True)
    shutil.copytree(cached, there)
    return ""


def main() -> int:
    """Run the scripts that are not in the cache; return the number of failures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of scripts, by default all")
    parser.add_argument("--here", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--jobs", type=int, default=2, help="scripts at a time (default: 2)")
    parser.add_argument("--cached", action="store_true", help="run none, show the cached outputs")
    args = parser.parse_args()
    if args.here:
        run_here(args.here.resolve())
        return 0
    # docker/run gives its cache as XDG_CACHE_HOME, one for each environment.
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    cache = Path(home) / "dolfinx_contact_docs"
    cache.mkdir(parents=True, exist_ok=True)
    SHOWN.mkdir(parents=True, exist_ok=True)
    chosen = [s for s in scripts() if not args.names or s.stem in args.names]
    package = environment()
    start = time.monotonic()
    with ThreadPoolExecutor(args.jobs) as pool:
        jobs = [pool.submit(show, s, cache, package, run_it=not args.cached) for s in chosen]
        answers = dict(zip([s.stem for s in chosen], [j.result() for j in jobs], strict=True))
    failed = {name: why for name, why in answers.items() if why}
    for name, why in failed.items():
        print(f"{name} failed: {why}", file=sys.stderr)
    seconds = time.monotonic() - start
    print(f"{len(chosen) - len(failed)} of {len(chosen)} scripts shown, {seconds:.0f} s")
    return 0 if args.cached else len(failed)


if __name__ == "__main__":
    sys.exit(main())
