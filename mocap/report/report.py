"""The report of a run, as ``report.json`` and as readable text."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from eal.arrays import Array
from eal.potential import USUAL_LAMBDA, USUAL_WIDTH
from mocap.cameras.triangulate import project
from mocap.cleaning.cleaned import cleaned
from mocap.cleaning.positions import REASONS
from mocap.cleaning.swaps import DOUBTFUL, REPAIRS, exchanged_samples
from mocap.filters.hide import GAP_FRAMES, gap_lengths, interior_gaps, length_bins
from mocap.filters.joint_types import Articulation, undetermined
from mocap.filters.models.pose import WEIGHT
from mocap.filters.score import Score
from mocap.findings import alarms
from mocap.io.unstated_unit import length
from mocap.reading.decided import decided
from mocap.recording import Recording
from mocap.records import Status
from mocap.report.summary import ACROSS, HIDDEN, METHODS, method, notes, unit_of
from mocap.sides import words
from mocap.text import number_of, plain
from mocap.tracking.model_choice import ModelChoice
from mocap.tracking.one_camera import NAME as ONE_CAMERA
from mocap.tracking.potentials import JointPotential
from mocap.tracking.result import Result
from mocap.tracking.tracking import MOVED, lasting_cov, moved, moved_report, seen_frames

QUANTILES = (0.5, 0.9, 0.99, 1.0)
Counts = Mapping[str, Mapping[str, float]]
"""Sums over frames, so that those of a long recording are the sums of its parts' (``counts``, ``together``)."""


def counts(recording: Recording, tracked: Result, frames: slice = slice(None)) -> Counts:
    """Numbers of samples in some frames: by origin, rejected and repaired by reason; frames and their log density.

    Args:
        recording: As it was cleaned.
        tracked: As it was tracked.
        frames: Which frames.
    """
    origin, rejected = tracked.tracks.status[frames], recording.rejected
    gated = np.isfinite(tracked.innovation_px[..., 0]) & ~tracked.used
    far = moved(recording, tracked.xyz_m, tracked.cov_m2)[1] & (tracked.tracks.status == Status.REJECTED)
    far &= ~np.any(list(rejected.values()), axis=0)
    exchanged = exchanged_samples(recording.xyz_m.shape[:2], cleaned(recording).swaps)
    edited = {"edited": recording.edited} if "edited" in recording.data else {}
    likelihood = float(tracked.log_likelihood[frames].sum())
    return {
        "frames": {"number": len(origin), "log_likelihood": likelihood},
        "samples": {
            "total": origin.size,
            "seen": int(np.isfinite(recording.xyz_m[frames][..., 0]).sum()),
            **{o.name.lower(): int((origin == o).sum()) for o in Status},
            "unknown": int(tracked.data["unknown"].values[frames].sum()),
        },
        "gap_samples": own_gap_samples(origin),
        "rejected": {
            **{reason: int(mask[frames].sum()) for reason, mask in rejected.items()},
            "moved": int(far[frames].sum()),
            "rays": int(recording.rays_rejected[:, frames].sum()),
            "gated_rays": int(gated[:, frames].sum()),
        },
        "repaired": {reason: int(mask[frames].sum()) for reason, mask in (exchanged | edited).items()},
    }


def own_gap_samples(origin: NDArray[np.int8]) -> dict[str, float]:
    """How many samples lie in gaps between two sightings, by the number of ``length_bins``."""
    seen = origin == Status.MEASURED
    inside = interior_gaps(seen)
    found = np.bincount(length_bins(gap_lengths(seen)[inside]), minlength=len(GAP_FRAMES) + 1)
    return {str(i): int(count) for i, count in enumerate(found)}


def together(one: Counts, other: Counts) -> Counts:
    """The sums of both."""
    return {
        kind: {name: one[kind].get(name, 0) + other[kind].get(name, 0) for name in {**one[kind], **other[kind]}}
        for kind in one
    }


