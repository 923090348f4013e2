"""The one loop that plays rounds."""

from fpg_bench.envs.two_player import make_duel
from fpg_bench.evaluation.rounds import begin_round, finish_round, make_match, play_round
from fpg_bench.game.scenario import as_scenario

SHORT = as_scenario(None, steps_per_round=20, rounds_per_match=3)


def table(ally="expert", opponent="adaptive", games=4):
    return make_match(make_duel(games, scenario=SHORT), ally, opponent)


def played(table, **options):
    play_round(table, **options)
    return table.duel.batch.tallies.copy()


def test_a_round_is_played_to_its_end_and_each_step_is_told():
    games, steps = table(), []
    play_round(games, seeds=1, on_step=lambda: steps.append(games.duel.batch.games["step"].copy()))
    assert [step.tolist() for step in steps] == [[k] * 4 for k in range(1, 21)]
    assert games.duel.batch.games["truncated"].all()


def test_without_seeds_it_is_the_next_round_of_each_match():
    games = table()
    rounds = []
    for number in range(4):
        play_round(games, seeds=5 if number == 0 else None)
        rounds.append(games.duel.batch.games["round"][0])
    assert rounds == [0, 1, 2, 0]


def test_a_round_is_the_same_in_one_call_or_two():
    whole, parts = table("random", "random"), table("random", "random")
    begin_round(parts, seeds=7)
    finish_round(parts)
    assert (played(whole, seeds=7) == parts.duel.batch.tallies).all()
    assert (played(whole, seeds=8) != played(parts, seeds=9)).any()


def test_tables_are_played_together_as_they_would_be_alone():
    one, other = table("idle"), table("always-hop")
    play_round(one, other, seeds=3)
    assert (one.duel.batch.tallies == played(table("idle"), seeds=3)).all()
    assert (other.duel.batch.tallies == played(table("always-hop"), seeds=3)).all()
