"""Runs a command as N shards on a HyperQueue of this machine: on_hyperqueue.py N COMMAND..."""

import sys
from pathlib import Path

from hyperqueue import Job, LocalCluster
from hyperqueue.ffi.protocol import ResourceRequest

shards, command = int(sys.argv[1]), sys.argv[2:]
with LocalCluster() as cluster:
    cluster.start_worker()
    job = Job(max_fails=shards)
    for i in range(1, shards + 1):
        job.program(
            [*command, "--shard", f"{i}/{shards}", "--jobs", "1"],
            resources=ResourceRequest(cpus=1),
            cwd=str(Path.cwd()),
            stdout=str(Path.cwd() / f"hq-{i}.out"),
            stderr=str(Path.cwd() / f"hq-{i}.err"),
        )
    client = cluster.client()
    # A shard in which a run fails ends with code 1, which HyperQueue takes for a failed task.
    client.wait_for_jobs([client.submit(job)], raise_on_error=False)
