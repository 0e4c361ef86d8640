"""Makes a capture from photographs, in stages that are stored on disk and skipped if their inputs are unchanged.

photographs   upright pictures in sRGB
person        masks of the person (only if the person turns)
matches       features and their matches (not with given cameras)
model         COLMAP's model (not with given cameras)
cameras       undistorted pictures and their cameras
face          faces in each picture, and masks of the person
template      the template's landmarks
motion        how head and torso moved between the photographs (not with given cameras)
head          scale, frame, and the head in them, fitted to landmarks and outlines
masks         hair
skull         the head, raised to the hair if it lies too low, with shoulders where photographs agree
"""

import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neural_strands.capture.colmap import read_colmap
from neural_strands.capture.writer import HAIR_MASKS, PERSON_MASKS
from neural_strands.foundation.files import remove_leftovers, sole_writer, write_json
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.calibration import (
    Calibration,
    Originals,
    PosedLens,
    SparsePoints,
    calibrate,
)
from neural_strands.preparation.cameras.exposures import noticeable_exposures
from neural_strands.preparation.cameras.given import by_name, read_upright_cameras
from neural_strands.preparation.cameras.register import match_photographs, register
from neural_strands.preparation.face.files import read_faces, read_marks, write_faces
from neural_strands.preparation.follow_person import PERSON_SURE, PersonMotion, follow_person
from neural_strands.preparation.head.builtin import STORED, builtin_template
from neural_strands.preparation.head.fit import FittedHead, fit_head
from neural_strands.preparation.head.place import cameras_in_world
from neural_strands.preparation.head.refinement.refine import refine
from neural_strands.preparation.head.template import Template, find_landmarks, load_template
from neural_strands.preparation.mask_edits import ChosenMasks, MaskEdits
from neural_strands.preparation.masks.hair import find_hair, vote_on
from neural_strands.preparation.masks.segmenter import (
    GivenMasks,
    call_segmenter,
    check_command,
    run_segmenter,
)
from neural_strands.preparation.masks.views import masked_views
from neural_strands.preparation.masks.votes import VOTES, read_votes, write_votes
from neural_strands.preparation.masks.zones import ZonedHead
from neural_strands.preparation.photographs.folder import (
    Photograph,
    import_photographs,
    read_list,
    read_mask,
    read_picture,
    unread_pictures,
    write_picture,
)
from neural_strands.preparation.photographs.video import import_video
from neural_strands.preparation.request import STAGES, PrepareRequest, check_out
from neural_strands.preparation.source import Source, find_source, has_unused_cameras
from neural_strands.preparation.stage import Stage, digest_files, run_stage
from neural_strands.preparation.write_capture import CaptureFiles, person_scalp

PERSON = "person"
VERSIONS = {"photographs": 3, "model": 2, "template": 3, "motion": 2, "head": 4, "masks": 4, "skull": 6}
"""Versions of stages whose work has changed; results of earlier versions are computed again."""


def prepare(request: PrepareRequest, say: Callable[[str], None]) -> dict[str, Any]:
    """Make a capture from photographs; results of earlier runs are reused if they are still valid.

    Args:
        request: inputs and settings.
        say: receives messages for the user.

    Returns:
        The figures that `preparation.json` contains.

    Raises:
        InputError: an input is missing or wrong, or the photographs do not allow a stage.
    """
    source = find_source(request.photographs, request.cameras)
    check_out(request, source)
    if request.photographs.is_dir() and (unread := unread_pictures(request.photographs)):
        say(f"Left out, because such files are not read: {unread}; export them as JPEG or PNG.")
    request.head.check()
    if request.subject_turns:
        request.head.detector.check()
    if isinstance(request.segmenter, str):
        check_command(request.segmenter)
    if has_unused_cameras(source):
        say(f"Cameras are estimated; to use the ones in {request.photographs}, pass --cameras {request.photographs}.")
    with sole_writer(request.out / STAGES):
        remove_leftovers(request.out)
        return _all_stages(request, source, say)


