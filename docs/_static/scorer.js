// The search page: pages that answer questions come before those that list names and changes.
// Points are added to the score of a page, by the longest beginning of its name that is here.
var POINTS = {
  "recipes/": 4, "tutorials/": 3, "guide/": 3, "demos/": 1,
  "recipes/index": -1, "tutorials/index": -1, "guide/index": -1,
  "install": 3, "pip": 3, "limits": 4, "which": 3,
  "verification": -4, "changelog": -10, "renamed": -10, "architecture": -10, "develop": -4
};
// The other scores are those of Sphinx.
var Scorer = {
  score: ([page, title, anchor, descr, score]) => {
    const known = Object.keys(POINTS).filter((name) => page.startsWith(name));
    const longest = known.sort((a, b) => a.length - b.length).pop();
    return score + (longest === undefined ? 0 : POINTS[longest]);
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: {0: 15, 1: 5, 2: -5}, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
