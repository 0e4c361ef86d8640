"""Naive twins and peers of the parts of a step: SciPy's k-d trees, exact distances, plain torch, torch's plain Adam."""

from collections.abc import Callable, Mapping
from unittest import mock

import torch
from jaxtyping import Float, Int64
from plain import plain_torch
from scipy.spatial import KDTree
from torch import Tensor

from neural_strands.fitting import losses
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.signed_distance import signed_distance

Work = Callable[[], object]
TREE = "SciPy's k-d tree"


class StepTwins:
    """What the twins need of a step."""

    def __init__(
        self,
        head: Mesh,
        everything: PointGrid,
        targets: PointGrid,
        strands: Float[Tensor, "strand point 3"],
        optimiser: torch.optim.Adam,
    ) -> None:
        """Prepare the twins.

        Args:
            head: to which exact distances are measured.
            everything: the points of all strands.
            targets: the points of the segments.
            strands: those that the step decodes.
            optimiser: of the step.
        """
        self._head, self._strands = head, strands
        self._points = everything.points.cpu().numpy()
        # The order of a grid's points is that of its cells, so indices of the tree are translated.
        self._trees = {
            id(grid): (KDTree(grid.points.cpu().numpy()), grid.order.long()) for grid in (everything, targets)
        }
        self._everything = everything, targets  # alive, so that no other object gets their numbers
        parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
        self._adam = torch.optim.Adam(parameters, lr=1e-9, foreach=False, fused=False)

    def of(self, parts: Mapping[str, Work]) -> dict[str, tuple[str, Work]]:
        """Name and work of each twin, by the name of the part."""
        twins: dict[str, tuple[str, Work]] = {
            name: ("plain torch", self._plain(parts[name]))
            for name in ("decode some strands, forward and backward", "decode all strands")
        }
        twins["index the points of all strands"] = (TREE, lambda: KDTree(self._points))
        for name in ("surface loss", "coverage loss"):
            twins[name] = (TREE, self._by_trees(parts[name]))
        start = self._strands.shape[1] // 10
        free = self._strands[:, start:].reshape(-1, 3)
        twins["head penalty"] = ("exact distance to the mesh", lambda: signed_distance(free, self._head))
        name = "render a region, forward and backward"
        twins[name] = ("plain torch", self._plain(parts[name]))
        twins["Adam over everything"] = ("torch's Adam, tensor by tensor", self._adam.step)
        return twins

    def _plain(self, part: Work) -> Work:
        def run() -> None:
            with plain_torch():
                part()

        return run

    def _by_trees(self, part: Work) -> Work:
        def run() -> None:
            with mock.patch.object(losses, "nearest", self._nearest):
                part()

        return run

    def _nearest(
        self, queries: Float[Tensor, "query 3"], grid: PointGrid, radius: float
    ) -> tuple[Float[Tensor, " query"], Int64[Tensor, " query"]]:
        """`geometry.point_queries.nearest` by a tree."""
        tree, order = self._trees[id(grid)]
        distance, found = tree.query(queries.cpu().numpy(), distance_upper_bound=radius)
        place = torch.from_numpy(found).to(order.device)
        index = torch.where(place < len(order), order[place.clamp(max=len(order) - 1)], -1)
        return torch.from_numpy(distance).float().to(queries.device), index
