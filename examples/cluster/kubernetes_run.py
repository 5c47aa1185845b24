"""A Dask cluster on Kubernetes, and `tactilevision depth` on it: `python kubernetes_run.py RECORDINGS OUT`.

Needs `pip install dask-kubernetes '.[cluster]'`, the Dask operator in the cluster, and a volume claim
that this process mounts at the same place, /data: workers read and write there. IMAGE is yours; it holds the same
version of tactilevision as this process.
"""

from __future__ import annotations

import subprocess
import sys

from dask_kubernetes.operator import KubeCluster, make_cluster_spec

IMAGE = "registry.example.org/tactilevision:0.1.0"
CLAIM = "recordings"
WORKERS = 40


def specification() -> dict[str, object]:
    """What the operator starts: workers with one thread, and the claim at /data."""
    spec = make_cluster_spec(name="tactilevision", image=IMAGE, n_workers=WORKERS)
    pod = spec["spec"]["worker"]["spec"]
    pod["volumes"] = [{"name": "data", "persistentVolumeClaim": {"claimName": CLAIM}}]
    (container,) = pod["containers"]
    container["args"] += ["--nthreads", "1"]
    container["env"] = [{"name": "OPENBLAS_NUM_THREADS", "value": "1"}]
    container["resources"] = {"requests": {"cpu": "1", "memory": "2Gi"}, "limits": {"memory": "4Gi"}}
    container["volumeMounts"] = [{"name": "data", "mountPath": "/data"}]
    return dict(spec)


def main(recordings: str, out: str) -> int:
    """Start the pods, run the command, end the pods; returns the command's exit code."""
    with KubeCluster(custom_cluster_spec=specification()) as cluster:
        cluster.wait_for_workers(1)
        command = ["tactilevision", "depth", recordings, "--out", out, "--format", "zarr"]
        address = f"insecure:{cluster.scheduler_address}"  # plain TCP: for networks whose users are all trusted
        return subprocess.run([*command, "--cluster", address], check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
