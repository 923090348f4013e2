"""Several trainings in one process that take turns, so that a noisy machine hits all alike."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from fpg_bench.common.rows import Row
from fpg_bench.training.actor import ActorPlayer

TURN_S = 1.0  # of CPU time
LATER = 0.1  # of the seconds spent: how long it is at least from one look to the next


class Turns:
    """Threads of which one runs at a time, each with NumPy's and torch's global numbers to itself.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self._changed = threading.Condition()
        self._left = list(range(count))

    def begin(self, me: int) -> None:
        """Wait until it is this thread's turn."""
        with self._changed:
            self._changed.wait_for(lambda: self._left[0] == me)

    def hand_on(self, me: int) -> None:
        """Let each other thread have a turn."""
        numbers = torch.get_rng_state(), np.random.get_state()  # noqa: NPY002
        with self._changed:
            self._left.append(self._left.pop(0))
            self._changed.notify_all()
        self.begin(me)
        torch.set_rng_state(numbers[0])
        np.random.set_state(numbers[1])  # noqa: NPY002

    def end(self) -> None:
        """Take no more turns; for the thread whose turn it is."""
        with self._changed:
            self._left.pop(0)
            self._changed.notify_all()


class Looking(BaseCallback):
    """Counts the seconds of a training, has its policy scored every so many, and takes turns.

    Args:
        look: what a policy is worth.
        every_s: CPU seconds from one look to the next, and at least a tenth of those spent.
        most_s: CPU seconds after which training stops; None: at the end of its budget of steps.
        hand_on: called when a turn is over.
    """

    def __init__(
        self,
        look: Callable[[ActorPlayer], Row],
        every_s: float,
        most_s: float | None,
        hand_on: Callable[[], None],
    ) -> None:
        super().__init__()
        self.found: list[Row] = []
        self._score, self._every_s, self._hand_on = look, every_s, hand_on
        self._most_s = np.inf if most_s is None else most_s
        self._spent, self._turn = np.zeros(2), 0.0
        self._over = False

    def _on_training_start(self) -> None:
        self._begin = now()
        self._look()

    def _on_rollout_start(self) -> None:
        self._spent += now() - self._begin
        cpu_s = self._spent[0]
        self._over = cpu_s >= self._most_s
        last_s = self.found[-1]["cpu_s"]
        if self._over or cpu_s - last_s >= max(self._every_s, LATER * last_s):
            self._look()
        if cpu_s - self._turn > TURN_S:
            self._turn = cpu_s
            self._hand_on()
        self._begin = now()

    def _on_step(self) -> bool:
        return not self._over

    def _on_training_end(self) -> None:
        if not self._over:
            self._spent += now() - self._begin
            self._look()

    def _look(self) -> None:
        cpu_s, wall_s = (round(float(x), 3) for x in self._spent)
        head = {"steps": self.num_timesteps, "cpu_s": cpu_s, "wall_s": wall_s}
        self.found.append(head | self._score(ActorPlayer(self.model)))


def now() -> np.ndarray:
    """Seconds of CPU time of this process, and of the clock."""
    return np.array([time.process_time(), time.perf_counter()])


def train_together(
    makers: Mapping[str, Callable[[], tuple[BaseAlgorithm, int]]],
    look: Callable[[ActorPlayer], Row],
    every_s: float,
    most_s: float | None,
) -> dict[str, list[Row]]:
    """What was seen of each training on its way; nothing of one that diverged.

    Args:
        makers: of each the new model, and its budget of steps.
        look: what a policy is worth, called every so many seconds, which do not count.
        every_s: CPU seconds from one look to the next, and at least a tenth of those spent.
        most_s: CPU seconds after which a training ends before its budget does; None: never.
    """
    turns = Turns(len(makers))
    found: dict[str, list[Row]] = {}
    failed: list[Exception] = []

    def work(me: int, name: str, make: Callable[[], tuple[BaseAlgorithm, int]]) -> None:
        torch.set_num_threads(1)
        turns.begin(me)
        try:
            model, steps = make()
            looking = Looking(look, every_s, most_s, lambda: turns.hand_on(me))
            turns.hand_on(me)  # no model is made while another learns
            model.learn(steps, looking)
            found[name] = looking.found
        except Exception as error:
            failed.append(error)
            print(f"{name}: {' '.join(str(error).split())[:100]}", flush=True)
        finally:
            turns.end()

    run_all([threading.Thread(target=work, args=(me, *each)) for me, each in enumerate(makers.items())])
    if failed and not found:
        raise failed[0]
    return found


def run_all(threads: list[threading.Thread]) -> None:
    """Start threads and wait for them; they do not keep the process alive."""
    for thread in threads:
        thread.daemon = True
        thread.start()
    for thread in threads:
        thread.join()
