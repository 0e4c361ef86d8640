"""Every reader of files that may come from strangers, each with a valid file that the project's own writers made."""

import gzip
import json
import pickle
import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch
import trimesh
from fuzzed_photographs import import_one, read_video, write_photographs
from fuzzed_pictures import write_colmap, write_pictures
from fuzzed_reader import FuzzedReader
from torch import Tensor
from workspace import write_workspace

from neural_strands.batch.records import StageRecord, read_records, write_record, write_subject
from neural_strands.batch.storage import Store
from neural_strands.batch.subjects import Subject, read_subjects
from neural_strands.capture.capture import Capture
from neural_strands.capture.colmap import (
    read_cameras_binary,
    read_cameras_text,
    read_colmap,
    read_images_binary,
    read_images_text,
)
from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.capture.images import read_pixels
from neural_strands.capture.writer import HAIR_MASKS, PERSON_MASKS
from neural_strands.editing.edit_list import read_edits, write_edits
from neural_strands.editing.settings import Density, Haircut
from neural_strands.evaluation.rendered_files import read_rendering
from neural_strands.evaluation.score_files import read_oriented_points
from neural_strands.fitting.config import FitConfig, read_fit_config
from neural_strands.geometry.cameras import Camera, TorsoMotion
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.grooms.tfx_text import write_tfx_text
from neural_strands.lmvs.files import load_segments, load_segments_source
from neural_strands.lmvs.strokes import read_strokes
from neural_strands.model.files import load_hair_model
from neural_strands.model.networks import SHIPPED as SHIPPED_NETWORKS
from neural_strands.model.networks import read_networks
from neural_strands.preparation.cameras.calibration import Calibration, SparsePoints
from neural_strands.preparation.cameras.exposures import EXPOSURES, noticeable_exposures, write_exposures
from neural_strands.preparation.cameras.metashape import read_metashape
from neural_strands.preparation.cameras.motion import Motion
from neural_strands.preparation.cameras.reality_capture import COLUMNS, read_reality_capture
from neural_strands.preparation.face.files import read_faces, read_marks, write_faces
from neural_strands.preparation.follow_person import PersonMotion
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.flame import read_flame
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.mask_edits import RECORD as WRITTEN_MASKS
from neural_strands.preparation.mask_edits import MaskEdits
from neural_strands.preparation.masks.votes import VOTES, read_votes, write_votes
from neural_strands.preparation.photographs.folder import (
    Photograph,
    read_list,
    read_mask,
    read_picture,
    write_list,
    write_picture,
)
from neural_strands.preparation.photographs.hdr import hdr_transfer
from neural_strands.preparation.photographs.metadata import orientation_of
from neural_strands.preparation.stage import run_stage
from neural_strands.prior.vae import SHIPPED, load_prior
from neural_strands.runs.newest_model import load_newest_model, newest_state
from neural_strands.runs.run_folder import RunFolder, read_description
from neural_strands.runs.run_log import read_log
from neural_strands.scalp.fit_similarity import Similarity
from neural_strands.scalp.head import Head
from neural_strands.scalp.head_file import read_head_file
from neural_strands.scalp.load import load_head
from neural_strands.scalp.mesh_file import read_mesh_file

CPU = torch.device("cpu")
NAMES = ("000.png", "001.png")
BALL_VERTICES = 162
"""Of the meshes."""
STAGE_INPUTS = {"photographs": "2a" * 32, "longest_side": 2048, "scale": None}


def write_corpus(folder: Path) -> None:
    """Write a valid file for every reader."""
    write_workspace(folder)
    folder = folder.resolve()
    _write_grooms(folder / "grooms")
    _write_meshes(folder / "meshes")
    write_colmap(folder)
    write_pictures(folder / "pictures")
    write_photographs(folder / "photographs")
    _write_preparation(folder / "preparation")
    _write_settings(folder / "settings")
    shutil.copyfile(SHIPPED, folder / "prior.safetensors")
    shutil.copyfile(SHIPPED_NETWORKS / "networks_16_32_32.safetensors", folder / "networks.safetensors")


