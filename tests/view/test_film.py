"""Films and frames of recordings: every step, everybody, and read back from the files."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import sandra
from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.view.film import PAST, _Stage, film, film_frame


@pytest.fixture(scope="module")
def scene():
    """A recording, cut to its first eight steps."""
    scene = sandra.load(sandra.example("recorded-ego"))
    return replace(scene, recorded_ego=scene.recorded_ego[:8])


def drawn(stage):
    """The collections of bodies that are on the stage."""
    return [artist for artist in stage.moving if hasattr(artist, "get_paths")]


def test_past_bodies_are_drawn_where_they_were(scene):
    stage = _Stage(scene, ())
    stage.show(7)
    ego = drawn(stage)[1::2]  # others and ego in turn, from the oldest on
    assert len(ego) == PAST + 1
    for step, bodies in zip(range(2, 8), ego, strict=True):
        (path,) = bodies.get_paths()
        centre = path.vertices[:4].mean(axis=0)
        assert np.allclose(centre, stage.path[step], atol=1e-9)
    stage.show(0)
    assert len(drawn(stage)) == 2  # no past yet


def test_the_others_at_a_step(scene):
    stage = _Stage(scene, ())
    stage.show(3)
    centres = [p.vertices[:4].mean(axis=0) for p in drawn(stage)[-2].get_paths()]
    window = stage._window(3)
    expected = [
        place
        for o in scene.obstacles
        for place in stage.view.points(o.states[3:4])
        if window[0] + 10 < place[0] < window[1] - 10 and window[2] < place[1] < window[3]
    ]
    assert len(expected) >= 3
    for place in expected:
        assert min(np.hypot(*(place - c)) for c in centres) < 1e-6


def test_a_gif_has_every_step_in_real_time(scene, tmp_path):
    told = []
    path = film(scene, tmp_path / "a.gif", progress=lambda *words: told.append(words))
    with Image.open(path) as picture:
        assert picture.n_frames == 8
        lengths = []
        for i in range(8):
            picture.seek(i)
            lengths.append(picture.info["duration"])
    assert sum(lengths) == pytest.approx(8 * 1000 * scene.dt)
    assert told == [(i + 1, 8) for i in range(8)]


def test_an_mp4_can_be_read(scene, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = film(scene, tmp_path / "a.mp4", speed=0.5)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert frames == 8
    assert seconds == pytest.approx(8 * scene.dt / 0.5, rel=0.01)
    reader = imageio_ffmpeg.read_frames(str(path))
    size = next(reader)["size"]
    picture = np.frombuffer(next(reader), dtype=np.uint8).reshape(size[1], size[0], 3)
    assert picture.mean() > 150  # a road on paper, not a black frame
    assert picture.std() > 10
    reader.close()


def test_a_frame_on_the_command_line(tmp_path, capsys):
    out = tmp_path / "frame.png"
    assert main(["film", "recorded-ego", "--out", str(out), "--step", "10"]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert out.stat().st_size > 5000


def test_what_cannot_be_filmed(scene, tmp_path):
    with pytest.raises(SettingsError, match=r"\.mp4 or \.gif"):
        film(scene, tmp_path / "a.avi")
    with pytest.raises(SettingsError, match="speed"):
        film(scene, tmp_path / "a.gif", speed=0.0)
    with pytest.raises(SandraError, match="no folder"):
        film(scene, tmp_path / "x" / "a.gif")
    with pytest.raises(SettingsError, match="step 8"):
        film_frame(scene, tmp_path / "a.png", 8)
    with pytest.raises(SettingsError, match="no recorded trajectory"):
        film(replace(scene, recorded_ego=None), tmp_path / "a.gif")
