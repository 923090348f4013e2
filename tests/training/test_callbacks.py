"""Progress of a training where no bar can be drawn."""

import pytest

from fpg_bench.training import callbacks
from tests.training.tiny import train_tiny


class Clock:
    """Goes on by so many seconds whenever it is read."""

    def __init__(self, seconds):
        self.now, self.seconds = 0.0, seconds

    def __call__(self):
        self.now += self.seconds
        return self.now


def records_of(capsys):
    return [line for line in capsys.readouterr().out.splitlines() if line.startswith("training: ")]


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "td3"])
def test_a_line_is_printed_for_each_tenth(algorithm, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(callbacks.time, "monotonic", Clock(1e-6))
    train_tiny(algorithm, tmp_path / "run", progress=True)
    found = records_of(capsys)
    assert found[-1].startswith("training: 1,200 of 1,200 steps, ")
    assert 3 <= len(found) <= 10


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "td3"])
def test_and_wherever_thirty_seconds_went_by_without_one(algorithm, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(callbacks.time, "monotonic", Clock(callbacks.LINE_EVERY_S))
    train_tiny(algorithm, tmp_path / "run", progress=True)
    found = records_of(capsys)
    assert len(found) >= 1200 // 4  # four games a step: a line for each
    assert found[0].startswith("training: 4 of 1,200 steps, ")