def _write_grooms(folder: Path) -> None:
    generator = torch.Generator().manual_seed(0)
    counts = torch.tensor([6] * 5)
    width = 1e-4 * (1 + torch.rand(5, generator=generator))
    groom = Groom(
        vertices=0.1 * torch.randn(30, 3, generator=generator),
        offsets=torch.arange(0, 31, 6),
        root_uv=torch.rand(5, 2, generator=generator),
        root_normal=torch.nn.functional.normalize(torch.randn(5, 3, generator=generator), dim=1),
        width=width.repeat_interleave(counts),
        color=torch.rand(5, 3, generator=generator),
        unseen=torch.rand(5, generator=generator),
        t=torch.linspace(0, 1, 6).repeat(5),
    )
    folder.mkdir()
    for suffix in ("hair", "data", "tfx", "ply", "obj", "npz", "usda", "usdc"):
        write_groom(folder / f"groom.{suffix}", groom)
    write_tfx_text(folder / "text.tfx", groom)


def _write_meshes(folder: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.09)
    scalp = np.nonzero(ball.triangles_center[:, 1] > 0.02)[0].tolist()
    for suffix in ("obj", "ply", "stl", "glb"):
        (folder / suffix).mkdir(parents=True)
        ball.export(folder / suffix / f"head.{suffix}")
    (folder / "obj" / "list.json").write_text(json.dumps(scalp))
    chart = {
        str(face): {
            str(3 * face + corner): (0.5 + 4 * ball.vertices[v, ::2]).tolist()
            for corner, v in enumerate(ball.faces[face])
        }
        for face in scalp
    }
    (folder / "obj" / "chart.json.gz").write_bytes(gzip.compress(json.dumps(chart).encode()))
    cv2.imwrite(str(folder / "obj" / "painted.png"), np.full((16, 16), 255, np.uint8))
    (folder / "obj" / "textured.obj").write_text(
        "".join(f"v {x} {y} {z}\nvt {x + 0.5} {y + 0.5}\n" for x, y, z in ball.vertices.tolist())
        + "".join("f {0}/{0} {1}/{1} {2}/{2}\n".format(*face) for face in (ball.faces + 1).tolist())
    )


def _write_preparation(folder: Path) -> None:
    for name in ("photographs", "model", "face", "head", "template"):
        (folder / name).mkdir(parents=True)
    write_picture(folder / "photographs" / "000.png", np.full((24, 32, 3), 90, np.uint8))
    write_list(folder / "photographs", [Photograph(name, f"{name}.jpg", 32, 24, 30.0, "A camera") for name in NAMES])
    marks = np.full((478, 2), np.nan)
    marks[:40] = np.arange(80).reshape(40, 2) / 7
    write_faces(folder / "face", NAMES, [[marks], []])
    write_exposures(folder / "model", NAMES, np.array([[0.0, 0.0, 0.0], [0.25, -0.5, 1.0]]))
    (folder / "marks.json").write_text(json.dumps({"000": {"1": [3.5, 4], "right_iris": [1, 2]}}))
    ball = read_head_file(folder.parent / "meshes" / "obj" / "head.obj", folder.parent / "meshes" / "obj" / "list.json")
    scalp = ball.scalp.faces
    head = Head(ball.mesh, scalp, torch.rand(len(scalp), 3, 2, generator=torch.Generator().manual_seed(1)))
    Template(head, torch.zeros(478, 3), torch.zeros(478)).save(folder / "template")
    frame = Similarity(0.4, torch.eye(3).double(), torch.zeros(3).double())
    FittedHead(head, torch.zeros(478, 3), frame, {"views_with_face": 3}).save(folder / "head")
    still = np.zeros((3, 3))
    torso = TorsoMotion(torch.eye(4), torch.eye(3)[:2])
    PersonMotion(Motion(still, still, still, still[0]), still.astype(np.uint8), (torso,) * 3).save(folder / "head")
    write_votes(folder / "head", np.linspace(0, 1, len(ball.mesh.vertices)))
    run_stage(folder / "stage", STAGE_INPUTS, lambda _: None)
    write_masks(folder)
    SparsePoints(np.ones((9, 3)), np.ones((9, 3), np.uint8)).save(folder.parent / "capture")
    (folder / "cameras.xml").write_text(METASHAPE)
    row = {"#name": "a.jpg", "x": "1", "y": "2", "alt": "3", "heading": "90", "pitch": "2", "roll": "1", "f": "42"}
    rows = (COLUMNS, (row.get(column, "0") for column in COLUMNS))
    (folder / "cameras.csv").write_text("".join(",".join(each) + "\n" for each in rows))
    flame = {"v_template": ball.mesh.vertices.double().numpy(), "f": ball.mesh.faces.numpy(), "bs_style": "lbs"}
    (folder / "flame.pkl").write_bytes(pickle.dumps(flame, protocol=2))


