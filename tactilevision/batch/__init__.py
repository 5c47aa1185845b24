"""Many frames: folders and trees of recordings, through a job on all cores, resumable."""