def make_report(
    recording: Recording,
    tracked: Result,
    *,
    seconds: Mapping[str, float],
    articulated: Sequence[Articulation] = (),
    whole: Counts | None = None,
) -> dict[str, object]:
    """The report of a run; plain numbers, strings, lists and dictionaries.

    Of one video without a scale, keys that name millimetres name pixels. Where these are some frames of a long
    recording, ``whole`` has its counts, and single samples are not listed.

    Args:
        recording: As it was cleaned.
        tracked: As it was tracked, with its model and potentials.
        seconds: How long each stage took.
        articulated: Segments and joints.
        whole: Counts of a long recording.
    """
    choice, found_out, potentials = tracked[ModelChoice], cleaned(tracked), tracked.potentials
    validation, away = choice.scores, moved_report(recording, tracked.tracks)
    numbers = whole or counts(recording, tracked)
    samples, total = numbers["samples"], numbers["samples"]["total"]
    if whole is not None:
        away |= {"largest": None, "samples": [], "beyond_3_sd": whole["rejected"]["moved"]}
    found, unit = tracked.findings, decided(tracked).assumed_unit
    frames, origin = seen_frames(recording), tracked.tracks.status
    shown = {"first": frames.start + 1, "last": frames.stop} if whole is None else whole["tracked"]
    late = recording.late_frames
    alike = tracked.tracks.cov_m2 - lasting_cov(recording)  # without errors that last
    repeated = np.sqrt(np.maximum(np.trace(alike, axis1=-2, axis2=-1) / 3, 0.0))
    report = {
        "name": recording.name,
        "frames": int(numbers["frames"]["number"]),
        "fps": float(1 / recording.dt_s),
        "tracked_frames": [*shown.values()],
        "markers": list(recording.names),
        "cameras": [c.name for c in recording.cameras],
        "late_frames": None if late is None else [float(one) for one in late],
        "skeleton": recording.skeleton.name,
        "model": {
            "name": tracked.model,
            "why": choice.why,
            "beta": USUAL_WIDTH,
            "lambda": USUAL_LAMBDA,
            "weight": WEIGHT,
        },
        "samples": {name: count / total for name, count in samples.items()} | {"total": total},
        "filled": samples["smoothed"] + samples["interpolated"],
        "extrapolated": samples["predicted"],
        "sd_mm": {
            "measured": _quantiles(1e3 * tracked.tracks.sd_m[origin == Status.MEASURED]),
            "filled": _quantiles(1e3 * tracked.tracks.sd_m[origin == Status.SMOOTHED]),
            "repeatability": _quantiles(1e3 * repeated[origin == Status.MEASURED]),
        },
        "moved": away,
        "residual_px": _quantiles(recording.residual_px),
        "residual_px_by_camera": residuals_by_camera(recording),
        "pixel_noise_px": {"jitter": _number(found_out.jitter_px), "slow": found_out.bias_px},
        "cameras_and_markers": _noise(recording),
        "rejected": {
            "counts": numbers["rejected"],
            "reasons": {
                **REASONS,
                **DOUBTFUL,
                **MOVED,
                "rays": "single-camera observations left out of a point that the other cameras still determine",
            },
            "samples": [
                {"frame": int(t) + 1, "marker": recording.names[m], "reason": reason}
                for reason, mask in (recording.rejected if whole is None else {}).items()
                for t, m in np.argwhere(mask)
            ],
        },
        "bad_cameras": _bad_cameras(recording),
        "repaired": {
            "counts": numbers["repaired"],
            "reasons": REPAIRS | {"edited": "corrected by hand"},
            "runs": _exchanged(recording),
        },
        "audit": [finding.as_json() for finding in found_out.audited],
        "stale_points": None if found_out.stale is None else [vars(s) for s in found_out.stale],
        "innovation": consistency(tracked),
        "log_likelihood": numbers["frames"]["log_likelihood"],
        "validation": {
            "hidden_samples": max((one.samples for one in validation.values()), default=0),
            "against": ACROSS if tracked.model == ONE_CAMERA else HIDDEN,
            "methods": {name: one.as_json() for name, one in validation.items()},
            "gaps": _by_length(validation.get(tracked.model), numbers["gap_samples"]),
        },
        "joints": {name: _joint(p) for name, p in potentials.items()},
        "held_limbs": list(tracked.limbs),
        "articulation": {
            "joints": [_articulation(joint) for joint in articulated],
            "undetermined": undetermined(articulated),
        },
        "length_m": _number(length(recording.xyz_m)),
        "assumed_unit": None if unit is None else unit.text,
        "wrong": [f.text for f in alarms(found)],
        "open": [f.text for f in found if f.asks and not f.alarm],
        "findings": [f.text for f in found],
        "seconds": {**{k: round(v, 3) for k, v in seconds.items()}, "total": round(sum(seconds.values()), 3)},
    }
    if whole is not None:
        report["blocks"] = whole["blocks"]
    if recording.plane is None:
        return report
    plane = {"unit": recording.plane.unit, "mm_per_px": recording.plane.mm_per_px}
    return {**_in(recording.plane.length, report), "plane": plane}