def write_masks(folder: Path) -> None:
    """Write masks into `folder/prepared` twice, as with two segmenters, and edit one; `folder` gets the record."""
    capture, made = folder / "prepared", folder / "made"
    for kind in (HAIR_MASKS, PERSON_MASKS):
        (made / kind).mkdir(parents=True)
    for grey in (90, 120):
        masks = {kind: [made / kind / name for name in NAMES] for kind in (HAIR_MASKS, PERSON_MASKS)}
        for file in (file for files in masks.values() for file in files):
            write_picture(file, np.full((6, 8), grey, np.uint8))
        MaskEdits.find(capture, folder, [made / HAIR_MASKS / name for name in NAMES]).write(masks)
    write_picture(capture / HAIR_MASKS / NAMES[0], np.zeros((6, 8), np.uint8))


METASHAPE = """<?xml version="1.0"?><document version="1.5.0"><chunk label="Chunk 1">
<sensors><sensor id="0" label="unknown" type="frame"><resolution width="600" height="400"/>
<calibration type="frame" class="adjusted"><resolution width="600" height="400"/><f>700</f><cx>3</cx><cy>-5</cy>
<k1>0.05</k1><k2>-0.02</k2><k3>0.01</k3><p1>0.002</p1><p2>-0.001</p2><b1>4</b1></calibration></sensor></sensors>
<cameras><camera id="0" sensor_id="0" label="A"><transform>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</transform></camera>
<camera id="1" sensor_id="0" label="B"/></cameras></chunk></document>"""


SUBJECTS = """[defaults]
preset = "demo"
config.weights.alpha = 0.3
[resources.fit]
cores = 4
gpu = 0.5
[subjects.bob]
photographs = "photos/bob"
prepare = {pupil_distance = 63, landmarks = "bob.json"}
[subjects.eve]
capture = "s3://heads/eve"
"""


def _write_settings(folder: Path) -> None:
    folder.mkdir()
    write_edits(folder / "edits.json", [Haircut(plane=(0.0, 1.0, 0.0, 0.0, 1.0, 0.0), seed=4), Density(50)])
    (folder / "fit.json").write_text(json.dumps(asdict(FitConfig())))
    (folder / "fit.toml").write_text("steps = 20\nseed = 3\n[model.unet]\nwidths = [8, 16]\n[weights]\nrender = 0.5\n")
    strokes = [{"points": [[0, 0, 0], [0, 0.1, 0]]}, {"view": "000.png", "points": [[3, 4], [5, 6.5]]}]
    (folder / "subjects.toml").write_text(SUBJECTS)
    store, subject = Store(str(folder)), Subject("eve", "ball", prepared=True)
    write_subject(store, subject)
    write_record(store, StageRecord("lmvs", 3.5, 10**9, "node", {"points": 7.0}))
    (folder / "strokes.json").write_text(json.dumps(strokes))


def _groom(path: Path) -> object:
    groom = read_groom(path)
    assert len(groom) > 0
    return _finite(groom, groom.vertices)


def _scalp(mesh: str, path: Path) -> object:
    head = load_head(path.parent / mesh, path)
    return _finite(head, head.scalp_uv)


