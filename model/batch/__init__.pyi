from .job import Job as Job
from .job import Member as Member
from .job import make_jobs as make_jobs
from .job import run_job as run_job
from .run import BatchInterrupt as BatchInterrupt
from .run import run_jobs as run_jobs
from .run import simulate_many as simulate_many
from .store import Store as Store
