"""Many calibrations in one run: jobs over processes or a cluster, a summary of the fleet, and `camcal watch`.

`jobs.py` reads what is to be done, `work.py` does one job, `executors.py` and `run.py` distribute them,
`storage.py` holds what is done, `fleet.py` compares the cameras, `page.py` shows them.
"""