def _mesh(path: Path) -> object:
    found = read_mesh_file(path)
    assert int(found.mesh.faces.max()) < len(found.mesh.vertices)
    return _finite(found, found.mesh.vertices)


def _segments(path: Path) -> object:
    segments = load_segments(path)
    load_segments_source(path)
    return _finite(segments, segments.points)


def _capture(path: Path) -> object:
    capture = Capture.load(path.parent)
    return [_finite(camera, camera.world_to_camera, camera.intrinsics) for camera in capture.cameras]


def _colmap(path: Path) -> object:
    return [_finite(view, view.camera.world_to_camera) for view in read_colmap(path.parent, path.parent)]


def _run(path: Path) -> object:
    folder = RunFolder(path.parent)
    state = newest_state(folder)
    if state is None:
        return read_description(folder)
    model = load_newest_model(folder, state, CPU)
    return _finite(model, *model.state_dict().values())


def _model(path: Path) -> object:
    model = load_hair_model(path.parent)
    return _finite(model, *model.state_dict().values())


def _fitted(path: Path) -> object:
    fitted = FittedHead.load(path.parent)
    return _finite({**fitted.figures}, fitted.head.mesh.vertices)


def _records(path: Path) -> object:
    folder = next(parent for parent in path.parents if (parent / "subject.json").is_file())
    return read_records(Store(str(folder)), Subject("eve", "ball", prepared=True))


def _written_masks(path: Path) -> object:
    capture = path.parent / "prepared"
    found = MaskEdits.find(capture, path.parent, [path.parent / "made" / HAIR_MASKS / name for name in NAMES])
    # These files are removed where the masks no longer fit.
    assert all((capture / name).resolve().is_relative_to(capture.resolve()) for name in found.record)
    return found


def _stage_record(path: Path) -> object:
    return run_stage(path.parent, STAGE_INPUTS, lambda _: None)


def _strokes(path: Path) -> object:
    return read_strokes(path, (Camera(torch.eye(3), torch.eye(4), 64, 64, "000.png"),))


def _finite(whole: object, *tensors: Tensor) -> object:
    """The object, once all of its tensors have been seen to be finite."""
    assert all(bool(tensor.isfinite().all()) for tensor in tensors)
    return whole


