"""Many trials in one go: found below a folder, tracked on Dask, each outcome told.

Folders, patterns and manifests come in. A result folder of each trial and the tables ``summary.csv`` and ``cycles.csv``
go out; what ended is known at the next run. It touches the output folder alone, and starts processes.
"""
