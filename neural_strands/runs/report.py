"""The report of a run: the paper's tables for this capture, and pictures, on one page."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.geometry_metrics import GeometryScore
from neural_strands.evaluation.page import Gallery, Table, Turntable, write_page
from neural_strands.evaluation.strands_in_view import HEADS as STRAND_HEADS
from neural_strands.evaluation.strands_in_view import mean_strands_in_view
from neural_strands.evaluation.view_quality import HEADS, mean_quality
from neural_strands.fitting.photographs.trimap import reference_alpha
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.pictures.encoding import encode_png, encode_webp, write_png
from neural_strands.pictures.fields import difference_picture
from neural_strands.pictures.lines import lines_over_photograph, lines_picture
from neural_strands.pictures.plots import curves_plot
from neural_strands.runs.evaluate import GRAIN, Evaluation, RunContents
from neural_strands.runs.run_folder import read_description
from neural_strands.runs.run_log import loss_label, read_losses

PAPER_ROWS = {
    "paper, short: LMVS": ((56.91, 12.11, 19.98), (93.42, 30.29, 45.75), (98.85, 46.62, 63.36)),
    "paper, short: strands": ((52.79, 13.78, 21.85), (92.94, 48.38, 63.64), (98.18, 71.51, 82.75)),
    "paper, long: LMVS": ((26.25, 16.54, 20.30), (75.13, 39.12, 51.45), (93.51, 54.01, 68.47)),
    "paper, long: strands": ((32.59, 14.62, 20.19), (71.40, 42.06, 52.94), (71.40, 62.91, 66.89)),
}
"""Precision, recall and F at (1 mm, 10°), (2 mm, 20°), (3 mm, 30°) in the paper's table 1, on its own grooms."""
PAPER_IMAGES = ("paper, real hair", "31.30", "0.9452", "0.0811", *("" for _ in HEADS[3:]))
PAPER_MILLISECONDS = ("paper (NVIDIA V100)", "34.54", "38.82", "73.36")
MOST_VIEWS = 4
TURN_FRAMES, STILL_EVERY = 24, 3
"""Number of frames of the turntable, and the step between those that are also shown as stills."""
TURN_SIDE = 512
"""Largest side of a rendered frame, pixels; about the scale at which models are trained."""
STRIP_SIDE = 288
"""Side of a frame of the moving picture, pixels."""


def write_report(run: RunContents, result: Evaluation) -> None:
    """Write RUN/report/index.html, and RUN/report/summary.png: photograph, strands and rendering of one view.

    Raises:
        InputError: the folder cannot be written.
    """
    tables = [_images_table(result), _strands_table(result), _time_table(result)]
    if result.ours:
        tables.insert(0, _geometry_table(result))
    turntable, stills = _turntable(run)
    galleries = [_views_gallery(result), _alpha_gallery(run, result), _geometry_gallery(run), stills]
    losses = read_losses(run.folder.log)
    if losses:
        named = {loss_label(name): curve for name, curve in losses.items()}
        plot = encode_png(curves_plot(named, "losses"))
        galleries.append(
            Gallery("Losses during the fit", (("each point is a mean over several steps", plot),), columns=1)
        )
    strands = run.renderer.strands
    summary = (
        f"{len(strands):,} strands of {strands.points_per_strand} points each, fitted to {len(run.capture)} "
        f"photographs of {run.capture.folder.name} and to the {run.segments.segment_count:,} line segments that stereo "
        "found in them."
    )
    title = f"Neural Strands: {run.capture.folder.name}"
    write_page(run.folder.report / "index.html", title, summary, tables, galleries, turntable)
    write_png(run.folder.report / "summary.png", _summary(run, result))


def _summary(run: RunContents, result: Evaluation) -> Float[Tensor, "height width 3"]:
    """An evaluated view: photograph, reconstructed strands by direction, rendering."""
    place = len(result.views) - 1
    camera = run.capture.cameras[run.shown[place]].to(run.renderer.strands.points.device)
    strands = lines_picture(run.renderer.strands.points, camera, run.head.mesh).cpu()
    view = result.clean[place].view
    return torch.cat([view.photograph, strands, view.rendered], dim=1)


def _geometry_table(result: Evaluation) -> Table:
    names = [_spaced(score.threshold.name) for score in result.ours[:3]]
    heads = ("", *(f"{what} {name}" if what == "P" else what for name in names for what in ("P", "R", "F")))
    rows = [
        (f"{result.segment_count:,} line segments (LMVS)", *_cells(result.lmvs)),
        (f"{result.strand_count:,} fitted strands", *_cells(result.ours)),
    ]
    rows += [(name, *(f"{value:.2f}" for row in figures for value in row)) for name, figures in PAPER_ROWS.items()]
    consistency = ", ".join(
        f"{score.strand_consistency or 0:.1f} % at {_spaced(score.threshold.name)}" for score in result.ours
    )
    long = "" if result.lengths is None else f" Lengths of the strands: {result.lengths.as_text()}."
    inside = "" if result.head_fit is None else f" Points inside the head: {result.head_fit.inside:.2f} %."
    note = (
        "P: percentage of the points found that are right, within the distance and angle above; R: percentage of the "
        "true points that were found; F: their harmonic mean. Points are at most 0.5 mm apart, and lines count in both "
        "directions. The paper's rows are of its own grooms. "
        f"Strand consistency, the share of a true strand that a single fitted one matches: {consistency}.{long}{inside}"
    )
    return Table("Geometry compared with the true strands", heads, tuple(rows), note)


def _spaced(threshold: str) -> str:
    """A threshold's name for people: "2 mm 20°" for "2mm/20deg"."""
    return threshold.replace("deg", "°").replace("mm/", " mm ")


