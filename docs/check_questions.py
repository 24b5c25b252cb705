# SPDX-License-Identifier: LGPL-3.0-or-later
"""Look up questions of users in the search of the built site and rank the right page.

``python3 docs/check_questions.py docs/_build/check`` takes questions, each with the page that
answers it, from ``docs/questions.csv``, and looks them up in the site's index as its search page
does: this is ``searchtools.js`` of Sphinx 8 in Python, with the site's ``scorer.js`` and
``words.js``, since there is no browser where the site is built. Every result counts, also several
of one page. The pages of all questions, the best one first, are written to ``questions.json``
beside the built pages, for a browser to be compared with.
"""

from __future__ import annotations

import csv
import json
import re
import sys
import time
from collections.abc import Iterable, Iterator
from math import floor, log
from pathlib import Path
from typing import Any, NamedTuple

import snowballstemmer

#: A page must be among so many results, for all questions but a tenth.
FIRST = 3
#: Scores of `searchtools.js`: of objects by name and priority, of titles, of words.
NAME, PART_OF_NAME, PRIORITIES = 11, 6, {0: 15, 1: 5, 2: -5}
TITLE, PART_OF_TITLE, WORD, PART_OF_WORD = 15, 7, 5, 2


class Result(NamedTuple):
    """A line of the search page."""

    page: str
    title: str
    place: str
    about: str
    score: float

    def key(self) -> tuple[float, str]:
        """Results are shown from the highest score, those of one score by their titles, a to z."""
        return -self.score, self.title.lower()


class Index:
    """The index of a built site.

    Args:
        folder: of the built pages.
    """

    def __init__(self, folder: Path):
        text = (folder / "searchindex.js").read_text()
        self.data: dict[str, Any] = json.loads(text[text.index("{") : text.rindex("}") + 1])
        language = (folder / "_static" / "language_data.js").read_text()
        stopwords = re.search(r"stopwords = (\[.*?\])", language, flags=re.DOTALL)
        assert stopwords
        self.stopwords = set(json.loads(stopwords[1]))
        self.stem = snowballstemmer.stemmer("porter").stemWord
        # Sphinx writes the scorer of `conf.py` beside the words of the language.
        points = re.search(r"POINTS = (\{.*?\})", language, flags=re.DOTALL)
        assert points
        self.points: dict[str, int] = json.loads(points[1])

    def search(self, query: str) -> list[Result]:
        """All results, the best one first."""
        words = re.findall(r"\w+", query)
        objects = {word.lower() for word in words}
        kept = [w.lower() for w in words if w.lower() not in self.stopwords and not w.isdigit()]
        terms = dict.fromkeys(self.stem(word) for word in kept)
        plain = [
            *self._titles(query.lower().strip()),
            *(result for term in objects for result in self._objects(term, objects)),
            *self._texts(terms),
        ]
        found = [r._replace(score=r.score + self._points(r.page)) for r in plain]
        found.sort(key=Result.key)
        best: dict[tuple[Any, ...], Result] = {}
        for result in found:
            best.setdefault(result[:4], result)
        return list(best.values())

    def _points(self, page: str) -> int:
        """Return the points of ``docs/_static/scorer.js`` for a page."""
        return self.points.get(max(filter(page.startswith, self.points), key=len, default=""), 0)

    def _titles(self, query: str) -> Iterator[Result]:
        """Titles and headings that hold the query, if it is at least half of them."""
        titles = self.data["titles"]
        for title, places in self.data["alltitles"].items():
            if query not in title.lower().strip() or len(query) < len(title) / 2:
                continue
            for number, place in places:
                whole = titles[number] == title
                score = floor(TITLE * len(query) / len(title) + 0.5) + whole
                name = title if whole else f"{titles[number]} > {title}"
                yield Result(self.data["docnames"][number], name, place or "", "", score)

    def _objects(self, term: str, words: set[str]) -> Iterator[Result]:
        """Names of the API that hold a word, if the others are near."""
        for prefix, members in self.data["objects"].items():
            for number, kind, priority, anchor, name in members:
                whole = f"{prefix}.{name}" if prefix else name
                low = whole.lower()
                last = low.split(".")[-1]
                if term not in low:
                    continue
                label = self.data["objnames"][str(kind)][2]
                title = self.data["titles"][number]
                near = f"{prefix} {name} {label} {title}".lower()
                if any(word not in near for word in words - {term}):
                    continue
                score = NAME if term in (low, last) else PART_OF_NAME if term in last else 0
                score += PRIORITIES.get(priority, 0)
                about = f"{label}, in {title}"
                yield Result(self.data["docnames"][number], whole, anchor, about, score)

    def _texts(self, terms: Iterable[str]) -> Iterator[Result]:
        """Pages that have the words, or many of them, as ``docs/_static/words.js`` finds them."""
        pages = len(self.data["docnames"])
        found = {term: scores for term in terms if (scores := self._text(term))}
        weights = {term: log(1 + pages / len(scores)) for term, scores in found.items()}
        sums: dict[int, list[float]] = {}
        for term, scores in found.items():
            for number, score in scores.items():
                both = sums.setdefault(number, [0.0, 0.0])
                both[0] += weights[term]
                both[1] += weights[term] * score
        whole = sum(weights.values())
        for number, (weight, score) in sums.items():
            if weight >= whole / 3:
                title = self.data["titles"][number]
                page = self.data["docnames"][number]
                yield Result(page, title, "", "", score / whole)

    def _text(self, term: str) -> dict[int, int]:
        """Pages that have a word, with its score."""
        scores: dict[int, int] = {}
        for field, whole, part in (
            ("terms", WORD, PART_OF_WORD),
            ("titleterms", TITLE, PART_OF_TITLE),
        ):
            known = self.data[field]
            exact = term in known
            names = [term] if exact else [n for n in known if len(term) > 2 and term in n]
            for name in names:
                pages = known[name]
                for number in [pages] if isinstance(pages, int) else pages:
                    scores[number] = max(scores.get(number, 0), whole if exact else part)
        return scores


def main() -> int:
    """Print rank and time of each question; 1 if more than a tenth are missed."""
    index = Index(Path(sys.argv[1]))
    with Path(__file__).with_name("questions.csv").open() as file:
        questions = list(csv.DictReader(file))
    answered = 0
    found: dict[str, list[str]] = {}
    for row in questions:
        start = time.perf_counter()
        pages = [result.page for result in index.search(row["question"])]
        found[row["question"]] = pages
        milliseconds = 1e3 * (time.perf_counter() - start)
        rank = pages.index(row["page"]) + 1 if row["page"] in pages else 0
        answered += 0 < rank <= FIRST
        before = ", ".join(pages[:FIRST]) if not 0 < rank <= FIRST else ""
        said = f"rank {rank} of {len(pages)}" if rank else f"not among {len(pages)}"
        print(f"{said:18} {milliseconds:5.1f} ms  {row['question']}: {row['page']}")
        if before:
            print(f"{'':28}  first are {before}")
    least = len(questions) - len(questions) // 10
    print(f"{answered} of {len(questions)} among the first {FIRST}; {least} are asked for")
    Path(sys.argv[1], "questions.json").write_text(json.dumps(found, indent=1))
    return int(answered < least)


if __name__ == "__main__":
    sys.exit(main())
