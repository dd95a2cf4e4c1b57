"""Runs the released tools inside their own environment; imports nothing of the project.

A line ``{"tool": ..., "input": npz, "output": npz, "options": {...}}`` a job on stdin, ``ok`` or an error a line on
stdout. Positions come and go in millimetres: the tools' constants are made for pixels or millimetres.
"""

# pyright: reportMissingImports=false

import json
import logging
import os
import sys
import tempfile
import warnings
from contextlib import redirect_stdout

import numpy as np

HIDDEN_MM2 = 1e6
"""Variance by which EKS is told that there is no observation."""


def pose2sim(xyz, _sd, options):
    """Fill by ``interpolate_zeros_nans``, filter by ``kalman_filter_1d`` or ``butterworth_filter_1d`` of pose2sim."""
    import pandas as pd
    from Pose2Sim.common import interpolate_zeros_nans
    from Pose2Sim.filtering import butterworth_filter_1d, kalman_filter_1d

    config = {
        "filtering": {
            "kalman": {"trust_ratio": options.get("trust_ratio", 500), "smooth": True},
            "butterworth": {"order": 4, "cut_off_frequency": options.get("cutoff_hz", 6)},
        }
    }
    run = {"kalman": kalman_filter_1d, "butterworth": butterworth_filter_1d}[options["filter"]]
    flat = xyz.reshape(len(xyz), -1)
    out = np.empty_like(flat)
    for k, column in enumerate(flat.T):
        filled = interpolate_zeros_nans(pd.Series(column), options["kind"])
        out[:, k] = run(config, options["fps"], filled)
    return out.reshape(xyz.shape), None


def pykalman(xyz, sd, options):
    """Constant velocity, a marker at a time; covariances by ``KalmanFilter.em`` in learning, then ``smooth``."""
    from pykalman import KalmanFilter

    step = np.kron([[1.0, 1.0], [0.0, 1.0]], np.eye(3))
    look = np.eye(3, 6)
    out, cov = np.full_like(xyz, np.nan), np.zeros((*xyz.shape, 3))
    learned = []
    for m in range(xyz.shape[1]):
        y = np.ma.masked_invalid(xyz[:, m])
        rows = np.flatnonzero(np.isfinite(xyz[:, m, 0]))
        first = np.zeros(6)
        first[:3] = xyz[rows[0], m] if len(rows) else 0.0
        noise = np.kron([[1 / 3, 1 / 2], [1 / 2, 1.0]], np.eye(3))
        given = options.get("transition", [None] * xyz.shape[1])[m]
        model = KalmanFilter(
            transition_matrices=step,
            observation_matrices=look,
            transition_covariance=np.array(given) if given is not None else noise * options["density"],
            observation_covariance=sd[m] ** 2 * np.eye(3),
            initial_state_mean=first,
            initial_state_covariance=np.diag([1e4] * 3 + [1e2] * 3),
            em_vars=["transition_covariance"],
        )
        if options.get("em"):
            if len(rows) > 20:
                model = model.em(y, n_iter=options["em"])
            learned.append(np.asarray(model.transition_covariance))
        elif len(rows):
            mean, spread = model.smooth(y)
            out[:, m] = mean[:, :3]
            cov[:, m] = spread[:, :3, :3] * options.get("factor", 1.0) + sd[m] ** 2 * np.eye(3)
    return (np.array(learned), None) if options.get("em") else (out, cov)


def eks(xyz, sd, options):
    """``eks.core.run_kalman_smoother``, each marker a random walk, or all markers by principal components given."""
    from eks.core import run_kalman_smoother

    seen = np.isfinite(xyz)
    variance = np.where(seen, sd[None, :, None] ** 2, HIDDEN_MM2)
    if options["form"] == "marker":
        mean = np.array([np.nanmean(x, axis=0) if np.isfinite(x).any() else np.zeros(3) for x in xyz.swapaxes(0, 1)])
        y = np.where(seen, xyz - mean, 0.0)
        cov = np.array(options["step_cov"])
        k = len(mean)
        start = np.tile(1e4 * np.eye(3), (k, 1, 1))
        eye = np.tile(np.eye(3), (k, 1, 1))
        s, z, spread = run_kalman_smoother(
            y.swapaxes(0, 1), np.zeros((k, 3)), start, eye, eye, cov, variance, smooth_param=options.get("s")
        )
        if options.get("s") is None:
            return np.asarray(s), None
        return z.swapaxes(0, 1) + mean, spread.swapaxes(0, 1) + (sd**2)[None, :, None, None] * np.eye(3)
    mean, loading = np.array(options["mean"]), np.array(options["loading"])
    flat = np.where(seen, xyz, 0.0).reshape(len(xyz), -1)
    y = np.where(seen.reshape(flat.shape), flat - mean, 0.0)
    r = loading.shape[1]
    s, z, spread = run_kalman_smoother(
        y[None],
        np.zeros((1, r)),
        np.diag(options["start_var"])[None],
        np.eye(r)[None],
        loading[None],
        np.array(options["step_cov"])[None],
        variance.reshape(len(xyz), 1, -1),
        smooth_param=options.get("s"),
    )
    if options.get("s") is None:
        return np.asarray(s), None
    out = (mean + z[0] @ loading.T).reshape(xyz.shape)
    blocks = loading.reshape(xyz.shape[1], 3, r)
    cov = np.einsum("mia,tab,mjb->tmij", blocks, spread[0], blocks)
    return out, cov + (sd**2)[None, :, None, None] * np.eye(3)


