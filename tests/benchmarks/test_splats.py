"""Pictures of Gaussian splats: against a renderer of loops and differences, scipy's harmonics, and closed forms."""

import math

import numpy as np
import pytest
import scipy.special
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera, quaternion_to_matrix


@pytest.fixture(scope="module")
def splats(benchmark_module):
    return benchmark_module("rivals", "splats")


def some(splats, count, random, degree=3):
    """Splats of all shapes about the origin."""
    basis = (degree + 1) ** 2
    return splats.Splats(
        0.12 * torch.randn(count, 3, generator=random),
        0.002 + 0.03 * torch.rand(count, 3, generator=random) ** 2,
        torch.randn(count, 4, generator=random),
        0.05 + 0.95 * torch.rand(count, generator=random),
        0.4 * torch.randn(count, basis, 3, generator=random),
    )


def camera(width=19, height=17):
    eye, target = torch.tensor([0.15, 0.1, 1.0]), torch.zeros(3)
    made = Camera.look_at(eye, target, 90.0, (width, height))
    intrinsics = made.intrinsics.clone()
    intrinsics[0, 2] += 1.3
    return Camera(intrinsics, made.world_to_camera, width, height)


def naive(splats, scene, view):
    """One pixel and one splat after the other; the projection's derivative by differences."""
    position, step = view.position.double(), 1e-5
    exact = Camera(view.intrinsics.double(), view.world_to_camera.double(), view.width, view.height)
    order = sorted(range(len(scene)), key=lambda index: float(view.transform(scene.means[index])[2]))
    drawn = []
    for index in order:
        mean = scene.means[index].double()
        moved = [
            exact.project(mean + step * axis)[0] - exact.project(mean - step * axis)[0]
            for axis in torch.eye(3).double()
        ]
        derivative = torch.stack(moved, dim=1) / (2 * step)
        axes = quaternion_to_matrix(scene.quaternions[index].double()) @ torch.diag(scene.scales[index].double())
        covariance = derivative @ axes @ axes.T @ derivative.T + 0.3 * torch.eye(2)
        towards = torch.nn.functional.normalize(mean - position, dim=0)
        basis = splats.spherical_harmonics(towards[None], scene.harmonics.shape[1])[0]
        colour = (basis @ scene.harmonics[index].double() + 0.5).clamp(min=0)
        drawn.append((exact.project(mean)[0], covariance, float(scene.opacities[index]), colour))
    image, alpha = torch.zeros(view.height, view.width, 3), torch.zeros(view.height, view.width)
    for row in range(view.height):
        for column in range(view.width):
            light = 1.0
            for centre, covariance, opacity, colour in drawn:
                low = (centre - 0.5 - 3 * covariance.diagonal().sqrt()).floor() - 2
                high = (centre - 0.5 + 3 * covariance.diagonal().sqrt()).ceil() + 2
                if not (low[0] <= column < high[0] and low[1] <= row < high[1]):
                    continue
                away = centre - torch.tensor([column + 0.5, row + 0.5]).double()
                share = min(opacity * math.exp(-0.5 * float(away @ torch.linalg.solve(covariance, away))), 0.999)
                if share < 1 / 255:
                    continue
                if light * (1 - share) <= 1e-4:
                    break
                image[row, column] += light * share * colour.float()
                light *= 1 - share
            alpha[row, column] = 1 - light
    return image, alpha


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_pictures_are_those_of_plain_loops(splats, generator, degree):
    scene, view = some(splats, 30, generator, degree), camera()
    picture = splats.render_splats(scene, view)
    image, alpha = naive(splats, scene, view)
    assert alpha.max() > 0.9
    assert alpha.min() < 0.1
    torch.testing.assert_close(picture.colour, image, atol=2e-3, rtol=0)
    torch.testing.assert_close(picture.alpha, alpha, atol=2e-3, rtol=0)
    assert float((picture.colour - image).abs().mean()) < 2e-5