def _by_length(score: Score | None, own: Mapping[str, float]) -> list[dict[str, float | None]]:
    """The error to expect by length of gap, beside how many samples of the recording lie in such gaps."""
    errors = {} if score is None else dict(enumerate(score.by_length_mm))
    longest: list[int | None] = [*GAP_FRAMES, None]
    return [
        {"to_frames": most, "samples": int(own[str(i)]), "rmse_mm": _number(errors.get(i, np.nan))}
        for i, most in enumerate(longest)
    ]


def _in(unit: str, value: Any) -> Any:
    """A part of a report whose keys name this unit instead of millimetres."""
    if isinstance(value, Mapping):
        return {"_".join(unit if p == "mm" else p for p in k.split("_")): _in(unit, v) for k, v in value.items()}
    return [_in(unit, one) for one in value] if isinstance(value, list) else value


def _quantiles(values: Array) -> dict[str, float | None]:
    finite = values[np.isfinite(values)]
    return {f"{100 * q:g}%": float(np.quantile(finite, q)) if finite.size else None for q in QUANTILES}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _noise(recording: Recording) -> dict[str, object]:
    """Noise of each camera and its degrees of freedom, and the noise of each marker relative to a typical one."""
    noise = cleaned(recording).noise
    if not recording.cameras or noise is None:
        return {"sd_px": {}, "dof": {}, "marker_scale": {}}
    cameras, seen = [camera.name for camera in recording.cameras], np.isfinite(recording.uv_px[..., 0])
    total = np.where(seen, 1 / recording.ray_sd_px**2, 0.0).sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):  # that informs as much as the mean ray of each camera
        sd = np.where(total > 0, np.sqrt(seen.sum(axis=(1, 2)) / total), np.nan)
    return {
        "sd_px": dict(zip(cameras, map(_number, sd), strict=True)),
        "dof": dict(zip(cameras, map(_number, noise.dof), strict=True)),
        "marker_scale": dict(zip(recording.names, map(_number, noise.marker), strict=True)),
    }


def _bad_cameras(recording: Recording) -> list[dict[str, object]]:
    """Runs of frames, from 1, in which a camera had clearly larger errors than usual."""
    cameras = [c.name for c in recording.cameras]
    return [
        {
            "camera": cameras[bad.camera],
            "frames": [bad.start + 1, bad.stop],
            "level_px": bad.level_px,
            "good_px": bad.good_px,
            "offset_px": bad.offset_px.tolist(),
            "moved": bad.moved,
        }
        for bad in cleaned(recording).bad_cameras
    ]


