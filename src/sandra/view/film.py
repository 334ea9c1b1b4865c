"""A recording as a film (.mp4, .gif) or as one frame of it (.png, .pdf, .svg).

Drawn from the recorded states, so that any recording can be filmed, of a simulation or of a file;
no window is opened. Past bodies are drawn as in the paper's figure of highway-env: those of the
last second, five of them, the older the fainter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SandraError, SettingsError
from sandra.scene.types import Region, Scene
from sandra.view import palette
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked
from sandra.view.scene import axes_in, draw_map
from sandra.view.shapes import View, Window, touches

Array = NDArray[np.float64]

FILMS = ("mp4", "gif")
BEHIND, AHEAD, ASIDE = 25.0, 85.0, 11.0
"""What is seen of the road, from the ego on [m]."""
PAST = 5
"""So many past bodies of each vehicle are drawn."""
PAST_EVERY = 0.2
"""Time between them [s]."""
_WIDE, _DPI = 9.6, 100


def film(
    scene: Scene,
    path: str | Path,
    *,
    captions: Sequence[str] = (),
    speed: float = 1.0,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Path:
    """Write a recording as a film.

    Args:
        scene: one with `recorded_ego`; the others move as far as they have `states`.
        path: its suffix says the format: .mp4 or .gif.
        captions: what is written above each step, such as what was decided (fewer: the last one
            stays). speed: 1 plays in real time, 0.5 half as fast.
        progress: called after each frame.

    Raises:
        SettingsError: another suffix or speed, a scene without a recorded ego, or no encoder.
        SandraError: the file cannot be written.
    """
    where = Path(path)
    kind = where.suffix.lower().lstrip(".")
    if kind not in FILMS:
        raise SettingsError(f"{where}: a film's name must end in .mp4 or .gif")
    if not speed > 0.0:
        raise SettingsError(f"speed = {speed} must be positive")
    if not where.parent.is_dir():
        raise SandraError(f"{where}: there is no folder {where.parent}; make it first")
    stage = _Stage(scene, captions)
    pause = scene.dt / speed
    frames = _counted(stage.frames(), len(stage.ego), progress)
    try:
        (_write_mp4 if kind == "mp4" else _write_gif)(frames, where, pause)
    except OSError as error:
        raise SandraError(f"{where}: cannot be written ({error.strerror or error})") from None
    return where


def film_frame(
    scene: Scene, path: str | Path, step: int, *, captions: Sequence[str] = (), dpi: int = 150
) -> Path:
    """Write one step of a recording as a picture (.png, .pdf or .svg); see `film`.

    Raises:
        SettingsError: also for a step that was not recorded.
    """
    where = checked(path, dpi)
    stage = _Stage(scene, captions)
    if not 0 <= step < len(stage.ego):
        raise SettingsError(f"step {step} was not recorded; there are 0 to {len(stage.ego) - 1}")
    stage.show(step)
    return stage.page.save(where, dpi)


class _Stage:
    """The map, drawn once, and on it what changes from step to step."""

    def __init__(self, scene: Scene, captions: Sequence[str]) -> None:
        if scene.recorded_ego is None:
            raise SettingsError(f"{scene.name}: has no recorded trajectory of the ego to film")
        self.scene, self.captions, self.ego = scene, tuple(captions), scene.recorded_ego
        self.view = View.of(scene)
        self.path = self.view.points(self.ego)
        self.stride = max(1, round(PAST_EVERY / scene.dt))
        road = np.vstack([self.view.points(x) for n in scene.lanelets for x in (n.left, n.right)])
        near = road[np.abs(road[:, 1] - self.path[0, 1]) < 3 * ASIDE, 1]
        straight = np.ptp(self.path[:, 1]) < ASIDE and near.size > 0
        # On a straight road the picture stands still across it, and shows its whole width.
        self.low, self.high = (
            (float(near.min()) - 1.0, float(near.max()) + 1.0) if straight else (-ASIDE, ASIDE)
        )
        self.follows = not straight
        wide = _WIDE - 2 * MARGIN
        high = wide * (self.high - self.low) / (BEHIND + AHEAD)
        self.page = Page(_WIDE, _even(high + 2 * MARGIN + 0.1))
        self.ax = self.page.axes(MARGIN, MARGIN + 0.1, wide, high)
        whole = (
            float(self.path[:, 0].min()) - AHEAD,
            float(self.path[:, 0].max()) + AHEAD,
            float(self.path[:, 1].min()) + min(self.low, -AHEAD),
            float(self.path[:, 1].max()) + max(self.high, AHEAD),
        )
        draw_map(self.ax, self.view, whole, arrows=False)
        self.moving: list[Any] = []

    def frames(self) -> Iterator[NDArray[np.uint8]]:
        """(height, width, 3) pictures, one for each step."""
        self.page.figure.set_dpi(_DPI)
        canvas: Any = self.page.figure.canvas
        for step in range(len(self.ego)):
            self.show(step)
            canvas.draw()
            yield np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])

    def show(self, step: int) -> None:
        """Put everybody where they were at a step."""
        for artist in self.moving:
            artist.remove()
        self.moving = []
        window = self._window(step)
        axes_in(self.ax, window, ticks=False)
        self.ax.tick_params(length=0)
        for age in range(PAST, -1, -1):
            past = step - age * self.stride
            if past >= 0:
                self._bodies(past, age, window)
        speed = float(self.ego[step, 3])
        facts = [self.scene.name, f"{step * self.scene.dt:.2f} s", f"ego {speed:.1f} m/s"]
        if self.captions:
            facts.append(self.captions[min(step, len(self.captions) - 1)])
        line = fitted(" · ".join(facts), _WIDE - 2 * MARGIN, 8.5)
        self.moving.append(self.page.text(MARGIN, MARGIN - 0.15, line, size=8.5))

    def _window(self, step: int) -> Window:
        x, y = self.path[step] if self.follows else (self.path[step, 0], 0.0)
        return float(x) - BEHIND, float(x) + AHEAD, float(y) + self.low, float(y) + self.high

    def _bodies(self, step: int, age: int, window: Window) -> None:
        """The bodies at a step; of the past, the older the fainter."""
        from matplotlib.collections import PolyCollection

        others = []
        for obstacle in self.scene.obstacles:
            if obstacle.states is None:
                state = obstacle.state
                pose = np.array([state.x, state.y, state.heading])
                if age > 0:
                    continue
            elif step >= len(obstacle.states):
                continue
            else:
                pose = obstacle.states[step, :3]
            if np.isfinite(pose).all():
                others.append(self._outline(obstacle.outline, pose))
        others = [outline for outline in others if touches(window, outline)]
        ego = [self._outline(self.scene.ego.outline, self.ego[step, :3])]
        fade = 0.35 + 0.6 * age / (PAST + 1) if age else 0.0
        for outlines, colour, z in ((others, palette.OTHER, 4.0), (ego, palette.EGO, 5.0)):
            bodies = PolyCollection(
                outlines,
                facecolors=[palette.faded(colour, fade)],
                edgecolors=palette.INK if age == 0 else palette.PAPER,
                linewidths=0.5,
                zorder=z - age / 10,
            )
            self.moving.append(self.ax.add_collection(bodies, autolim=False))

    def _outline(self, outline: Region, pose: Array) -> Array:
        import shapely

        body = self.view.body(outline, pose.tolist())
        corners: Array = shapely.get_coordinates(body.exterior)
        return corners


def _even(height: float) -> float:
    """The height of which an encoder can make an even number of pixels [inch]."""
    return 2 * round(height * _DPI / 2) / _DPI


def _counted(
    frames: Iterator[NDArray[np.uint8]], total: int, progress: Callable[[int, int], None]
) -> Iterator[NDArray[np.uint8]]:
    for i, frame in enumerate(frames):
        yield frame
        progress(i + 1, total)


def _write_mp4(frames: Iterator[NDArray[np.uint8]], where: Path, pause: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError:
        raise SettingsError(
            f"{where}: an .mp4 needs an encoder; pip install 'sandra[highway]', or name a .gif"
        ) from None
    first = next(frames)
    size = first.shape[1], first.shape[0]
    writer = imageio_ffmpeg.write_frames(
        str(where), size, fps=1 / pause, macro_block_size=2, quality=8, ffmpeg_log_level="error"
    )
    writer.send(None)
    try:
        writer.send(first)
        for frame in frames:
            writer.send(frame)
    finally:
        writer.close()


def _write_gif(frames: Iterator[NDArray[np.uint8]], where: Path, pause: float) -> None:
    from PIL import Image

    pictures = [Image.fromarray(frame).quantize(64) for frame in frames]
    # The format knows hundredths of a second only: the sum of the pauses stays right.
    ends = np.round(100 * pause * np.arange(len(pictures) + 1)).astype(int)
    pauses = [10 * max(2, int(p)) for p in np.diff(ends)]
    pictures[0].save(where, save_all=True, append_images=pictures[1:], duration=pauses, loop=0)
