"""Conformance: checks to call on a player, planner, scenario or view of one's own, in a test or a notebook.

Each returns nothing where all is well; what is wrong is an :class:`AssertionError` of one line that says
what, and how to mend it::

    from fpg_bench.testing import check_player

    check_player(MyAlly(), "ally")
"""

from fpg_bench.testing.planners import check_planner
from fpg_bench.testing.players import check_player
from fpg_bench.testing.scenarios import check_scenario
from fpg_bench.testing.views import VIEW_CHECKS, check_view

__all__ = ["VIEW_CHECKS", "check_planner", "check_player", "check_scenario", "check_view"]
