// Sphinx looks for pages that have all words of a search; a question in plain words finds none.
// Here pages count that have some of them: a word weighs log(1 + pages / pages that have it), a page
// has a third of the weight of all words or more, and its score is the mean of what Sphinx gives for
// each word. A word that no page has does not count. `check_questions.py` does the same.
if (typeof Search !== "undefined") {
  const pagesWith = Search.performTermsSearch;
  Search.performTermsSearch = (searchTerms, excludedTerms) => {
    const pages = Search._index.docnames.length;
    const sums = new Map();
    let whole = 0;
    for (const term of searchTerms) {
      const results = pagesWith(new Set([term]), excludedTerms);
      if (!results.length) continue;
      const weight = Math.log(1 + pages / results.length);
      whole += weight;
      for (const result of results) {
        const page = sums.get(result[0]) || { result, weight: 0, score: 0 };
        page.weight += weight;
        page.score += weight * result[4];
        sums.set(result[0], page);
      }
    }
    return [...sums.values()]
      .filter((page) => page.weight >= whole / 3)
      .map(({ result, score }) => [...result.slice(0, 4), score / whole, ...result.slice(5)]);
  };
}
