#!/bin/bash
# The same without dask-jobqueue: one job with a scheduler, workers on all its nodes, and the command.
# Submit with: sbatch slurm_job.sh RECORDINGS OUT
#SBATCH --job-name=tactilevision
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=16
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=08:00:00
set -euo pipefail
recordings=$1 out=$2
export OPENBLAS_NUM_THREADS=1

# On a disk that all nodes see. A job that is queued again writes it anew.
address=$PWD/scheduler-$SLURM_JOB_ID.json
dask scheduler --scheduler-file "$address" --no-dashboard &
srun dask worker --scheduler-file "$address" --nthreads 1 --no-dashboard --death-timeout 300 &
until [ -s "$address" ]; do sleep 1; done

tactilevision depth "$recordings" --out "$out" --format zarr --cluster "insecure:$address"
