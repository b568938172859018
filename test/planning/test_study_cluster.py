"""Studies on a Dask cluster: the same bits, also when a worker dies half way; no cluster there."""

import os
import signal
import time

import numpy as np
import pytest
from test_study import study

import cable_shape as cs


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_bits_though_a_worker_dies(tmp_path):
    import distributed

    alone = study(chunk=1).run(workers=1)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        killed = []

        def kill(done, whole):
            if done >= 3 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        found = study(chunk=1).run(tmp_path / "out", scheduler=cluster.scheduler_address, progress=kill)
    assert killed
    for name in ("value", "instant", "place"):
        assert np.array_equal(getattr(found, name), getattr(alone, name), equal_nan=True)


@pytest.mark.filterwarnings("ignore")
def test_no_cluster_there_is_told_and_nothing_is_lost(tmp_path, monkeypatch):
    monkeypatch.setattr("cable_shape.planning.study_run.PATIENCE", 0.5)
    began = time.monotonic()
    with pytest.raises(cs.DependencyError, match="no cluster answers there"):
        study().run(tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert time.monotonic() - began < 60.0
    assert study().run(tmp_path / "out", workers=1).complete.all()
