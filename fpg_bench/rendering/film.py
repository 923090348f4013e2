"""Videos of recorded rounds, as animated GIF or MP4."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import require_extra
from fpg_bench.common.files import write_whole
from fpg_bench.envs.screen import FRAMES_PER_SECOND
from fpg_bench.game.recording import Recording
from fpg_bench.rendering.picture import HEIGHT, WIDTH, Picture


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


def write_gif(recordings: Sequence[Recording], path: Path, title: str = "", every: int = 1) -> None:
    """Write each ``every``-th step of the rounds, and the last step of each, as an animated GIF."""
    from PIL import Image

    last = Image.fromarray(Picture(recordings[-1], title).draw())
    palette = last.quantize(128)  # one palette for all frames prevents flicker
    frames = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in _frames(recordings, title, every)
    )
    film = io.BytesIO()
    duration_ms = 1000 // FRAMES_PER_SECOND
    next(frames).save(film, "GIF", save_all=True, append_images=frames, duration=duration_ms, loop=0)
    write_whole(path, film.getvalue())


def write_mp4(recordings: Sequence[Recording], path: Path, title: str = "", every: int = 1) -> None:
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
        for frame in _frames(recordings, title, every):
            writer.send(frame)
        writer.close()
        write_whole(path, film.read_bytes())


def _frames(recordings: Sequence[Recording], title: str, every: int) -> Iterator[np.ndarray]:
    """Yield the pictures in order, with a progress bar on a terminal."""
    steps = [
        (recording, step)
        for recording in recordings
        for step in range(len(recording.frames))
        if step % every == 0 or step == len(recording.frames) - 1
    ]
    console = Console(stderr=True)
    picture = Picture(recordings[0], title)
    for recording, step in track(
        steps, "drawing", console=console, transient=True, disable=not console.is_terminal
    ):
        if picture.recording is not recording:
            picture = Picture(recording, title)
        yield picture.draw(step)
