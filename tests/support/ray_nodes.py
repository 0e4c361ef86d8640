"""A Ray cluster of two nodes of one core each, in a process of its own.

Prints the address of its head; each word on standard input kills the second node; the end of standard input ends all.
"""

import os
import sys

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
# Tasks have low priority by default, and would wait for the tests that run beside this one.
os.environ["RAY_worker_niceness"] = "0"  # noqa: SIM112

from ray.cluster_utils import Cluster


def main() -> None:
    head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 10**8}
    # The test neither reads what workers log nor lets the cluster grow.
    unwatched = {"include_log_monitor": False, "no_monitor": True}
    cluster = Cluster(initialize_head=True, head_node_args=head | unwatched)
    second = cluster.add_node(num_cpus=1, object_store_memory=10**8)
    cluster.wait_for_nodes()
    _say(str(cluster.address))
    for _ in sys.stdin:
        cluster.remove_node(second, allow_graceful=False)
        _say("killed")
    cluster.shutdown()


def _say(word: str) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