def _all_stages(request: PrepareRequest, source: Source, say: Callable[[str], None]) -> dict[str, Any]:
    """Run all stages; `prepare` has checked that the folder may be used."""
    run = _Run(request, source, say)
    photographs = run.photographs()
    cameras, lenses, model = run.cameras(photographs)
    calibration = Calibration.load(cameras.folder)
    given = None if request.masks is None else GivenMasks(request.masks, read_list(photographs.folder), lenses)
    face = run.face(cameras, calibration, Originals(read_list(photographs.folder), lenses))
    edits = MaskEdits.find(request.out, request.out / STAGES, calibration.pictures)
    if edits.sentence():
        say(edits.sentence())
    files = [face.folder / PERSON / picture.name for picture in calibration.pictures]
    people = [file if file.is_file() else None for file in files]
    template = run.template()
    if model is not None:
        cameras = run.motion(model, cameras, calibration, face, template, people)
        motion = PersonMotion.load(cameras.folder, len(calibration.cameras))
        calibration = calibration if motion is None else motion.followed(calibration)
    outlines = edits.chosen(PERSON_MASKS, people)
    head = run.head(cameras, calibration, face, template, outlines)
    fitted = FittedHead.load(head.folder)
    world = cameras_in_world(calibration.cameras, fitted.frame)
    masks = run.masks(calibration, face, head, fitted, world, outlines, given)
    hair = edits.chosen(HAIR_MASKS, [masks.file(picture.name) for picture in calibration.pictures])
    if hair.inputs:
        sized = ((file, (camera.width, camera.height)) for file, camera in zip(hair.present(), world, strict=True))
        zoned = ZonedHead.of(fitted.head, fitted.landmarks)
        vote = vote_on(world, zoned, (read_mask(file, size) for file, size in sized))
    else:
        vote = read_votes(masks.folder, len(fitted.head.mesh.vertices))
    scalp = person_scalp(fitted.head, vote)
    if request.head.bend:
        fitted = FittedHead.load(run.skull(calibration, head, masks, fitted, world, outlines, hair).folder)
    pictures = calibration.pictures
    files = CaptureFiles(world, pictures, hair.present(), outlines.present(), edits, fitted.head, scalp)
    files.write(request.out)
    figures = {
        "photographs": len(read_list(photographs.folder)),
        "cameras": len(world),
        **fitted.figures,
        "scalp_faces": len(scalp),
        "template_scalp_faces": len(fitted.head.scalp_faces),
    }
    write_json(request.out / "preparation.json", figures)
    return figures


