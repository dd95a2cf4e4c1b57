"""The commands of pages that the site does not run, typed as they stand there, with the numbers that the pages show."""

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mocap.datasets import make_lizard, write_recording

import mocap as library
from docs.tools import columns
from mocap.digitising.clicks import write_clicks
from mocap.io.dltdv import write_pixels
from mocap.io.dvproject import read_project
from tests.mocap.digitising.filmed import NAMES, video
from tests.real_data import real

DOCS = Path(__file__).resolve().parents[2] / "docs"
NEAR = 0.03
"""How far a number that a page shows may be from that of today: other processors round otherwise."""


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def typed(text: str, command: str) -> list[str]:
    """Lines of a page, in blocks or indented, that call a command of mocap."""
    return re.findall(rf"^ +(mocap {command} .*)$", text, re.MULTILINE)


@pytest.fixture
def typing(mocap, tmp_path, monkeypatch):
    """What a line prints on stdout, typed in a folder of its own; ``>`` writes it to a file, ``*`` stands for names."""
    monkeypatch.chdir(tmp_path)

    def type_(line: str) -> str:
        line, _, target = line.partition(" > ")
        words = [
            name
            for word in shlex.split(line)[1:]
            for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
        ]
        code, out, err = mocap(*words)
        assert code == 0, err
        if target:
            Path(target).write_text(out, encoding="utf-8")
        return out

    return type_


def same_but_for_rounding(shown: str, printed: str) -> bool:
    """Whether a text of a page is what is printed: words exactly, numbers nearly."""
    number = r"[-+]?\d+(?:\.\d+)?"
    words = [re.sub(r"\s+", " ", re.sub(number, "#", text)).strip() for text in (shown, printed)]
    numbers = [[float(one) for one in re.findall(number, text)] for text in (shown, printed)]
    return words[0] == words[1] and np.allclose(*numbers, rtol=NEAR, atol=0.02)


def test_the_real_recording_of_the_tutorial_prints_what_the_page_shows(typing):
    """Three commands; the last lines of the third, each sentence of the page, and the numbers of its next steps."""
    for name in ("xypts.csv", "dltCoefs.csv", "camera_profile.txt"):
        shutil.copy(real("bat_windtunnel_dltdv8", "derived_csv", "FE404_F2", f"FE404_F2_{name}"), ".")
    text = page("tutorials/from_files_to_figure.md")
    for command in ("info", "skeleton", "track"):
        (line,) = typed(text, command)
        printed = typing(line)
    (block,) = re.findall(r"```\n(What is wrong.*?)```", text, re.DOTALL)
    found = printed[printed.index("What is wrong") :]
    for shown, told in zip(block.split("\n\n"), found.split("\n\n"), strict=True):
        assert same_but_for_rounding(shown, told), told
    report = library.load("out/FE404").report
    error = report["validation"]["methods"][report["model"]["name"]]["rmse_mm"]
    (rmse, share) = re.findall(r"\*\* ([\d.]+) mm in gaps is ([\d.]+) % of the animal's length", text)[0]
    assert float(rmse) == pytest.approx(error, rel=NEAR)
    assert float(share) == pytest.approx(error / report["length_m"] / 10, rel=NEAR)


def test_digitising_goes_from_videos_to_tracks_as_the_page_types(typing):
    """Its two commands, on painted dots in three videos; every file that the page names is there."""
    scene = video(Path(), n_frames=40)
    for old, new in {"films": "videos", "calibration.toml": "rig.toml", "skeleton.toml": "bat.toml"}.items():
        Path(old).rename(new)
    cameras = tuple(camera.name for camera in scene.cameras)
    write_clicks(Path("clicks.csv"), scene.clicks(), names=NAMES, cameras=cameras, n_frames=40, fps=240.0)
    text = page("howto/digitising.md")
    first = next(line for line in typed(text, "digitise") if "--start" in line)
    typing(first)
    typing(typed(text, "track")[0])
    table = text[text.index("| file | contents |") : text.index("## How it works")]
    named = re.findall(
        r"`([\w.]+\.(?:csv|txt|toml|md|json))`", "\n".join(re.findall(r"^\| (`.*?) \|", table, re.MULTILINE))
    )
    assert len(named) >= 10
    assert [name for name in named if not (Path("out/trial") / name).is_file()] == []
    assert len(pd.read_csv("out/tracked/markers.csv")) == 40
    assert not columns.undocumented(pd.read_csv("out/trial/asked.csv", nrows=0).columns, "asked.csv", {})


