"""Benchmarks: one script per claim, each prints one table and writes one JSON file to bench/results/."""
