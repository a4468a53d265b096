"""When does a spanning tree pay? Seeds of the least squares solve, measured and explained: see docs/tree-study.md.

`python -m bench.tree [--full] [--device cuda:0] [--sizes bar:1k sphere:5] [--methods curve arap figures]`
"""