def test_a_round_splat_is_a_gaussian_of_its_size_and_colour(splats):
    """Depth 1 m, 100 px/m: a deviation of 20 mm is one of 2 px, and its variance grows from 4 to 4.3 square pixels."""
    view = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, (21, 21))
    grey = torch.full((1, 1, 3), (0.75 - 0.5) * math.sqrt(4 * math.pi))
    scene = splats.Splats(
        torch.zeros(1, 3), torch.full((1, 3), 0.02), torch.tensor([[1.0, 0, 0, 0]]), torch.tensor([0.8]), grey
    )
    picture = splats.render_splats(scene, view)
    for away in range(5):
        expected = 0.8 * math.exp(-0.5 * away**2 / 4.3)
        assert float(picture.alpha[10, 10 + away]) == pytest.approx(expected, abs=1e-5)
        assert float(picture.colour[10 + away, 10, 1]) == pytest.approx(0.75 * expected, abs=1e-5)


def test_what_is_behind_the_camera_is_not_drawn(splats, generator):
    scene = some(splats, 5, generator)
    behind = splats.Splats(
        scene.means + torch.tensor([0.0, 0.0, 3.0]),
        scene.scales,
        scene.quaternions,
        scene.opacities,
        scene.harmonics,
    )
    assert splats.render_splats(behind, camera()).alpha.max() == 0


def test_harmonics_are_scipys(splats, generator):
    """Scipy's are complex, with the sign (-1)^m that splats keep: m < 0 is the imaginary part, m > 0 the real one."""
    towards = torch.nn.functional.normalize(torch.randn(50, 3, generator=generator), dim=-1)
    found = splats.spherical_harmonics(towards, 16)
    x, y, z = towards.double().numpy().T
    polar, azimuth = np.arccos(z), np.arctan2(y, x)
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = scipy.special.sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.imag if order < 0 else value.real
            expected = part if order == 0 else math.sqrt(2) * part
            index = degree * (degree + 1) + order
            np.testing.assert_allclose(found[:, index], expected, atol=2e-6)


def exported(scene):
    """The bytes of a PLY as splat programs write it."""
    rest = scene.harmonics.shape[1] - 1
    names = [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        *(f"f_dc_{k}" for k in range(3)),
        *(f"f_rest_{k}" for k in range(3 * rest)),
    ]
    names += ["opacity", *(f"scale_{k}" for k in range(3)), *(f"rot_{k}" for k in range(4))]
    columns = [scene.means, torch.zeros_like(scene.means), scene.harmonics[:, 0], scene.harmonics[:, 1:].mT.flatten(1)]
    columns += [scene.opacities.logit()[:, None], scene.scales.log(), scene.quaternions]
    header = ["ply", "format binary_little_endian 1.0", "comment made by a test", f"element vertex {len(scene)}"]
    header += [*(f"property float {name}" for name in names), "end_header", ""]
    return "\n".join(header).encode() + torch.cat(columns, dim=1).numpy().astype("<f4").tobytes()


@pytest.mark.parametrize("degree", [0, 3])
def test_reading_gives_what_was_written(splats, generator, tmp_path, degree):
    scene = some(splats, 7, generator, degree)
    (tmp_path / "splats.ply").write_bytes(exported(scene))
    found = splats.read_splats(tmp_path / "splats.ply")
    for name in ("means", "scales", "quaternions", "opacities", "harmonics"):
        torch.testing.assert_close(getattr(found, name), getattr(scene, name))


@pytest.mark.parametrize(
    "damage", [lambda data: b"ply\n", lambda data: data[:-4], lambda data: data.replace(b"opacity", b"capacity")]
)
def test_other_files_are_refused(splats, generator, tmp_path, damage):
    (tmp_path / "splats.ply").write_bytes(damage(exported(some(splats, 3, generator))))
    with pytest.raises(InputError, match=r"splats\.ply: expected"):
        splats.read_splats(tmp_path / "splats.ply")