READERS = (
    *(
        FuzzedReader(f"groom {name}", f"grooms/{name}", _groom, is_slow=".usd" in name)
        for name in (
            *("groom.hair", "groom.data", "groom.tfx", "text.tfx", "groom.ply", "groom.obj", "groom.npz"),
            *("groom.usda", "groom.usdc"),
        )
    ),
    *(
        FuzzedReader(f"mesh .{suffix}", f"meshes/{suffix}/head.{suffix}", _mesh)
        for suffix in ("obj", "ply", "stl", "glb")
    ),
    FuzzedReader("mesh .obj with uv", "meshes/obj/textured.obj", _mesh),
    FuzzedReader("scalp list", "meshes/obj/list.json", partial(_scalp, "head.obj"), is_slow=True),
    FuzzedReader("scalp chart", "meshes/obj/chart.json.gz", partial(_scalp, "head.obj"), is_slow=True),
    FuzzedReader("scalp painted", "meshes/obj/painted.png", partial(_scalp, "textured.obj"), is_slow=True),
    FuzzedReader("COLMAP cameras.txt", "colmap_text/cameras.txt", read_cameras_text),
    FuzzedReader("COLMAP images.txt", "colmap_text/images.txt", read_images_text),
    FuzzedReader("COLMAP cameras.bin", "colmap_binary/cameras.bin", read_cameras_binary),
    FuzzedReader("COLMAP images.bin", "colmap_binary/images.bin", read_images_binary),
    FuzzedReader("COLMAP text", "colmap_text/images.txt", _colmap),
    FuzzedReader("COLMAP binary", "colmap_binary/cameras.bin", _colmap),
    FuzzedReader("transforms.json", "capture/transforms.json", _capture, is_slow=True),
    FuzzedReader("ground truth", "capture/ground_truth.npz", read_ground_truth),
    *(
        FuzzedReader(f"picture {name}", f"pictures/{name}", read_pixels)
        for name in ("a.png", "a.jpg", "a.webp", "a.tif", "a.bmp", "deep.png")
    ),
    FuzzedReader("rendering", "pictures/alpha.png", read_rendering),
    FuzzedReader("mask", "pictures/mask.png", lambda path: read_mask(path, (32, 24))),
    *(FuzzedReader(f"photograph {name}", f"photographs/{name}", import_one) for name in ("a.jpg", "a.heic", "a.tif")),
    *(FuzzedReader(f"EXIF of {name}", f"photographs/{name}", orientation_of) for name in ("a.jpg", "a.tif")),
    FuzzedReader("video", "photographs/a.mp4", read_video),
    FuzzedReader("colours of a video", "photographs/hlg.mp4", hdr_transfer),
    FuzzedReader("segments", "segments.npz", _segments),
    FuzzedReader("points to score", "grooms/groom.ply", read_oriented_points),
    FuzzedReader("strokes", "settings/strokes.json", _strokes),
    FuzzedReader("run.json", "run/run.json", lambda path: read_description(RunFolder(path.parent))),
    FuzzedReader("run's log", "run/log.jsonl", read_log),
    FuzzedReader("checkpoint", "run/checkpoint.pt", _run, is_slow=True),
    FuzzedReader("model's config", "run/model/config.json", _model, is_slow=True),
    FuzzedReader("model's weights", "run/model/model.safetensors", _model, is_slow=True),
    FuzzedReader("prior", "prior.safetensors", load_prior, is_slow=True),
    FuzzedReader("networks", "networks.safetensors", lambda path: read_networks(path, FitConfig().model), is_slow=True),
    FuzzedReader("edits", "settings/edits.json", read_edits),
    FuzzedReader("settings .json", "settings/fit.json", lambda path: read_fit_config(path, FitConfig())),
    FuzzedReader("settings .toml", "settings/fit.toml", lambda path: read_fit_config(path, FitConfig())),
    FuzzedReader("subjects", "settings/subjects.toml", read_subjects),
    FuzzedReader("subject's settings", "settings/subject.json", _records),
    FuzzedReader("subject's record", "settings/stages/lmvs.json", _records),
    FuzzedReader("Metashape", "preparation/cameras.xml", read_metashape),
    FuzzedReader(
        "RealityCapture", "preparation/cameras.csv", lambda path: read_reality_capture(path, {"a": (600, 400)})
    ),
    FuzzedReader("landmarks", "preparation/marks.json", lambda path: read_marks(path, NAMES, lambda _, at: at)),
    FuzzedReader("FLAME", "preparation/flame.pkl", read_flame),
    FuzzedReader("stage photographs", "preparation/photographs/photographs.json", lambda path: read_list(path.parent)),
    FuzzedReader("stage picture", "preparation/photographs/000.png", read_picture),
    FuzzedReader("stage cameras", "capture/points.npz", lambda path: Calibration.load(path.parent), is_slow=True),
    FuzzedReader("stage exposures", f"preparation/model/{EXPOSURES}", lambda path: noticeable_exposures(path.parent)),
    FuzzedReader("stage face", "preparation/face/faces.json", lambda path: read_faces(path.parent, NAMES)),
    FuzzedReader("stage template", "preparation/template/template.npz", lambda path: Template.load(path.parent)),
    FuzzedReader("stage head", "preparation/head/head.npz", _fitted),
    FuzzedReader("stage figures", "preparation/head/figures.json", _fitted),
    FuzzedReader("stage motion", "preparation/head/motion.npz", lambda path: PersonMotion.load(path.parent, 3)),
    FuzzedReader("stage torso", "preparation/head/torso.npz", lambda path: PersonMotion.load(path.parent, 3)),
    FuzzedReader("stage masks", f"preparation/head/{VOTES}", lambda path: read_votes(path.parent, BALL_VERTICES)),
    FuzzedReader("stage record", "preparation/stage/inputs.json", _stage_record),
    FuzzedReader("written masks", f"preparation/{WRITTEN_MASKS}", _written_masks),
)
"""Every reader."""
