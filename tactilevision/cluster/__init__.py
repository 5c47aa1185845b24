"""A Dask cluster that runs already, as an executor: the work itself stays where it is."""