def _exchanged(recording: Recording) -> list[dict[str, object]]:
    """Runs of identity switches, frames from 1; without a camera the names were swapped in all cameras."""
    cameras = [c.name for c in recording.cameras]
    return [
        {
            "markers": [recording.names[swap.a], recording.names[swap.b]],
            "camera": None if swap.camera is None else cameras[swap.camera],
            "frames": (swap.frames + 1).tolist(),
            "log_likelihood_gain": round(swap.gain, 1),
        }
        for swap in cleaned(recording).swaps
    ]


def consistency(tracked: Result) -> dict[str, float | None]:
    """Mean normalised innovation squared per observation, and the share of frames inside the 95 % band of chi-square.

    A consistent filter has 1; observations whose errors follow Student's t count by their weights.
    """
    ok = np.isfinite(tracked.nis) & (tracked.n_rows > 0)
    if not ok.any():
        return {"nis_per_row": None, "frames_in_95_band": None}
    low, high = chdtri(tracked.n_rows[ok], 0.975), chdtri(tracked.n_rows[ok], 0.025)
    inside = (tracked.nis[ok] >= low) & (tracked.nis[ok] <= high)
    return {
        "nis_per_row": float(tracked.nis[ok].sum() / tracked.n_rows[ok].sum()),
        "frames_in_95_band": float(inside.mean()),
    }


def _joint(potential: JointPotential) -> dict[str, object]:
    v = potential.potential
    at_samples = v.value(potential.samples_m / potential.scale_m)
    return {
        "samples": len(potential.samples_m),
        "lambda": v.lam,
        **{name: getattr(potential.choice, name, None) for name in ("metric", "width", "weight", "log_likelihood")},
        "effective_rank": v.effective_rank,
        "v_at_samples_median": float(np.median(at_samples)),
        "range_mm": [[float(1e3 * axis.min()), float(1e3 * axis.max())] for axis in potential.samples_m.T],
        "findings": list(v.findings),
    }


def _articulation(joint: Articulation) -> dict[str, object]:
    return {
        "centre": joint.centre,
        "child": joint.child,
        "parent": joint.parent,
        "type": joint.kind,
        "range_deg": [round(float(x), 1) for x in joint.range_deg],
        "noise_deg": round(joint.noise_deg, 1),
        "length_mm": 1e3 * joint.length_m,
        "length_varies": joint.length_sd,
        "straight": _number(joint.straight),
    }


def _held_lines(limbs: Sequence[str]) -> list[str]:
    """Which V_z is which, where both are there."""
    if not limbs:
        return []
    names = ", ".join(plain(words(name)) for name in limbs)
    return [
        "",
        "These are shown, each with the kernel chosen for it. Another V_z, with the model's fixed kernel, held "
        f"{names} in the filter: in the viewer the tabs of a joint switch between *Map* and *Held in the filter*.",
    ]


def _articulation_lines(found: Mapping) -> list[str]:
    """A line a joint of the articulated animal, and what of it the samples do not determine."""
    if not found["joints"]:
        return []
    lines = [
        "",
        "## Segments and joints",
        "",
        "The joint type that the samples need, and how far the segment moves in two principal directions, 5 to 95 %:",
        "",
        "| joint | segment to | type | range, degrees | length, mm | length varies by |",
        "|---|---|---|---|---|---|",
    ]
    for joint in found["joints"]:
        first, second = joint["range_deg"]
        lines.append(
            f"| {plain(joint['centre'])} | {plain(joint['child'])} | {joint['type']} | {first:.0f}, {second:.0f} | "
            f"{joint['length_mm']:.1f} | {joint['length_varies']:.1%} |"
        )
    return [*lines, "", *(f"- {plain(sentence)}" for sentence in found["undetermined"])]


