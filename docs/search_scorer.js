// Scores of the search: Sphinx's own; before them the page that a search is most likely for, and the specification
// before the pages that tell of it.
var SOUGHT = {
  "start/install": /\b(install|pip|requirements)/,
  "start/first-game": /\b(quick ?start|tutorial|getting started|first)/,
  "start/train-compare-enter": /\b(evaluate|evaluation|compare|benchmark)/,
  "environments/index": /\b(gymnasium|pettingzoo|environment)/,
  "environments/discrete-actions": /\b(discrete|action mask|dqn)/,
  "environments/scenario": /\b(scenario|custom|own rules|knowledge base|channel)/,
  "environments/teams": /\b(team|convoy|multi-agent)/,
  "guides/cluster": /\b(cluster|slurm|ray|parallel|resume)/,
  "guides/datasets": /\b(data ?sets?|minari)\b/,
  "guides/frameworks": /\b(framework|torchrl|rllib|tianshou|cleanrl)/,
  "guides/hub": /\b(hub|hugging ?face|upload|download)/,
  "guides/offline": /\b(offline|cql|iql|behaviou?r cloning)/,
  "guides/opponent": /\b(write|by hand|own (player|opponent))/,
  "guides/planners": /\b(planner|language model|llm)/,
  "guides/selfplay": /\b(self-?play|best response|double oracle|psro)/,
  "guides/training": /\b(train|training|learning curve|ppo|sac|algorithm)/,
  "guides/tuning": /\b(tun(e|ing)|optuna|hyper-?parameter)/,
  "benchmark/leaderboard": /\b(leaderboard|ranking)\b/,
  "benchmark/protocol": /\b(score|confidence interval|suite|protocol|rank)\b/,
  "benchmark/seasons": /\b(season|held-?out)/,
  "benchmark/submitting": /\b(submit|submission|enter|entry|onnx|export)/,
  "results/champions": /\b(champion|exploit|lowest known)/,
  "results/paper": /\b(paper|reproduc)/,
  "reference/measures": /\b(measure|overlap|jamming success)/,
  "reference/rules": /\b(reward|observation|rules?|step)\b/,
};
var Scorer = {
  score: ([page, , , , score]) => {
    const words = (new URLSearchParams(window.location.search).get("q") ?? "").toLowerCase();
    const specification = { "reference/rules": 30, "reference/measures": 20 }[page] ?? 0;
    return score + specification + (SOUGHT[page]?.test(words) ? 100 : 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
