import numpy as np
import pytest

from fpg_bench.zoo.curves import curve_file, curves, keep_curve
from fpg_bench.zoo.zoo import load_zoo
from tests.zoo.making import ZOO, evaluations


@pytest.fixture
def zoo(tmp_path):
    (tmp_path / "zoo.yml").write_text(ZOO.replace("FIELD", "ally-v1"))
    return load_zoo(tmp_path)


def keep(zoo, member, folder, **options):
    folder.mkdir(exist_ok=True)
    (folder / "evaluations.jsonl").write_text(evaluations(**options))
    keep_curve(zoo, member, folder)


def test_a_curve_is_kept_once(zoo, tmp_path):
    one, other, *_ = zoo.members()
    keep(zoo, one, tmp_path / "one")
    keep(zoo, other, tmp_path / "other", score=5.0)
    keep(zoo, one, tmp_path / "one", count=3, score=7.0)
    rows = curve_file(zoo, one.view).read()
    assert [(r["training_seed"], r["steps"], r["score"]) for r in rows] == [
        *((1, 500 * i, 5.0 + 10 * i) for i in range(5)),
        *((0, 500 * i, 7.0 + 10 * i) for i in range(3)),
    ]


def test_the_mean_and_range_over_seeds_as_far_as_all_have_come(zoo, tmp_path):
    for k, member in enumerate(zoo.members("small/ppo")[:2]):
        keep(zoo, member, tmp_path / str(k), count=5 - k, score=4.0 * k, pace=2.0 + k)
    (found,) = curves(curve_file(zoo, zoo.views[0]).read(), "steps").values()
    assert (found.x[0], found.x[-1]) == pytest.approx((500, 1500))
    assert found.mean == pytest.approx(found.x / 50 + 2)  # both rise by 10 in 500 steps, 4 apart
    assert found.high - found.low == pytest.approx(np.full(len(found.x), 4.0))
    (by_time,) = curves(curve_file(zoo, zoo.views[0]).read(), "seconds").values()
    assert by_time.x[-1] == pytest.approx(6.0)  # as the faster one, which was not held up
    assert by_time.mean == pytest.approx(found.mean)


def test_seeds_that_have_not_begun_draw_nothing(zoo, tmp_path):
    keep(zoo, zoo.members()[0], tmp_path / "one", count=1)
    assert curves(curve_file(zoo, zoo.views[0]).read(), "steps") == {}