def readable(report: Mapping, *, title: str) -> str:
    """The report as markdown."""
    rejected, noise, sd = report["rejected"]["counts"], report["pixel_noise_px"], report[f"sd_{unit_of(report)}"]
    first, last = report["tracked_frames"]
    inside = (last - first + 1) / report["frames"]  # all samples of the other frames are missing
    within = {name: report["samples"][name] / inside for name in ("measured", "smoothed", "predicted", "rejected")}
    unit, film, one_camera = unit_of(report), "plane" in report, report["model"]["name"] == ONE_CAMERA
    cameras = "one video" if film else number_of(len(report["cameras"]), "camera")
    lines = [
        f"# {plain(title)}",
        "",
        f"{number_of(report['frames'], 'frame')} at {report['fps']:g} per second, "
        f"{number_of(len(report['markers']), 'marker')}, "
        f"{cameras}; tracked from frame {first} to {last}.",
        f"Motion model: **{report['model']['name']}** ({plain(report['model']['why'])}).",
        *(["", f"**{plain(report['assumed_unit'])}**"] if report.get("assumed_unit") else []),
        "",
        "| samples of the tracked frames | share |",
        "|---|---|",
        f"| seen{'' if film or one_camera else ' in 3D'} and accepted | {within['measured']:.1%} |",
        f"| filled, inside gaps | {within['smoothed']:.1%} |",
        f"| extrapolated, before the first or after the last observation | {within['predicted']:.1%} |",
        f"| rejected | {within['rejected']:.1%} |",
        f"| left empty | {max(1 - sum(within.values()), 0.0):.1%} |",
        "",
        *_gap_lines("Against the ground truth, inside gaps", report.get("gaps"), unit),
        *_gap_lines("Against the ground truth, where markers were seen", report.get("measured"), unit),
        *_gap_lines(
            f"Samples hidden from this recording and filled again ("
            f"{number_of(report['validation']['hidden_samples'], 'sample')}"
            f"{', errors across the line of sight' if one_camera else ''})",
            report["validation"]["methods"],
            unit,
        ),
        *_length_lines(report["validation"].get("gaps", []), unit),
        "## Quality",
        "",
        f"- standard deviation of measured samples {_two(sd['measured'], unit)}, of filled ones "
        f"{_two(sd['filled'], unit)} (median, 90 %)",
        *([] if one_camera else _measured_lines(sd["repeatability"], report["moved"], unit)),
    ]
    if noise["jitter"] is not None:
        residual = report["residual_px"]
        lines.append(
            f"- triangulation residual {residual['50%']:.2f} px (median), {residual['90%']:.2f} px (90 %); "
            f"pixel noise from frame to frame {noise['jitter']:.2f} px, slowly varying errors (lens, calibration) "
            f"{noise['slow']:.2f} px"
        )
    by_camera = {name: sd for name, sd in report["cameras_and_markers"]["sd_px"].items() if sd is not None}
    if by_camera:
        dof = report["cameras_and_markers"]["dof"]
        worst = sorted(report["cameras_and_markers"]["marker_scale"].items(), key=lambda item: -item[1])[:3]
        lines.append(
            "- digitising noise by camera, in px (in brackets the degrees of freedom of Student's t: below about 5 "
            "there are many large errors): "
            + ", ".join(f"{plain(name)} {sd:.2f} ({dof[name]:.1f})" for name, sd in by_camera.items())
            + "; markers with the largest noise, relative to a typical one: "
            + ", ".join(f"{plain(name)} {scale:.2f}" for name, scale in worst)
        )
    nis = report["innovation"]
    if nis["nis_per_row"] is not None:
        lines.append(
            f"- mean squared prediction error {nis['nis_per_row']:.2f} times what the filter expects (above 2: its "
            "intervals are too narrow; near 1 is no proof that they are right)"
        )
    gated = {"gated_rays": "single-camera observations too far from where the filter predicted them"}
    lines += [
        f"- rejected samples: {_counted(rejected, report['rejected']['reasons'] | gated)}",
        f"- repaired samples: {_counted(report['repaired']['counts'], report['repaired']['reasons'])}",
    ]
    lines += ["", "## Findings", "", *(f"- **{_readable(finding)}**" for finding in report["wrong"])]
    left = [text for text in report.get("open", ()) if text != report.get("assumed_unit")]  # which stands above
    lines += [f"- **left open: {_readable(finding)}**" for finding in left]
    lines += [f"- {_readable(finding)}" for finding in notes(report)]
    if report["stale_points"]:
        stale = ", ".join(map(_stale, report["stale_points"][:40]))
        lines += [
            "",
            f"Stored 3D points that differ from the triangulation of their pixels (frame, marker, distance): {stale}",
        ]
    if report["joints"]:
        lines += [
            "",
            "## Joints",
            "",
            "| joint | samples | independent directions (effective rank of V_z) | V_z at samples (median) | metric "
            "| kernel: beta x median squared distance | lambda | weight |",
            "|---|---|---|---|---|---|---|---|",
        ]
        lines += [
            f"| {plain(name)} | {j['samples']} | {j['effective_rank']:.1f} | {j['v_at_samples_median']:.2g} "
            f"| {j['metric']} | {j['width']:g} | {j['lambda']:g} | {j['weight']:g} |"
            for name, j in report["joints"].items()
        ]
        lines += [
            "",
            "Metric, kernel, lambda and weight are those under which parts of the recording that were left out are "
            "likeliest: 1 - V_z over its integral is their density, with the weight (1 - V_z)^weight.",
            *_held_lines(report.get("held_limbs", ())),
        ]
    lines += _articulation_lines(report.get("articulation", {"joints": []}))
    if table := residual_lines(report.get("residual_px_by_camera", {})):
        lines += ["", *table[:-1]]
    if (blocks := report.get("blocks")) is not None:
        lines += [
            "",
            "## Blocks",
            "",
            f"Tracked in blocks of at most {blocks['frames']} frames. `markers.parquet` and `kinematics.parquet` hold "
            "all frames; `recording.rrd`, `markers.nc`, `recording.nc`, potentials and quantiles are of one frame in "
            f"{blocks['every']} ({blocks['shown']} frames). `mocap view FOLDER --frames 1001:2000` shows every frame.",
        ]
    if "seconds" not in report:
        return "\n".join([*lines, ""])
    seconds = ", ".join(f"{stage} {value:.1f} s" for stage, value in report["seconds"].items())
    return "\n".join([*lines, "", f"Time: {seconds}.", ""])