def anipose(xyz, sd, options):
    """``CameraGroup.optim_points`` of aniposelib on what three virtual cameras see of the measured points."""
    from aniposelib.cameras import Camera, CameraGroup

    ever = np.isfinite(xyz[..., 0]).sum(axis=0) > 3
    points = xyz[:, ever]
    middle = np.nanmean(points, axis=(0, 1))
    points = points - middle
    far = 20 * np.nanmax(np.abs(points))
    focal = far / np.median(sd)
    cameras = []
    for axis, name in enumerate("xyz"):
        rvec = np.zeros(3)
        if axis < 2:
            rvec[axis] = np.pi / 2
        matrix = np.array([[focal, 0, 0], [0, focal, 0], [0, 0, 1.0]])
        cameras.append(Camera(matrix=matrix, dist=np.zeros(5), rvec=rvec, tvec=np.array([0, 0, far]), name=name))
    group = CameraGroup(cameras)
    index = {int(m): k for k, m in enumerate(np.flatnonzero(ever))}
    bones = [[index[a], index[b]] for a, b in options["bones"] if a in index and b in index]
    out = np.full_like(xyz, np.nan)
    seen = np.isfinite(points)
    size, overlap = options["window"], 10
    filled = np.empty_like(points)
    starts = range(0, max(1, len(points) - overlap), size)
    for start in starts:
        low, high = max(0, start - overlap), min(len(points), start + size + overlap)
        part = points[low:high]
        shown = np.where(seen[low:high], part, 0.0)
        pixels = group.project(shown.reshape(-1, 3)).reshape(3, *part.shape[:2], 2)
        pixels = np.where(seen[None, low:high, :, :2], pixels, np.nan)
        guess = options["guess"][low:high][:, ever] - middle
        solved = group.optim_points(
            pixels,
            guess,
            constraints=bones,
            scale_smooth=options["scale_smooth"],
            scale_length=options["scale_length"],
            n_deriv_smooth=options["n_deriv_smooth"],
        )
        inner = slice(start - low, min(start + size, len(points)) - low)
        filled[start : min(start + size, len(points))] = solved[inner]
    out[:, ever] = filled + middle
    return out, None


DISK_LENGTH, DISK_STRIDE, DISK_BATCH = 60, 10, 8
"""Frames of a window, frames between two of them, windows of a batch (DISK's default: 32)."""


def _disk_network(name):
    """DISK's own configuration of a network."""
    from pathlib import Path

    import DISK
    import yaml

    return yaml.safe_load((Path(DISK.__file__).parent / "conf" / "network" / f"{name}.yaml").read_text())


