"""The same as `compare`, `diagnose` and `steps`, in a browser on this machine: see, add, undo, export."""
