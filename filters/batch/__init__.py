"""Many files by one recipe: `run_batch`, and what it says of them."""

from oneform_warp.filters.batch.journal import Entry, read_entries
from oneform_warp.filters.batch.run import run_batch
from oneform_warp.filters.batch.tally import BatchProgress, BatchResult

__all__ = ["BatchProgress", "BatchResult", "Entry", "read_entries", "run_batch"]