@pytest.fixture
def tunnel_and_field(tmp_path, monkeypatch):
    """Three walks filmed by all cameras, a fourth by the first one alone, under the names of the page."""
    monkeypatch.chdir(tmp_path)
    Path("tunnel").mkdir()
    for seed in range(4):
        made = make_lizard(seed=seed, n_frames=45)
        files = write_recording(made, Path(f"made{seed}"))
        if seed < 3:
            shutil.copy(files["pixels"], f"tunnel/walk{seed}_xypts.csv")
            continue
        pixels = pd.read_csv(files["pixels"])
        pixels.iloc[[0, 1, -1]] = np.nan  # the animal comes and goes
        pixels[[name for name in pixels if "_cam1_" in name]].to_csv("field_xypts.csv", index=False)
        coefficients = np.loadtxt(files["coefficients"], delimiter=",")
        np.savetxt("tunnel_dltCoefs.csv", coefficients, delimiter=",")
        np.savetxt("field_dltCoefs.csv", coefficients[:, 0])
        lines = files["profile"].read_text(encoding="utf-8").splitlines()
        Path("tunnel_camera_profile.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
        Path("field_camera_profile.txt").write_text(lines[0] + "\n", encoding="utf-8")
        shutil.copy(files["skeleton"], "bat.toml")
    return made


def test_one_camera_learns_in_the_tunnel_and_tracks_in_the_field(typing, tunnel_and_field):
    """The page's two commands; depth is that of the truth to the per cent by which animals of the model differ."""
    text = page("howto/one_camera.md")
    for command in ("learn", "track"):
        (line,) = typed(text, command)
        typing(line)
    found = library.load("field")
    assert len(found.cameras) == 1
    truth = tunnel_and_field.truth.xyz_m
    error = np.linalg.norm(found.tracks.xyz_m - truth, axis=-1)
    centre = np.linalg.inv(found.cameras[0].matrix[:, :3]) @ -found.cameras[0].matrix[:, 3]
    distance = np.linalg.norm(np.nanmean(truth, axis=(0, 1)) - centre)
    assert np.nanmedian(error) < 0.05 * distance
    assert "percent" in found.report_text or "%" in found.report_text


@pytest.mark.rare
def test_one_camera_of_a_real_flight_errs_by_what_the_page_states(typing):
    """Three flights teach, camera 1 of F5 alone is tracked; the reference is F5 by all four. To a tenth."""
    tunnel = real("bat_windtunnel_dltdv8")
    derived = tunnel / "derived_csv"
    names = (derived / "078A3_F5" / "078A3_F5_pointnames.txt").read_text(encoding="utf-8").split()
    Path("tunnel").mkdir()
    for flight in ("F1", "F3", "F4", "F5"):
        (path,) = (tunnel / "078A3" / flight).glob("*dvProject.mat")
        pixels = read_project(path).pixels
        pixels = replace(pixels, names=tuple(names), uv_px=pixels.uv_px[:, :, : len(names)])
        write_pixels(Path("all_xypts.csv" if flight == "F5" else f"tunnel/{flight}_xypts.csv"), pixels)
    seen = pd.read_csv("all_xypts.csv")
    seen[[name for name in seen if "_cam1_" in name]].to_csv("field_xypts.csv", index=False)
    coefficients = np.loadtxt(derived / "078A3_F5" / "078A3_F5_dltCoefs.csv", delimiter=",")
    lens = (derived / "FE404_F2" / "FE404_F2_camera_profile.txt").read_text(encoding="utf-8").splitlines()
    for name, some in (("tunnel", slice(4)), ("field", slice(1))):
        np.savetxt(f"{name}_dltCoefs.csv", coefficients[:, some], delimiter=",")
        Path(f"{name}_camera_profile.txt").write_text("\n".join(lens[some]) + "\n", encoding="utf-8")
    trunk = '["str", "lmb", "nl", "shdL", "shdR", "ankL", "ankR"]'
    markers = ", ".join(f'"{name}"' for name in names)
    Path("bat.toml").write_text(f'name = "bat"\nmarkers = [{markers}]\nbones = []\ntrunk = {trunk}\n', encoding="utf-8")
    text = page("howto/one_camera.md")
    (learn,), (track,) = typed(text, "learn"), typed(text, "track")
    typing(learn)
    typing(f"{track} --no-validate")
    four = (
        track.replace("field_xypts", "all_xypts")
        .replace("field_", "tunnel_")
        .replace("--model bat.npz --out field", "")
    )
    typing(f"{four} --out all --no-validate")
    one, all_ = library.load("field").tracks, library.load("all").tracks
    place = [all_.names.index(name) for name in one.names]
    error = np.where((all_.status[:, place] == 1)[..., None], one.xyz_m - all_.xyz_m[:, place], np.nan)
    error = error[np.isfinite(error[..., 0]).sum(axis=1) > 1]
    relative = error - np.nanmean(error, axis=1, keepdims=True)
    (stated,) = re.findall(r"F5, camera 1; .*?: ([\d.]+) mm RMS, ([\d.]+) relative", text)
    for value, missed in zip(stated, (error, relative), strict=True):
        assert 1e3 * np.sqrt(np.nanmean(np.sum(missed**2, axis=-1))) == pytest.approx(float(value), rel=0.1)
