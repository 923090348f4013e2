"""What a process of the package's own, a command or a worker, does without."""

from __future__ import annotations

import atexit
import gc

_FEW = 10_000  # objects between two looks; Python's own number is 700


def collect_less() -> None:
    """Look less often for waste, and not at all as the process ends.

    What torch and the others bring along is hundreds of thousands of objects, none of them waste: to look
    through them costs a tenth of the time that importing them takes, and a fifth of it at the end.
    """
    first, *others = gc.get_threshold()
    if first:  # else nobody looks
        gc.set_threshold(max(first, _FEW), *others)
    atexit.register(gc.freeze)
