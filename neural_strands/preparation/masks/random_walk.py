"""Segmentation by a random walker: evidence at each pixel spreads over smooth parts and stops at edges.

After L. Grady, *Multilabel Random Walker Image Segmentation Using Prior Models* (2005). The result minimises
sum of w_ij (x_i - x_j)^2 + strength * (p_i (x_i - 1)^2 + (1 - p_i) x_i^2): a sparse, convex system, solved by conjugate
gradients.
"""

import numpy as np

CONTRAST = 30.0
"""Sensitivity to edges: a link has weight exp(-CONTRAST * squared difference of colour), with colours in [0, 1]."""
LEAST_LINK = 1e-3
STEPS = 200
TOLERANCE = 1e-4
"""Relative residual at which conjugate gradients stop."""


def random_walk(picture: np.ndarray, evidence: np.ndarray, strength: float) -> np.ndarray:
    """Smooth evidence in [0, 1] along a picture.

    Args:
        picture: (height, width, 3) 8-bit RGB.
        evidence: (height, width) probability at each pixel alone.
        strength: weight of the evidence relative to a link; smaller values smooth over longer distances.

    Returns:
        Smoothed probabilities (height, width).
    """
    colour = picture.astype(np.float32) / 255.0
    across, down = _links(colour[:, 1:] - colour[:, :-1]), _links(colour[1:] - colour[:-1])
    degree = np.full(evidence.shape, strength, dtype=np.float32)
    degree[:, 1:] += across
    degree[:, :-1] += across
    degree[1:] += down
    degree[:-1] += down

    def apply(x: np.ndarray) -> np.ndarray:
        result = degree * x
        result[:, 1:] -= across * x[:, :-1]
        result[:, :-1] -= across * x[:, 1:]
        result[1:] -= down * x[:-1]
        result[:-1] -= down * x[1:]
        return result

    right = strength * evidence.astype(np.float32)
    x = evidence.astype(np.float32).copy()
    residual = right - apply(x)
    direction = residual / degree
    product = float((residual * direction).sum())
    goal = TOLERANCE * float(np.linalg.norm(right)) + 1e-12
    for _ in range(STEPS):
        if float(np.linalg.norm(residual)) <= goal:
            break
        image = apply(direction)
        step = product / float((direction * image).sum())
        x += step * direction
        residual -= step * image
        scaled = residual / degree
        previous, product = product, float((residual * scaled).sum())
        direction = scaled + (product / previous) * direction
    return np.clip(x, 0.0, 1.0)


def _links(difference: np.ndarray) -> np.ndarray:
    """Weights of links between neighbours from their difference in colour."""
    return np.exp(-CONTRAST * (difference**2).sum(axis=-1)).clip(min=LEAST_LINK)
