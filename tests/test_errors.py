import pytest

from fpg_bench.common.errors import nearest

KNOWN = ["ally/tone", "ally/comb", "random"]


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("ally/ton", "; did you mean 'ally/tone'?"),
        ("aly/tone", "; did you mean 'ally/tone'?"),
        ("ally/x/tone", "; did you mean 'ally/tone'?"),
        ("randm", "; did you mean 'random'?"),
        ("ally/zzz", "; known: ally/comb, ally/tone, random"),
        ("", "; known: ally/comb, ally/tone, random"),
    ],
)
def test_a_hint_names_what_is_near_in_all_parts_or_else_everything_once(word, hint):
    assert nearest(word, KNOWN * 2) == hint
