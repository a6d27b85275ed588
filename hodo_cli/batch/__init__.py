"""Tasks in processes or on dask, their progress, and the memory that they may take."""
