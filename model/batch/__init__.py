"""Many simulations at once: trials times parameter sets, on threads, processes or a cluster, resumable.

`job` says what one member is and computes it, `run` hands jobs to an executor, `store` keeps finished members on disk.
"""

from model.batch.job import Job, Member, make_jobs, run_job
from model.batch.run import BatchInterrupt, run_jobs, simulate_many
from model.batch.store import Store

__all__ = ["BatchInterrupt", "Job", "Member", "Store", "make_jobs", "run_job", "run_jobs", "simulate_many"]
