"""A Dask cluster on Slurm, and `tactilevision depth` on it: `python slurm_run.py RECORDINGS OUT`.

Needs `pip install dask-jobqueue '.[cluster]'`. Run it on a login node, or in a small job.
Queue, memory and time are those of a made-up site: write yours.
"""

from __future__ import annotations

import subprocess
import sys

from dask_jobqueue import SLURMCluster

JOBS = 20


def main(recordings: str, out: str) -> int:
    """Start the jobs, run the command, end the jobs; returns the command's exit code."""
    with SLURMCluster(
        queue="compute",
        cores=8,
        processes=8,  # one process a core: each reads one frame at a time
        memory="16GB",
        walltime="08:00:00",
        job_script_prologue=["export OPENBLAS_NUM_THREADS=1"],
        scheduler_options={"dashboard": False},
    ) as cluster:
        cluster.scale(jobs=JOBS)
        command = ["tactilevision", "depth", recordings, "--out", out, "--format", "zarr"]
        address = f"insecure:{cluster.scheduler_address}"  # plain TCP: for networks whose users are all trusted
        return subprocess.run([*command, "--cluster", address], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