def _cells(scores: tuple[GeometryScore, ...]) -> tuple[str, ...]:
    return tuple(f"{value:.2f}" for score in scores[:3] for value in score.unsigned.as_dict().values())


def _images_table(result: Evaluation) -> Table:
    rows = [(f"view {each.view.name}", *each.quality.cells()) for each in result.views]
    rows += [
        ("mean", *mean_quality(result.views).cells()),
        ("mean without grain", *mean_quality(result.clean).cells()),
        PAPER_IMAGES,
    ]
    title = "Held-out views" if result.held_out else "Training views (none was held out)"
    note = (
        f"Pictures are compared with {100 * GRAIN:.0f} % of the photographs' grain over the hair, except in the row "
        "without grain, which is what one sees elsewhere."
    )
    return Table(title, ("", *HEADS), tuple(rows), f"{note} {result.lpips_note}".strip())


def _strands_table(result: Evaluation) -> Table:
    names = [each.view.name for each in result.views]
    rows = [(f"view {name}", *found.cells()) for name, found in zip(names, result.in_views, strict=True)]
    rows.append(("mean", *mean_strands_in_view(result.in_views).cells()))
    note = (
        "Direction: share of the hair in which the strands run within 20° of the streaks in the photograph; clear "
        "streaks count more. On background: share of the rendered hair that lies outside the person. Mask on "
        "background: the same share of the hair mask itself, whose border is soft. "
        f"{result.unseen:.1f} % of the strands lie mostly where no photograph could see them; these are guessed."
    )
    return Table("Strands in the photographs", ("", *STRAND_HEADS), tuple(rows), note)


def _time_table(result: Evaluation) -> Table:
    total = result.decode_ms + result.render_ms
    rows = (
        ("this machine", f"{result.decode_ms:.1f}", f"{result.render_ms:.1f}", f"{total:.1f}"),
        PAPER_MILLISECONDS,
    )
    return Table("Time for one picture, milliseconds", ("", "decoding the strands", "rendering", "total"), rows)


def _views_gallery(result: Evaluation) -> Gallery:
    pictures: list[tuple[str, bytes]] = []
    for view in (each.view for each in result.clean[:MOST_VIEWS]):
        pictures += [
            (f"rendering of {view.name}", encode_png(view.rendered)),
            ("photograph", encode_png(view.photograph)),
            ("their difference, four times as strong", encode_png(difference_picture(view.rendered, view.photograph))),
        ]
    return Gallery("Held-out views" if result.held_out else "Training views", tuple(pictures))


def _alpha_gallery(run: RunContents, result: Evaluation) -> Gallery:
    view = result.views[0].view
    pictures: list[tuple[str, bytes]] = []
    if view.alpha is not None:
        pictures.append(("opacity of the rendered hair", encode_png(view.alpha[..., None].expand(-1, -1, 3))))
    mask = view.mask
    if mask is not None:
        height, width = mask.shape
        config = read_description(run.folder).config.trimap
        trimap = reference_alpha(mask, Rectangle(0, 0, width, height), config)
        shades = torch.where(trimap.supervised, trimap.alpha, 0.5)
        pictures.append(
            (
                "opacity that the fit asked for; it left the grey band open",
                encode_png(shades[..., None].expand(-1, -1, 3)),
            )
        )
    return Gallery("Opacity", tuple(pictures))


def _geometry_gallery(run: RunContents) -> Gallery:
    points = run.renderer.strands.points
    camera = run.capture.cameras[run.shown[0]].to(points.device)
    head = run.head.mesh
    sets = [("line segments", run.segments.lines()), ("fitted strands", points)]
    if run.capture.ground_truth is not None:
        sets.insert(0, ("true strands", run.capture.ground_truth.points.to(head.vertices)))
    images = [(name, lines_picture(lines, camera, head)) for name, lines in sets]
    photograph = run.capture.image(run.shown[0]).to(head.vertices)
    images.append(("fitted strands over the photograph", lines_over_photograph(photograph, points, camera, head)))
    pictures = tuple((name, encode_png(image)) for name, image in images)
    return Gallery("Geometry, coloured by direction", pictures, columns=len(pictures))


def _turntable(run: RunContents) -> tuple[Turntable, Gallery]:
    """A turn around the hair, rendered and as strands coloured by direction, and some still frames."""
    points = run.renderer.strands.points
    shown = run.capture.cameras[run.shown[0]]
    side = min(TURN_SIDE, shown.width, shown.height)
    cameras = turntable_cameras(points, TURN_FRAMES, (side, side))
    rendered = [run.renderer.render(camera).rgb.clamp(0, 1).cpu() for camera in cameras]
    drawn = [lines_picture(points, camera, run.head.mesh).cpu() for camera in cameras]
    strips = tuple(
        (caption, encode_webp(torch.cat([_shrunk(frame) for frame in frames])))
        for caption, frames in (("rendered", rendered), ("strands, coloured by direction", drawn))
    )
    chosen = range(0, TURN_FRAMES, STILL_EVERY)
    stills = tuple((f"{360 * k // TURN_FRAMES}°", encode_png(rendered[k])) for k in chosen)
    return Turntable("Turntable", strips, TURN_FRAMES), Gallery("Still pictures of the turntable", stills, columns=4)


def _shrunk(frame: Float[Tensor, "side side 3"]) -> Float[Tensor, "small small 3"]:
    """Reduce a frame to the size of the moving picture."""
    small = min(STRIP_SIDE, len(frame))
    planes = torch.nn.functional.interpolate(frame.permute(2, 0, 1)[None], (small, small), mode="area")
    return planes[0].permute(1, 2, 0)
