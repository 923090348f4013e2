"""Learning allies: the same in any batch, and that they learn."""

from __future__ import annotations

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.registry import as_player
from fpg_bench.products.checkers import check_player
from fpg_bench.products.theory.learners import LEARNERS


@pytest.mark.parametrize("name", LEARNERS)
def test_it_keeps_the_contract_of_players(name, capsys):
    check_player(name, "ally")  # one game or many, the same bits; draws from the round's own stream
    with pytest.raises(UserError, match="plays the ally"):
        as_player(name, "opponent", STANDARD)
