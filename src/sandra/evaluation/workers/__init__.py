"""The same work on many items, in this process, in several, or on a cluster.

    as_done(work, items, workers)   item and answer, as the answers come
    in_order(work, items, workers)  the answers, in the order of the items

`workers` is a number of processes (`ALL_CORES`: one for each core) or a `Cluster`. The answers are
the same. What goes wrong with one item is that item's answer and nobody else's, see `Broken`.
"""

from sandra.evaluation.workers.cluster import Cluster
from sandra.evaluation.workers.items import Broken
from sandra.evaluation.workers.local import ALL_CORES, processes
from sandra.evaluation.workers.walk import Workers, as_done, in_order

__all__ = ["ALL_CORES", "Broken", "Cluster", "Workers", "as_done", "in_order", "processes"]
