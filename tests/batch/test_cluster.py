"""Standard output stays clean while a cluster ends."""

import sys

import pytest

from neural_strands.batch.cluster import cluster


@pytest.mark.slow(seconds=10)
def test_what_ray_prints_while_it_shuts_down_stays_off_standard_output(capfd, monkeypatch):
    ray = pytest.importorskip("ray", reason="the extra batch is not installed")
    shutdown = ray.shutdown

    def loud() -> None:
        sys.stdout.write("(raylet) Raylet is terminated.\n")
        shutdown()

    monkeypatch.setattr(ray, "shutdown", loud)
    with cluster(None) as nodes:
        assert nodes.cores >= 1
    assert not ray.is_initialized()
    sys.stdout.write("results\n")
    assert capfd.readouterr().out == "results\n"