def disk_train(xyz, _sd, options):
    """``train_fillmissing`` of DISK on windows without gaps, the last of each trial for validation; its folder."""
    from pathlib import Path

    import torch
    from DISK.create_dataset import chop_coordinates_in_timeseries
    from DISK.create_proba_missing_files import create_uniform_proba
    from DISK.main_fillmissing import train_fillmissing

    logger, folder = logging.getLogger("disk"), Path(tempfile.mkdtemp(prefix="disk", dir=options["home"]))
    kept = DISK_LENGTH + 2 + DISK_STRIDE
    windows = {"train": [], "val": []}
    for trial in np.split(xyz, np.cumsum(options["lengths"])[:-1]):
        for part, rows in (("train", trial[:-kept]), ("val", trial[-kept:])):
            whole = np.flatnonzero(np.isfinite(rows).all(axis=(1, 2)))
            chopped = chop_coordinates_in_timeseries(
                whole, rows[whole], stride=DISK_STRIDE, length=DISK_LENGTH, logger=logger
            )
            windows[part].extend(chopped[0])
    if not windows["train"] or not windows["val"]:
        raise ValueError(f"no {DISK_LENGTH} frames in which all markers are seen")
    for part, source in (("train", "train"), ("val", "val"), ("test", "val")):
        shape = np.array(windows[source])
        np.savez(folder / f"{part}_dataset_w-0-nans.npz", X=shape, lengths=np.full(len(shape), DISK_LENGTH))
    names = [f"{m:02d}" for m in range(xyz.shape[1])]
    (folder / "constants.py").write_text(
        f"NUM_FEATURES = {3 * len(names)}\nKEYPOINTS = {names}\nDIVIDER = 3\nSEQ_LENGTH = {DISK_LENGTH}\n"
    )
    lengths, markers = create_uniform_proba(1, DISK_LENGTH - 1, names)
    lengths.to_csv(folder / "length.csv", index=False)
    markers.to_csv(folder / "marker.csv", index=False)
    torch.set_num_threads(1)
    torch.autograd.set_detect_anomaly = lambda _on: None  # a check that doubles the time
    epochs = max(1, round(options["steps"] / -(-len(windows["train"]) // DISK_BATCH)))
    train_fillmissing(
        project_dir=str(folder),
        model_dir=str(folder),
        dataset_path=str(folder),
        skeleton_graph=None,
        training_seed=1,
        load_model_dir=None,
        cfg_network=_disk_network(options["network"]),
        training_batch_size=DISK_BATCH,
        training_epochs=epochs,
        learning_rate={"transformer": 1e-3, "gru": 1e-4}[options["network"]],
        loss_type="l1",
        loss_mask=True,
        loss_factor=100,
        model_scheduler_rate=0.95,
        model_scheduler_type="lambdalr",
        model_scheduler_steps_epoch=500,
        n_cpus=0,
        print_every=1 if epochs <= 10 else 2 if epochs <= 50 else 5,
        proba_file=str(folder / "marker.csv"),
        proba_length_file=str(folder / "length.csv"),
        indep_keypoints=True,
        add_missing_pad=[1, 0],
        viewinvariant=True,
        normalize=False,
        normalizecube=True,
        swap=0.5,
        add_missing=True,
        logger=logger,
    )
    return np.array(str(folder)), None


def disk(xyz, _sd, options):
    """Each gap of a marker by DISK's network from the window about it; gaps longer than that are interpolated."""
    from pathlib import Path

    import torch
    from DISK.utils.dataset_utils import SupervisedDataset
    from DISK.utils.train_fillmissing import construct_NN_model, feed_forward
    from DISK.utils.transforms import init_transforms, reconstruct_before_normalization
    from DISK.utils.utils import load_checkpoint
    from torch.utils.data import DataLoader

    logger, folder = logging.getLogger("disk"), Path(options["folder"])
    network, names = _disk_network(options["network"]), [f"{m:02d}" for m in range(xyz.shape[1])]
    model = construct_NN_model(network, names, 3, DISK_LENGTH, None, torch.device("cpu"))
    load_checkpoint(model, None, str(next(folder.glob("model_epoch*"))), "cpu", logger)
    out, frames, gaps = np.array(xyz), np.arange(len(xyz)), []
    for m in range(len(names)):
        seen = np.isfinite(xyz[:, m, 0])
        if seen.any():
            out[:, m] = np.stack([np.interp(frames, frames[seen], xyz[seen, m, i]) for i in range(3)], axis=-1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], ~seen, [0]])))
        gaps += [(m, a, b) for a, b in edges.reshape(-1, 2) if b - a <= DISK_LENGTH - 2]
    starts = [int(np.clip((a + b - DISK_LENGTH) // 2, 0, len(xyz) - DISK_LENGTH)) for _, a, b in gaps]
    order = sorted(set(starts))
    if not order:
        return out, None
    shape = np.stack([xyz[s : s + DISK_LENGTH].reshape(DISK_LENGTH, -1) for s in order])
    np.savez(folder / "fill.npz", X=shape, lengths=np.full(len(shape), DISK_LENGTH))
    transforms = init_transforms(names, 3, DISK_LENGTH, str(folder), logger, add_missing=False, swap=0)
    windows = SupervisedDataset(
        str(folder / "fill.npz"), transform=transforms, outputdir=str(folder), keypoints=names, divider=3, logger=logger
    )
    found = []
    with torch.no_grad():
        for batch in DataLoader(windows, batch_size=32, shuffle=False):
            mean, _ = feed_forward(batch["X"], batch["mask_holes"], 3, model, True, 1, network, logger=logger)
            found.append(reconstruct_before_normalization(mean.numpy(), batch, transforms))
    place = dict(zip(order, np.concatenate(found), strict=True))
    for (m, a, b), s in zip(gaps, starts, strict=True):
        out[a:b, m] = place[s][a - s : b - s, m]
    return out, None


TOOLS = {
    "pose2sim": pose2sim,
    "pykalman": pykalman,
    "eks": eks,
    "anipose": anipose,
    "disk_train": disk_train,
    "disk": disk,
}


def main():
    """Answer jobs until stdin ends."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    for line in sys.stdin:
        job = json.loads(line)
        try:
            with np.load(job["input"]) as data, redirect_stdout(sys.stderr):
                options = {**job["options"], "home": os.path.dirname(job["input"])}
                if "guess" in data:
                    options["guess"] = data["guess"]
                first, second = TOOLS[job["tool"]](data["xyz"], data["sd"], options)
            np.savez(job["output"], first=first, **({} if second is None else {"second": second}))
            answers.write("ok\n")
        except Exception as problem:  # whatever a tool raises is for the caller to see
            answers.write(f"{type(problem).__name__}: {problem}".replace("\n", " ") + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
