"""Videos of recorded rounds, as animated GIF or MP4."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import write_whole
from fpg_bench.envs.screen import FRAMES_PER_SECOND
from fpg_bench.products.rendering.picture import HEIGHT, WIDTH, Picture


def check_mp4() -> None:
    """Check that an MP4 can be written.

    Raises:
        UserError: the encoder is not installed.
    """
    require_extra("video", "imageio_ffmpeg")
    import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise UserError(f"mp4: {error}") from error


def write_gif(
    recordings: Sequence[Any],
    path: Path,
    title: str = "",
    every: int = 1,
    picture: Callable[[Any, str], Any] = Picture,
) -> None:
    """Write each ``every``-th step of the rounds, and the last step of each, as an animated GIF.

    ``picture`` draws a recording, as :class:`fpg_bench.products.rendering.picture.Picture` draws that of a
    duel.
    """
    from PIL import Image

    last = Image.fromarray(picture(recordings[-1], title).draw())
    palette = last.quantize(128)  # one palette for all frames prevents flicker
    frames = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in _frames(recordings, title, every, picture)
    )
    film = io.BytesIO()
    duration_ms = 1000 // FRAMES_PER_SECOND
    next(frames).save(film, "GIF", save_all=True, append_images=frames, duration=duration_ms, loop=0)
    write_whole(path, film.getvalue())


def write_mp4(
    recordings: Sequence[Any],
    path: Path,
    title: str = "",
    every: int = 1,
    picture: Callable[[Any, str], Any] = Picture,
) -> None:
    """Write the same frames as :func:`write_gif` as an MP4 (H.264).

    Raises:
        UserError: the encoder is not installed.
    """
    check_mp4()
    from imageio_ffmpeg import write_frames

    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / "film.mp4"
        writer = write_frames(str(film), (WIDTH, HEIGHT), fps=FRAMES_PER_SECOND, quality=7)
        writer.send(None)
        for frame in _frames(recordings, title, every, picture):
            writer.send(frame)
        writer.close()
        write_whole(path, film.read_bytes())


def _frames(
    recordings: Sequence[Any], title: str, every: int, picture: Callable[[Any, str], Any]
) -> Iterator[np.ndarray]:
    """Yield the pictures in order, with a progress bar on a terminal."""
    steps = [
        (recording, step)
        for recording in recordings
        for step in range(len(recording.frames))
        if step % every == 0 or step == len(recording.frames) - 1
    ]
    console = Console(stderr=True)
    drawn = picture(recordings[0], title)
    for recording, step in track(
        steps, "drawing", console=console, transient=True, disable=not console.is_terminal
    ):
        if drawn.recording is not recording:
            drawn = picture(recording, title)
        yield drawn.draw(step)
