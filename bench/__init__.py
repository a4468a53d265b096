"""Benchmarks: one script per claim, each prints one table and writes one JSON file to bench/results/.

Every library of the comparison gets BENCH_THREADS threads, by default one: Warp's CPU kernels run in one, and idle
BLAS threads spin, which would count as CPU-seconds that nobody needed. It must be known before NumPy loads, hence here.
"""

import os

THREADS = os.environ.get("BENCH_THREADS", "1")
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = THREADS
os.environ.setdefault("KMP_BLOCKTIME", "0")