def _measured_lines(repeated: Mapping, found: Mapping, unit: str) -> list[str]:
    """Of points that cameras measured: how they repeat, and how far they were moved, where any were."""
    most = found["largest"]
    lines = [
        "- of that of measured samples, repeatability (what varies from frame to frame) is "
        f"{_two(repeated, unit)}; the rest is accuracy: errors of digitising, lens and calibration "
        "that last, and do not average out"
    ]
    if most is None:
        return lines
    far = number_of(found["beyond_3_sd"], "that lies", "that lie") + " more than 3 standard deviations away "
    far += "is marked rejected" if found["beyond_3_sd"] == 1 else "are marked rejected"
    return [
        *lines,
        f"- measured samples lie {found[f'median_{unit}']:.2f} {unit} (median), {found[f'90%_{unit}']:.2f} {unit} "
        f"(90 %) from where they were measured, at most {most[unit]:.2f} {unit} ({plain(most['marker'])}, frame "
        f"{most['frame']}); {far}",
    ]


def _readable(finding: str) -> str:
    """A finding, in which arguments stay between backquotes."""
    return re.sub(r"\\`(\w+)\\`", r"`\1`", plain(finding))


def _counted(counts: Mapping[str, int], reasons: Mapping[str, str]) -> str:
    """Number of samples for each reason, in words."""
    return "; ".join(f"{count} ({reasons[key]})" for key, count in counts.items() if count) or "none"


def _stale(point: Mapping) -> str:
    off = "not determined by its pixels" if point["off_m"] is None else f"{1e3 * point['off_m']:.3f} mm"
    return f"{point['frame']} {plain(point['marker'])} {off}"


def _two(quantiles: Mapping[str, float | None], unit: str) -> str:
    if quantiles["50%"] is None:
        return "-"
    return f"{quantiles['50%']:.2f} and {quantiles['90%']:.2f} {unit}"