class _Run:
    """The stages of one request."""

    def __init__(self, request: PrepareRequest, source: Source, say: Callable[[str], None]) -> None:
        self.request = request
        self.source = source
        self.say = say
        self.root = request.out / STAGES

    def _stage(self, name: str, inputs: dict[str, Any], work: Callable[[Path], None]) -> Stage:
        version = {"version": VERSIONS[name]} if name in VERSIONS else {}
        stage, worked = run_stage(self.root / name, inputs | version, work)
        if not worked:
            self.say(f"{name}: already done.")
        return stage

    def photographs(self) -> Stage:
        files, longest_side = self.source.files, self.request.longest_side
        inputs = {"files": digest_files(files), "longest_side": longest_side}
        if self.source.is_video:
            inputs["frames"] = self.request.frames

        def work(out: Path) -> None:
            if self.source.is_video:
                import_video(files[0], out, self.request.frames, longest_side, self.say)
            else:
                self.say(f"{len(import_photographs(files, out, longest_side, self.say))} photographs read.")

        return self._stage("photographs", inputs, work)

    def cameras(self, photographs: Stage) -> tuple[Stage, dict[str, PosedLens], Stage | None]:
        """Undistorted pictures with cameras, estimated or given; their lenses; and COLMAP's model, if estimated."""
        listed = read_list(photographs.folder)
        given, exposures, model = self.source.cameras, None, None
        if given is not None:
            lenses = read_upright_cameras(given, listed, self.source.files)
            poses = {name: [*lens.lens.intrinsics, *lens.world_to_camera.ravel()] for name, lens in lenses.items()}
            inputs = {"photographs": photographs.digest, "given": poses}
            points = SparsePoints.none()
        else:
            person = self._person(photographs, listed) if self.request.subject_turns else None
            self.say("Estimating cameras; this takes some minutes.")
            matches = self._stage(
                "matches",
                {"photographs": photographs.digest} | ({} if person is None else {"person": person.digest}),
                lambda out: match_photographs(
                    photographs.folder, listed, out, None if person is None else person.folder
                ),
            )

            def work(out: Path) -> None:
                found = register(photographs.folder, listed, matches.folder, out, self.say)
                found.save(out)

            model = self._stage("model", {"matches": matches.digest}, work)
            found = by_name(read_colmap(photographs.folder, model.folder), model.folder)
            lenses = {shot.source: found[shot.name] for shot in listed if shot.name in found}
            points = SparsePoints.load(model.folder)
            # If the person turns, the lights do not turn with them: colours change without the exposure.
            kept = self.request.keep_exposure or self.request.subject_turns
            exposures = None if kept else noticeable_exposures(model.folder)
            inputs = {"photographs": photographs.digest, "model": model.digest, "equalised": exposures is not None}

        def undistort(out: Path) -> None:
            calibrate(photographs.folder, listed, lenses, points, out, self.say, exposures)

        return self._stage("cameras", inputs, undistort), lenses, model

    def _person(self, photographs: Stage, listed: Sequence[Photograph]) -> Stage:
        """Masks of the person in the photographs themselves, before cameras are known, named as COLMAP expects."""
        detector = self.request.head.detector

        def work(out: Path) -> None:
            pictures = [photographs.folder / photograph.name for photograph in listed]
            detector.detect(pictures, out, "finding the person")
            for picture in pictures:
                found = read_picture(out / picture.name)[..., 0]
                write_picture(out / f"{picture.name}.png", np.where(found > PERSON_SURE, 255, 0).astype(np.uint8))
                (out / picture.name).unlink()

        return self._stage("person", {"photographs": photographs.digest, "detector": detector.digests()}, work)

    def face(self, cameras: Stage, calibration: Calibration, originals: Originals) -> Stage:
        """Landmarks of each view, and masks of the person if there is a detector to make them."""
        names = [picture.name for picture in calibration.pictures]
        marks, detector = self.request.head.landmarks, self.request.head.detector
        inputs = {"cameras": cameras.digest, "detector": detector.digests()}
        if marks is not None:
            inputs["landmarks"] = digest_files([marks])
            inputs |= {} if detector.python is None else {"outlines": True}

        def work(out: Path) -> None:
            (out / PERSON).mkdir()
            faces = [] if marks is None else read_marks(marks, names, originals.to_picture)
            if marks is None or detector.python is not None:
                detected = detector.detect(calibration.pictures, out / PERSON)
                self.say(f"Faces in {sum(bool(found) for found in detected)} of {len(detected)} photographs.")
                faces = faces or detected
            write_faces(out, names, faces)

        return self._stage("face", inputs, work)

    def motion(
        self,
        model: Stage,
        cameras: Stage,
        calibration: Calibration,
        face: Stage,
        template: Stage,
        people: Sequence[Path | None],
    ) -> Stage:
        """How the person moved, which may be unknown; takes the place of the stage of the cameras."""
        stages = {"model": model, "cameras": cameras, "face": face, "template": template}

        def work(out: Path) -> None:
            faces = read_faces(face.folder, [picture.name for picture in calibration.pictures])
            loaded = Template.load(template.folder)
            found = follow_person(model.folder, calibration, faces, people, loaded, self.say)
            if found is not None:
                found.save(out)

        return self._stage("motion", {name: stage.digest for name, stage in stages.items()}, work)

    def head(
        self, cameras: Stage, calibration: Calibration, face: Stage, template: Stage, outlines: ChosenMasks
    ) -> Stage:
        """The template placed on the person."""
        asked = self.request.head
        inputs = {
            "cameras": cameras.digest,
            "face": face.digest,
            "template": template.digest,
            "scale": asked.size.metres_per_unit,
            "pupil_distance": asked.size.pupil_distance,
            "bend": asked.bend,
        }
        if asked.bend:
            inputs |= outlines.inputs

        def work(out: Path) -> None:
            faces = read_faces(face.folder, [picture.name for picture in calibration.pictures])
            loaded = Template.load(template.folder)
            people = outlines.files if asked.bend else None
            fit_head(calibration, faces, loaded, asked.size, people, self.say).save(out)

        return self._stage("head", inputs, work)

    def template(self) -> Stage:
        """A head with landmarks: the built-in one, or the user's."""
        asked = self.request.head
        path, scalp = asked.template, asked.scalp
        if path is None:
            return self._stage("template", {"builtin": digest_files([STORED])}, builtin_template().save)
        inputs = {
            "mesh": digest_files([path]),
            "scalp": None if scalp is None else digest_files([scalp]),
            "detector": asked.detector.digests(),
        }

        def work(out: Path) -> None:
            find_landmarks(load_template(path, scalp), asked.detector, out, str(path)).save(out)

        return self._stage("template", inputs, work)

    def masks(
        self,
        calibration: Calibration,
        face: Stage,
        head: Stage,
        fitted: FittedHead,
        cameras: Sequence[Camera],
        outlines: ChosenMasks,
        given: GivenMasks | None,
    ) -> Stage:
        """Masks of the hair: given, made by the user's program, or computed."""
        segmenter = self.request.segmenter

        def work(out: Path) -> None:
            zoned = ZonedHead.of(fitted.head, fitted.landmarks)
            vote = None
            if given is not None:
                masks = (given.read(picture.name) for picture in calibration.pictures)
            elif callable(segmenter):
                masks = call_segmenter(segmenter, calibration.pictures)
            elif segmenter is not None:
                masks = run_segmenter(segmenter, calibration.pictures, out)
            else:
                found = find_hair(cameras, calibration.pictures, zoned, outlines.files)
                masks, vote = found.coverage, found.vote
            files = [out / picture.name for picture in calibration.pictures]
            for file, coverage in zip(files, masks, strict=True):
                write_picture(file, coverage)
            if vote is None:
                vote = vote_on(cameras, zoned, (read_picture(file)[..., 0] for file in files))
            write_votes(out, vote)

        program = uuid.uuid4().hex if callable(segmenter) else segmenter
        inputs = {"face": face.digest, "head": head.digest, "segmenter": program, "votes": VOTES}
        if given is not None:
            inputs["given"] = given.digest()
        elif segmenter is None:
            inputs |= outlines.inputs
        return self._stage("masks", inputs, work)

    def skull(
        self,
        calibration: Calibration,
        head: Stage,
        masks: Stage,
        fitted: FittedHead,
        cameras: Sequence[Camera],
        outlines: ChosenMasks,
        hair: ChosenMasks,
    ) -> Stage:
        """The head with skull and shoulders as pictures and masks show them: those of the stages, or the user's."""
        inputs = {"head": head.digest, "masks": masks.digest} | hair.inputs

        def work(out: Path) -> None:
            views = masked_views(cameras, calibration.pictures, hair.present(), outlines.files)
            refine(fitted, Template.load(self.root / "template"), views, self.say).save(out)

        return self._stage("skull", inputs, work)
