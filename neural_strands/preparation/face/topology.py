"""MediaPipe's 478 face landmarks: those that are named here, and those that stay in one place on the skin.

Right and left are the person's own.
"""

LANDMARKS = 478
"""468 on the face, then five for each iris."""

NAMED = {
    "right_eye_outer": 33,
    "right_eye_inner": 133,
    "left_eye_inner": 362,
    "left_eye_outer": 263,
    "right_iris": 468,
    "left_iris": 473,
    "nose_bridge": 168,
    "nose_tip": 4,
    "nose_base": 2,
    "nose_right": 129,
    "nose_left": 358,
    "mouth_right": 61,
    "mouth_left": 291,
    "lip_upper": 0,
    "lip_lower": 17,
    "right_brow_outer": 70,
    "right_brow_inner": 55,
    "left_brow_inner": 285,
    "left_brow_outer": 300,
    "chin": 152,
    "right_cheek": 234,
    "left_cheek": 454,
}
"""Landmarks that can be set by hand, and their indices. The cheeks are where the face is widest, in front of the
ears."""

RIGHT_IRIS = (469, 470, 471, 472)
LEFT_IRIS = (474, 475, 476, 477)
"""Border of each iris in cyclic order, so that every second one is opposite."""

FACE_OVAL = (
    *(10, 338, 297, 332, 284, 251, 389, 356, 454, 323, 361, 288, 397, 365, 379, 378, 400, 377),
    *(152, 148, 176, 149, 150, 136, 172, 58, 132, 93, 234, 127, 162, 21, 54, 103, 67, 109),
)
"""Border of the face in cyclic order. In profile the detector places it on the silhouette, so it slips over the
skin."""

INNER_LIPS = (78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308, 324, 318, 402, 317, 14, 87, 178, 88, 95)
"""Inner border of the lips, which moves when they open."""

INTERIOR = tuple(sorted(set(range(468)) - set(FACE_OVAL) - set(INNER_LIPS)))
"""Landmarks that stay in one place on the skin."""