def _gap_lines(title: str, methods: Mapping | None, unit: str) -> list[str]:
    if not methods:
        return []
    lines = [
        f"## {title}",
        "",
        "z is the root mean square of error over stated standard deviation: 1 where intervals are right.",
        "",
        f"| method | RMSE {unit} | inside 95 % intervals | z |",
        "|---|---|---|---|",
    ]
    for name, value in methods.items():
        rmse = "-" if value[f"rmse_{unit}"] is None else f"{value[f'rmse_{unit}']:.2f}"
        coverage = "-" if value["coverage95"] is None else f"{value['coverage95']:.1f} %"
        z = "-" if value["z"] is None else f"{value['z']:.2f}"
        lines.append(f"| {plain(method(name))} | {rmse} | {coverage} | {z} |")
    methods_text = "; ".join(f"{METHODS[name][0]}, {METHODS[name][1]}" for name in methods if name in METHODS)
    return [*lines, "", *([f"Methods: {methods_text}.", ""] if methods_text else [])]


def _length_lines(gaps: Sequence[Mapping], unit: str) -> list[str]:
    """A table of errors to expect by length of gap; empty where the recording has no gaps, or nothing was hidden."""
    total = sum(one["samples"] for one in gaps)
    if not total or all(one[f"rmse_{unit}"] is None for one in gaps):
        return []
    names = [f"to {one['to_frames']}" if one["to_frames"] else f"over {GAP_FRAMES[-1]}" for one in gaps]
    errors = ["-" if one[f"rmse_{unit}"] is None else f"{one[f'rmse_{unit}']:.2f}" for one in gaps]
    shares = [f"{one['samples'] / total:.0%}" for one in gaps]
    return [
        "| gaps, frames | " + " | ".join(names) + " |",
        "|---" * (len(gaps) + 1) + "|",
        f"| error to expect (RMSE {unit}) | " + " | ".join(errors) + " |",
        f"| of the {total} missing samples of this recording | " + " | ".join(shares) + " |",
        "",
    ]


def residuals_by_camera(recording: Recording) -> dict[str, dict[str, float | None]]:
    """Median distance in pixels from clicks to where their triangulated points project, by camera and by marker.

    Args:
        recording: A recording; without cameras the result is empty.

    Returns:
        For each camera its markers, and under ``all`` all of them; None where no believed point is seen.
    """
    if not recording.cameras:
        return {}
    seen_at = project(recording.matrices, recording.xyz_m)
    off = np.linalg.norm(seen_at - recording.ideal_px, axis=-1)
    found = {}
    for camera, errors in zip(recording.cameras, off, strict=True):
        columns = {name: errors[:, m] for m, name in enumerate(recording.names)}
        found[camera.name] = {
            name: float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else None
            for name, values in {"all": errors.ravel(), **columns}.items()
        }
    return found


def residual_lines(residuals: Mapping[str, Mapping[str, float | None]]) -> list[str]:
    """The table as markdown: a row a marker, a column a camera; of many markers those that miss most."""
    if not residuals:
        return []
    cameras = list(residuals)
    markers = [name for name in residuals[cameras[0]] if name != "all"]
    largest = {m: max((residuals[c][m] or 0.0) for c in cameras) for m in markers}
    markers = sorted(markers, key=lambda m: -largest[m])[:60]

    def row(title: str, name: str) -> str:
        cells = ("-" if (v := residuals[c][name]) is None else f"{v:.2f}" for c in cameras)
        return f"| {title} | " + " | ".join(cells) + " |"

    return [
        "## Reprojection errors by camera and marker",
        "",
        "Median reprojection error in px; markers with the largest first.",
        "",
        "| marker | " + " | ".join(map(plain, cameras)) + " |",
        "|---" * (len(cameras) + 1) + "|",
        row("**all**", "all"),
        *(row(plain(m), m) for m in markers),
        "",
    ]
