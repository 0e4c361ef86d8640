"""A separate program, started by `detector.py`, that finds faces and people with MediaPipe.

It runs in any Python that has MediaPipe (whose requirements may conflict with this package's), so it imports nothing
from this package. It reads a JSON document from standard input,

    {"images": [path, ...], "masks": folder or null, "face_model": path or null, "person_model": path or null}

and answers with one JSON line per image, {"image": path, "faces": [[[x, y], ...], ...]}, coordinates in pixels, the
centre of the top-left pixel at (0.5, 0.5). Masks of the person are written as PNG under the images' names. With paths
of models, MediaPipe's Tasks interface is used; without, the models inside its wheels up to 0.10.21. Later wheels have
none: the only line is then {"lacking": ["face_model", ...]}. If nothing can be done, the first line is
{"error": sentence}.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

MOST_FACES = 4
CONFIDENCE = 0.3
"""Least detection confidence; low, because false faces are voted out later, across views."""


def main() -> int:
    """Answer the request; what libraries print to standard output is redirected to standard error."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    request = json.loads(sys.stdin.read())
    try:
        import cv2
        import mediapipe  # pyright: ignore[reportMissingImports]
        import numpy as np
    except ImportError as error:
        return _answer(answers, {"error": f"{sys.executable} lacks {error.name}"}, 1)
    needed = ["face_model", "person_model"] if request["masks"] else ["face_model"]
    lacking = [] if hasattr(mediapipe, "solutions") else [name for name in needed if request[name] is None]
    if lacking:
        return _answer(answers, {"lacking": lacking}, 0)
    try:
        find_faces = _face_finder(mediapipe, request["face_model"])
        find_person = _person_finder(mediapipe, np, request["person_model"]) if request["masks"] else None
    # MediaPipe raises RuntimeError, ValueError and others for a file that is not a model.
    except Exception as error:
        return _answer(answers, {"error": " ".join(str(error).split())[:300]}, 1)
    for path in request["images"]:
        pixels = cv2.imread(path, cv2.IMREAD_COLOR)
        if pixels is None:
            return _answer(answers, {"error": f"{path} does not decode"}, 1)
        pixels = np.ascontiguousarray(pixels[:, :, ::-1])
        height, width = pixels.shape[:2]
        faces = [[[x * width, y * height] for x, y in face] for face in find_faces(pixels)]
        if find_person is not None:
            coverage = np.clip(np.rint(find_person(pixels) * 255), 0, 255).astype(np.uint8)
            encoded = cv2.imencode(".png", coverage)[1]
            (Path(request["masks"]) / f"{Path(path).stem}.png").write_bytes(encoded.tobytes())
        _answer(answers, {"image": path, "faces": faces}, 0)
    return 0


def _answer(answers: Any, document: dict, status: int) -> int:
    answers.write(json.dumps(document) + "\n")
    answers.flush()
    return status


def _face_finder(mediapipe: Any, model: str | None) -> Callable[[Any], list]:
    if model is None:
        mesh = mediapipe.solutions.face_mesh.FaceMesh(
            static_image_mode=True,
            max_num_faces=MOST_FACES,
            refine_landmarks=True,
            min_detection_confidence=CONFIDENCE,
        )

        def find(pixels: Any) -> list:
            found = mesh.process(pixels).multi_face_landmarks or []
            return [[(point.x, point.y) for point in face.landmark] for face in found]

        return find
    vision = mediapipe.tasks.vision
    options = vision.FaceLandmarkerOptions(
        base_options=mediapipe.tasks.BaseOptions(model_asset_path=model),
        num_faces=MOST_FACES,
        min_face_detection_confidence=CONFIDENCE,
    )
    landmarker = vision.FaceLandmarker.create_from_options(options)

    def find_by_task(pixels: Any) -> list:
        image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=pixels)
        found = landmarker.detect(image).face_landmarks
        return [[(point.x, point.y) for point in face] for face in found]

    return find_by_task


def _person_finder(mediapipe: Any, np: Any, model: str | None) -> Callable[[Any], Any]:
    if model is not None:
        vision = mediapipe.tasks.vision
        options = vision.ImageSegmenterOptions(
            base_options=mediapipe.tasks.BaseOptions(model_asset_path=model),
            output_confidence_masks=True,
            output_category_mask=False,
        )
        segmenter = vision.ImageSegmenter.create_from_options(options)

        def find_by_task(pixels: Any) -> Any:
            image = mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=pixels)
            masks = [
                np.array(mask.numpy_view(), dtype=np.float32) for mask in segmenter.segment(image).confidence_masks
            ]
            # A single mask is that of the person; of several (hair, skin, clothes ...), the first is the background.
            coverage = masks[0] if len(masks) == 1 else 1.0 - masks[0]
            return coverage.reshape(pixels.shape[:2])

        return find_by_task
    selfie = mediapipe.solutions.selfie_segmentation.SelfieSegmentation(model_selection=0)
    return lambda pixels: np.asarray(selfie.process(pixels).segmentation_mask, dtype=np.float32)


if __name__ == "__main__":
    sys.exit(main())
