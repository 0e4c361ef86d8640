"""The texture atlas of faces against bilinear samples of it, one by one."""

import pytest
import torch

from neural_strands.geometry.mesh import interpolate
from neural_strands.raster.face_atlas import FaceAtlas
from neural_strands.raster.texture import sample_texture


@pytest.mark.parametrize(("faces", "size"), [(1, 4), (2, 8), (7, 40), (12, 3), (50, 64)])
def test_samples_of_a_face_touch_only_its_own_texels(faces, size, generator):
    atlas = FaceAtlas.within(faces, size, 100)
    texels = atlas.texels()
    owner = torch.full((atlas.size * atlas.size,), -1)
    owner[texels.texel] = texels.face
    # No texel has two owners.
    assert len(texels.texel.unique()) == len(texels.texel)
    face = torch.randint(faces, (500,), generator=generator)
    weights = -torch.rand(500, 3, generator=generator).log()
    barycentric = weights / weights.sum(dim=1, keepdim=True)
    texture = torch.zeros(atlas.size, atlas.size, 1, requires_grad=True)
    for one in range(0, 500, 10):
        some = slice(one, one + 1)
        uv = interpolate(atlas.corner_uv(), face[some], barycentric[some])
        (touched,) = torch.autograd.grad(sample_texture(texture, uv).sum(), texture)
        assert set(owner[torch.nonzero(touched.flatten() > 1e-6).squeeze(1)].tolist()) == {int(face[one])}


@pytest.mark.parametrize(("faces", "size"), [(1, 4), (9, 60)])
def test_a_colour_that_is_linear_on_each_face_is_kept(faces, size, generator):
    atlas = FaceAtlas.within(faces, size, 100)
    corners = torch.rand(faces, 3, 3, generator=generator)
    texels = atlas.texels()
    texture = torch.zeros(atlas.size * atlas.size, 3)
    texture[texels.texel] = interpolate(corners, texels.face, texels.barycentric)
    face = torch.randint(faces, (200,), generator=generator)
    # Away from the edge between the second and the third corner: texels beyond it count as on it.
    barycentric = torch.rand(200, 3, generator=generator) * torch.tensor([0.0, 0.5, 0.5])
    barycentric[:, 0] = 1 - barycentric.sum(dim=1)
    inner = barycentric[:, 0] * atlas.steps >= 1
    uv = interpolate(atlas.corner_uv(), face, barycentric)
    found = sample_texture(texture.view(atlas.size, atlas.size, 3), uv)
    torch.testing.assert_close(found[inner], interpolate(corners, face, barycentric)[inner])


def test_the_texture_is_as_fine_as_its_size_allows():
    assert FaceAtlas.within(0, 100, 5).size == 1
    assert FaceAtlas.within(0, 100, 5).corner_uv().shape == (0, 3, 2)
    # 104 blocks a side hold 21,444 faces.
    assert FaceAtlas.within(21_444, 768, 10) == FaceAtlas(21_444, 4)
    assert FaceAtlas.within(21_444, 768, 10).size == 728
    assert FaceAtlas.within(21_444, 768, 2).steps == 2
    # A mesh with too many faces gets the smallest blocks.
    assert FaceAtlas.within(20_000, 64, 10).steps == 1
    assert FaceAtlas.within(20_000, 64, 10).size == 400
