// Scores of the search: Sphinx's own, and the specification before the pages that tell of it.
var Scorer = {
  score: ([page, , , , score]) => score + ({ "reference/rules": 30, "reference/measures": 20 }[page] ?? 0),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
